//! The discrete-time algebraic Riccati equation.

use ballbot_base::error::{Error, Result};
use nalgebra::{DMatrix, DVector, SMatrix};

/// Relative residual above which a solution is rejected.
const MAX_RESIDUAL: f64 = 1e-9;

/// Largest number of doublings: they converge quadratically, and 2⁶⁰ steps are beyond the memory of any loop that can
/// be distinguished from an unstable loop.
const MAX_DOUBLINGS: usize = 60;

/// Largest number of Newton steps after the doublings.
const MAX_NEWTON_STEPS: usize = 8;

/// The infinite-horizon linear-quadratic regulator of x⁺ = A x + B u with cost Σ xᵀQx + uᵀRu.
#[derive(Clone, Debug)]
pub struct Regulator {
    /// P: the cost from x is xᵀPx.
    pub cost: DMatrix<f64>,
    /// K: the optimal input is −K x.
    pub gain: DMatrix<f64>,
    /// ‖P − Riccati(P)‖ / ‖P‖, with states and inputs in units of equal cost.
    pub residual: f64,
}

/// Solves P = AᵀPA − AᵀPB (R + BᵀPB)⁻¹ BᵀPA + Q by the structure-preserving doubling algorithm (Chu, Fan, Lin & Wang,
/// Int. J. Control 77(8), 2004) and Newton's method (Hewer, IEEE Trans. Autom. Control 16(4), 1971) from its result.
/// The solution is accepted if its residual is small and powers of the closed loop vanish.
///
/// # Errors
/// [`Error::Riccati`] if no stabilizing solution is found.
pub fn solve(a: &DMatrix<f64>, b: &DMatrix<f64>, q: &DMatrix<f64>, r: &DMatrix<f64>) -> Result<Regulator> {
    if q.amax() == 0.0 {
        return Err(failed("Q is zero: there is nothing to regulate"));
    }
    // In units of equal cost, weights of different magnitude do not cost digits.
    let (x, u) = (equal_cost(q), equal_cost(r));
    let problem = Problem {
        a: scaled(a, &x.map(f64::recip), &x),
        b: scaled(b, &x.map(f64::recip), &u),
        q: scaled(q, &x, &x),
        r: scaled(r, &u, &u),
    };
    let start = problem.double()?;
    let Solution { cost, gain, residual } = problem.refine(start)?;
    Ok(Regulator {
        cost: scaled(&cost, &x.map(f64::recip), &x.map(f64::recip)),
        gain: scaled(&gain, &u, &x.map(f64::recip)),
        residual,
    })
}

/// A matrix with its size at run time.
pub(crate) fn dynamic<const N: usize, const M: usize>(matrix: &SMatrix<f64, N, M>) -> DMatrix<f64> {
    DMatrix::from_column_slice(N, M, matrix.as_slice())
}

/// Rows of a matrix, from column `first` on.
pub(crate) fn rows<const N: usize, const M: usize>(matrix: &DMatrix<f64>, first: usize) -> [[f64; M]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, first + j)]))
}

fn failed(reason: impl Into<String>) -> Error {
    Error::Riccati(reason.into())
}

/// The values that cost 1 each; 1 for zero cost.
fn equal_cost(cost: &DMatrix<f64>) -> DVector<f64> {
    cost.diagonal().map(|cost| if cost > 0.0 { cost.sqrt().recip() } else { 1.0 })
}

/// diag(left) M diag(right).
fn scaled(m: &DMatrix<f64>, left: &DVector<f64>, right: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| left[i] * m[(i, j)] * right[j])
}

fn symmetric(m: &DMatrix<f64>) -> DMatrix<f64> {
    (m + m.transpose()) * 0.5
}

/// The equation in units of equal cost.
struct Problem {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    q: DMatrix<f64>,
    r: DMatrix<f64>,
}

struct Solution {
    cost: DMatrix<f64>,
    gain: DMatrix<f64>,
    residual: f64,
}

