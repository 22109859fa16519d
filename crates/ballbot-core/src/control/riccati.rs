//! The discrete-time algebraic Riccati equation.

use crate::error::{Error, Result};
use nalgebra::DMatrix;

/// Relative residual above which a solution is refused.
const MAX_RESIDUAL: f64 = 1e-9;

/// The infinite-horizon linear-quadratic regulator of x⁺ = A x + B u with cost Σ xᵀQx + uᵀRu.
#[derive(Clone, Debug)]
pub struct Regulator {
    /// P: the cost from x is xᵀPx.
    pub cost: DMatrix<f64>,
    /// K: the optimal input is −K x.
    pub gain: DMatrix<f64>,
    /// ‖P − Riccati(P)‖ / ‖P‖.
    pub residual: f64,
}

/// Solves P = AᵀPA − AᵀPB (R + BᵀPB)⁻¹ BᵀPA + Q by the structure-preserving doubling algorithm (Chu, Fan, Lin & Wang,
/// Int. J. Control 77(8), 2004), and verifies the result by its residual and by the closed loop's poles.
///
/// # Errors
/// [`Error::Riccati`] if no stabilising solution is found.
pub fn solve(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>) -> Result<Regulator> {
    let failed = |reason: &str| Error::Riccati(reason.to_owned());
    let identity = DMatrix::identity(a.nrows(), a.nrows());
    let r_inverse = r.clone().cholesky().ok_or_else(|| failed("R is not positive definite"))?.inverse();
    let mut power = a.clone();
    let mut g = b * r_inverse * b.transpose();
    let mut p = q.clone();
    for _ in 0..60 {
        let w = (&identity + &g * &p).lu();
        let (Some(wa), Some(wg)) = (w.solve(&power), w.solve(&g)) else {
            return Err(failed("the doubling iteration met a singular matrix"));
        };
        let increment = power.transpose() * &p * &wa;
        g += &power * wg * power.transpose();
        power = &power * wa;
        p += &increment;
        p = (&p + p.transpose()) * 0.5;
        if increment.norm() <= 1e-15 * p.norm() {
            break;
        }
    }
    regulator(a, b, q, r, p)
}

fn regulator(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    cost: DMatrix<f64>,
) -> Result<Regulator> {
    let bp = b.transpose() * &cost;
    let gain = (r + &bp * b)
        .cholesky()
        .ok_or_else(|| Error::Riccati("the cost matrix is not positive semidefinite".into()))?
        .solve(&(&bp * a));
    let closed_loop = a - b * &gain;
    let residual = (q + a.transpose() * &cost * &closed_loop - &cost).norm() / cost.norm();
    if residual.is_nan() || residual > MAX_RESIDUAL {
        return Err(Error::Riccati(format!("relative residual {residual:e}, limit {MAX_RESIDUAL:e}")));
    }
    let radius = closed_loop.complex_eigenvalues().iter().map(|pole| pole.norm()).fold(0.0, f64::max);
    if radius >= 1.0 {
        return Err(Error::Riccati(format!("closed loop has a pole of modulus {radius}, limit 1")));
    }
    Ok(Regulator { cost, gain, residual })
}
