//! The classical Runge-Kutta step of fourth order.

use nalgebra::SVector;

/// Advances y' = f(y) by `dt`.
pub fn rk4<const N: usize>(
    y: &SVector<f64, N>,
    dt: f64,
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, N>,
) -> SVector<f64, N> {
    let k1 = f(y);
    let k2 = f(&(y + k1 * (0.5 * dt)));
    let k3 = f(&(y + k2 * (0.5 * dt)));
    let k4 = f(&(y + k3 * dt));
    y + (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0)
}