impl Problem {
    /// P by doubling the number of steps of the horizon.
    fn double(&self) -> Result<DMatrix<f64>> {
        let identity = DMatrix::identity(self.a.nrows(), self.a.nrows());
        let r_inverse = self.r.clone().cholesky().ok_or_else(|| failed("R is not positive definite"))?.inverse();
        let mut power = self.a.clone();
        let mut g = &self.b * r_inverse * self.b.transpose();
        let mut p = self.q.clone();
        for _ in 0..MAX_DOUBLINGS {
            let w = (&identity + &g * &p).lu();
            let (Some(wa), Some(wg)) = (w.solve(&power), w.solve(&g)) else {
                return Err(failed("the doubling iteration met a singular matrix"));
            };
            let increment = power.transpose() * &p * &wa;
            g = symmetric(&(&g + &power * wg * power.transpose()));
            power = &power * wa;
            p = symmetric(&(&p + &increment));
            let change = increment.norm() / p.norm();
            if !change.is_finite() {
                return Err(failed("the doubling iteration does not converge: the cost is not finite"));
            }
            if change <= f64::EPSILON {
                break;
            }
        }
        Ok(p)
    }

    /// Refines the approximate solution `cost`.
    fn refine(&self, mut cost: DMatrix<f64>) -> Result<Solution> {
        let mut best: Option<Solution> = None;
        for _ in 0..=MAX_NEWTON_STEPS {
            let candidate = self.solution(cost)?;
            let improved = best.as_ref().is_none_or(|best| candidate.residual < 0.5 * best.residual);
            if !improved {
                break;
            }
            let closed_loop = &self.a - &self.b * &candidate.gain;
            let stage = &self.q + candidate.gain.transpose() * &self.r * &candidate.gain;
            let next = cost_of(&closed_loop, stage);
            best = Some(candidate);
            match next {
                Some(next) => cost = next,
                // The closed loop is unstable; decided below.
                None => break,
            }
        }
        let solution = best.ok_or_else(|| failed("no solution was found"))?;
        let residual = solution.residual;
        if residual.is_nan() || residual > MAX_RESIDUAL {
            return Err(failed(format!("relative residual {residual:e}, limit {MAX_RESIDUAL:e}")));
        }
        self.require_stable(&solution.gain)?;
        Ok(solution)
    }

    fn solution(&self, cost: DMatrix<f64>) -> Result<Solution> {
        let bp = self.b.transpose() * &cost;
        let gain = (&self.r + symmetric(&(&bp * &self.b)))
            .cholesky()
            .ok_or_else(|| failed("the cost matrix is not positive semidefinite"))?
            .solve(&(&bp * &self.a));
        let closed_loop = &self.a - &self.b * &gain;
        let residual = (&self.q + self.a.transpose() * &cost * closed_loop - &cost).norm() / cost.norm();
        Ok(Solution { cost, gain, residual })
    }

    /// A power of the closed loop with norm below 1 shows that all its poles are within the unit circle.
    fn require_stable(&self, gain: &DMatrix<f64>) -> Result<()> {
        let mut power = &self.a - &self.b * gain;
        let mut pole = f64::NAN;
        for doubling in 0..MAX_DOUBLINGS as i32 {
            let norm = power.norm();
            if norm < 1.0 {
                return Ok(());
            }
            pole = norm.powf(0.5_f64.powi(doubling));
            if norm.is_nan() || norm > 1e100 {
                break;
            }
            power = &power * &power;
        }
        Err(failed(format!("closed loop has a pole of modulus {pole}, limit 1")))
    }
}

/// Σ (Mᵏ)ᵀ `stage` Mᵏ, by doubling; `None` if it does not converge.
fn cost_of(closed_loop: &DMatrix<f64>, stage: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (mut power, mut cost) = (closed_loop.clone(), stage);
    for _ in 0..MAX_DOUBLINGS {
        let increment = power.transpose() * &cost * &power;
        cost = symmetric(&(&cost + &increment));
        let change = increment.norm() / cost.norm();
        if !change.is_finite() {
            return None;
        }
        if change <= f64::EPSILON {
            return Some(cost);
        }
        power = &power * &power;
    }
    None
}
