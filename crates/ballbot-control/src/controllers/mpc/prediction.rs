//! The optimization problem of the predictive controller, and its solution by an accelerated gradient method.

use super::plane::Plane;
use crate::parts::limits::{LeanRow, ROWS};
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::wheels::Wheels;
use nalgebra::{DMatrix, SymmetricEigen};

/// Stages of the horizon.
pub(super) const STAGES: usize = 25;

/// The inputs v of both planes at all stages.
pub(super) type Plan<L> = [[L; 2]; STAGES];

/// Quantities that are constant over the stages of one call.
#[derive(Clone, Copy)]
pub(super) struct Start<L> {
    /// (y, θ, ẏ, θ̇) of both planes, from the motion of the setpoint.
    pub(super) x: [[L; 4]; 2],
    /// Constant of each row.
    pub(super) rows: [L; ROWS],
    /// Torque of each wheel in the motion of the setpoint, as a fraction of the largest torque.
    pub(super) torques: Wheels<L>,
    /// Torque of each wheel per acceleration of a lean, as a fraction of the largest torque: this factor times the
    /// motors' torque per acceleration.
    pub(super) per_acceleration: L,
}

/// minimize ½ Σ |v|² + ½ ρ Σ max(0, r)² over the inputs v, with the violations r of the limits at each stage.
#[derive(Clone, Debug)]
pub(super) struct Prediction {
    pub(super) planes: [Plane; 2],
    pub(super) rows: [LeanRow; ROWS],
    /// Torque of each wheel per acceleration of a lean, N·m·s².
    pub(super) torques: Wheels<[f64; 2]>,
    /// ρ, the cost of a violation.
    pub(super) penalty: f64,
    pub(super) iterations: usize,
    /// Largest curvature of the cost by the rows, and by the torques, per square of `per_acceleration`.
    curvature: [f64; 2],
}

impl Prediction {
    /// # Errors
    /// [`Error::Inconsistent`] if the curvatures of the problem are not found.
    pub(super) fn new(
        planes: [Plane; 2],
        rows: &[LeanRow; ROWS],
        torques: Wheels<[f64; 2]>,
        penalty: f64,
        iterations: usize,
    ) -> Result<Self> {
        let mut new = Self { planes, rows: *rows, torques, penalty, iterations, curvature: [0.0; 2] };
        new.curvature = new.largest_curvatures()?;
        Ok(new)
    }

    /// Largest curvatures that the rows and the torques can give: with all of them violated.
    fn largest_curvatures(&self) -> Result<[f64; 2]> {
        let (mut of_rows, mut of_torques) =
            (DMatrix::zeros(STAGES * ROWS, 2 * STAGES), DMatrix::zeros(STAGES * 3, 2 * STAGES));
        for column in 0..2 * STAGES {
            let mut x = [[0.0; 4]; 2];
            for stage in 0..STAGES {
                let v = [0, 1].map(|axis| f64::from(u8::from(column == 2 * stage + axis)));
                let u = [0, 1].map(|axis| self.planes[axis].input(x[axis], v[axis]));
                for (i, row) in self.rows.iter().enumerate() {
                    of_rows[(stage * ROWS + i, column)] = row.value(0.0, [x[0][1], x[1][1]], u);
                }
                for (i, torque) in self.torques.iter().enumerate() {
                    of_torques[(stage * 3 + i, column)] = torque[0] * u[0] + torque[1] * u[1];
                }
                x = [0, 1].map(|axis| self.planes[axis].next(x[axis], u[axis]));
            }
        }
        Ok([largest_eigenvalue(&of_rows)?, largest_eigenvalue(&of_torques)?])
    }

    /// The derivatives of ½ ρ Σ max(0, r)² at one stage with respect to leans and inputs, over ρ.
    #[inline(always)]
    fn violation<L: Lane>(&self, start: &Start<L>, lean: [L; 2], u: [L; 2]) -> ([L; 2], [L; 2]) {
        let zero = u[0].zero();
        let (mut by_lean, mut by_input) = ([zero; 2], [zero; 2]);
        for (row, constant) in self.rows.iter().zip(start.rows) {
            let over = row.value(constant, lean, u).max(zero);
            for axis in 0..2 {
                by_lean[axis] = over.mul_add_all(row.per_lean[axis], by_lean[axis]);
                by_input[axis] = over.mul_add_all(row.per_acceleration[axis], by_input[axis]);
            }
        }
        let one = zero.splat(1.0);
        for (torque, constant) in self.torques.iter().zip(start.torques) {
            let driven = u[1].mul_add_all(torque[1], u[0] * torque[0]);
            let share = driven.mul_add(start.per_acceleration, constant);
            // The part beyond ±1.
            let over = (share - one.min(share).max(-one)) * start.per_acceleration;
            for axis in 0..2 {
                by_input[axis] = over.mul_add_all(torque[axis], by_input[axis]);
            }
        }
        (by_lean, by_input)
    }

    /// Robots whose regulator violates a limit at a stage.
    #[inline(always)]
    pub(super) fn is_limited<L: Lane>(&self, start: &Start<L>) -> L::Mask {
        let zero = start.per_acceleration.zero();
        let mut x = start.x;
        let mut worst = zero;
        let one = zero.splat(1.0);
        for _ in 0..STAGES {
            let u = [self.planes[0].input(x[0], zero), self.planes[1].input(x[1], zero)];
            for (row, constant) in self.rows.iter().zip(start.rows) {
                worst = row.value(constant, [x[0][1], x[1][1]], u).max(worst);
            }
            for (torque, constant) in self.torques.iter().zip(start.torques) {
                let driven = u[1].mul_add_all(torque[1], u[0] * torque[0]);
                worst = (driven.mul_add(start.per_acceleration, constant).abs() - one).max(worst);
            }
            x = [self.planes[0].next(x[0], u[0]), self.planes[1].next(x[1], u[1])];
        }
        zero.lt(worst)
    }

    /// Improves a plan by the fixed number of iterations.
    #[inline(always)]
    pub(super) fn improve<L: Lane>(&self, start: &Start<L>, plan: &mut Plan<L>) {
        let zero = start.per_acceleration.zero();
        // Point at which the gradient is taken: the plan and its momentum.
        let mut ahead = *plan;
        // 1/L with a bound L of the largest curvature, and Nesterov's momentum for the smallest curvature, 1. The
        // largest torque, and with it the curvature, depends on the call.
        let [of_rows, of_torques] = self.curvature.map(|curvature| self.penalty * curvature);
        let one = zero.splat(1.0);
        let largest = start.per_acceleration.squared().mul_add_all(of_torques, one.splat(1.0 + of_rows));
        let (step, root) = (one / largest, largest.sqrt());
        let of_many = (root - 1.0) / (root + 1.0);
        let (mut by_lean, mut by_input) = ([[zero; 2]; STAGES], [[zero; 2]; STAGES]);
        for iteration in 0..self.iterations {
            // The momentum of many iterations does not help few iterations.
            let momentum = of_many.min(one.splat(iteration as f64 / (iteration + 3) as f64));
            let mut x = start.x;
            for stage in 0..STAGES {
                let v = ahead[stage];
                let u = [self.planes[0].input(x[0], v[0]), self.planes[1].input(x[1], v[1])];
                (by_lean[stage], by_input[stage]) = self.violation(start, [x[0][1], x[1][1]], u);
                x = [self.planes[0].next(x[0], u[0]), self.planes[1].next(x[1], u[1])];
            }
            let mut after = [[zero; 4]; 2];
            for stage in (0..STAGES).rev() {
                for axis in 0..2 {
                    let plane = &self.planes[axis];
                    let by_input = by_input[stage][axis] + plane.by_input(after[axis]);
                    after[axis] = plane.by_state(after[axis], by_input);
                    after[axis][1] += by_lean[stage][axis];
                    let (v, old) = (ahead[stage][axis], plan[stage][axis]);
                    let descent = by_input.mul_add_all(self.penalty * plane.scale, v);
                    let new = descent.mul_add(-step, v);
                    ahead[stage][axis] = (new - old).mul_add(momentum, new);
                    plan[stage][axis] = new;
                }
            }
        }
    }
}

/// Largest number of steps of the search for eigenvalues; each eigenvalue needs about two.
const MAX_EIGENVALUE_STEPS: usize = 10_000;

fn largest_eigenvalue(g: &DMatrix<f64>) -> Result<f64> {
    let found = SymmetricEigen::try_new(g.transpose() * g, f64::EPSILON, MAX_EIGENVALUE_STEPS);
    found
        .map(|found| found.eigenvalues.max())
        .filter(|largest| largest.is_finite())
        .ok_or_else(|| Error::Inconsistent("the curvatures of the predictive controller were not found".into()))
}

/// The stored plan of the previous call, shifted by `share` of a stage.
#[inline(always)]
pub(super) fn load<L: Lane>(memory: &Memory<'_, L>, share: f64) -> Plan<L> {
    let zero = memory.splat(0.0);
    let mut plan = [[zero; 2]; STAGES];
    let mut after = [zero; 2];
    for stage in (0..STAGES).rev() {
        for axis in 0..2 {
            let v = memory.get(2 * stage + axis);
            plan[stage][axis] = (after[axis] - v).mul_add_all(share, v);
            after[axis] = v;
        }
    }
    plan
}

/// Stores a plan.
#[inline(always)]
pub(super) fn store<L: Lane>(plan: &Plan<L>, memory: &mut Memory<'_, L>) {
    for (stage, [x, y]) in plan.iter().enumerate() {
        memory.set(2 * stage, *x);
        memory.set(2 * stage + 1, *y);
    }
}
