//! What planning controllers have in common: a regulator, the cost of a motion, and the setpoint ahead.

use crate::control::{LimitOptions, Lqr, LqrWeights, Sampled, Setpoint, TorqueLimits};
use crate::models::linear::STATES;
use ballbot_base::error::{Result, check};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::run_one;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::Scale;
use std::sync::{Mutex, PoisonError};

/// Largest number of decisions within the horizon.
const MAX_DECISIONS: usize = 500;

/// The cost of a motion: Σ xᵀQx + r |τ − τ_ref|², τ_ref the torques of the setpoint's motion, and xᵀPx at the end.
#[derive(Clone, Debug)]
pub(super) struct Objective {
    /// Diagonal of Q.
    pub(super) states: [f64; STATES],
    /// r.
    pub(super) torques: f64,
    /// P.
    pub(super) to_go: [[f64; STATES]; STATES],
}

/// The regulator whose torques a plan changes, at the decisions within the horizon.
#[derive(Clone, Debug)]
pub(super) struct Horizon {
    pub(super) base: Sampled<Lqr>,
    pub(super) limits: TorqueLimits,
    pub(super) objective: Objective,
    pub(super) control_dt: f64,
    pub(super) decisions: usize,
}

impl Horizon {
    /// A horizon of `seconds`.
    pub(super) fn new(
        params: &Params,
        control_dt: f64,
        seconds: f64,
        weights: &LqrWeights,
        limits: &LimitOptions,
    ) -> Result<Self> {
        let weights = Scale::of(params).fit(weights);
        let base = Lqr::with_weights(params, control_dt, &weights, limits)?;
        let limit = format_args!("from control_dt = {control_dt} s to {MAX_DECISIONS} times it");
        let decisions = seconds / control_dt;
        check("horizon", seconds, limit, |_| (1.0 - 1e-9..=MAX_DECISIONS as f64 + 0.5).contains(&decisions))?;
        let (q, r) = weights.matrices();
        let cost = &base.regulator().cost;
        let objective = Objective {
            states: std::array::from_fn(|i| q[(i, i)]),
            torques: r[(0, 0)],
            to_go: std::array::from_fn(|i| std::array::from_fn(|j| cost[(i, j)])),
        };
        let limits = TorqueLimits::new(params, control_dt, limits)?;
        Ok(Self { base, limits, objective, control_dt, decisions: decisions.round().max(1.0) as usize })
    }

    /// The setpoint extrapolated by its derivatives to a decision.
    pub(super) fn ahead(&self, setpoint: &Setpoint, decision: usize) -> Setpoint {
        let time = decision as f64 * self.control_dt;
        let (v, j, s) = (setpoint.velocity, setpoint.jerk, setpoint.snap);
        // Motion of the ball: ÿ = z̈ − (ℓ/g) z⁗.
        let a = setpoint.acceleration - s * self.base.lag();
        Setpoint {
            position: setpoint.position + (v + (a + (j + s * (time / 4.0)) * (time / 3.0)) * (time / 2.0)) * time,
            velocity: v + (a + (j + s * (time / 3.0)) * (time / 2.0)) * time,
            acceleration: setpoint.acceleration + (j + s * (time / 2.0)) * time,
            jerk: j + s * time,
            yaw: setpoint.yaw + setpoint.yaw_rate * time,
            ..*setpoint
        }
    }

    /// The applied torques for the desired torques.
    pub(super) fn limited(&self, desired: Wheels<f64>, state: &LaneState<f64>, largest: f64) -> Wheels<f64> {
        run_one(
            #[inline(always)]
            || self.limits.apply(desired, state, largest).torques,
        )
    }
}

/// Workspaces for concurrent calls.
#[derive(Debug)]
pub(super) struct Workspaces<T>(Mutex<Vec<T>>);

impl<T> Workspaces<T> {
    pub(super) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Works with a workspace that no other call uses, made if there is none.
    pub(super) fn with(&self, make: impl FnOnce() -> T, work: impl FnOnce(&mut T)) {
        let taken = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut workspace = taken.unwrap_or_else(make);
        work(&mut workspace);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

/// Whether a robot has not diverged, from its state and the torques of its regulator.
pub(super) fn can_be_simulated(state: &LaneState<f64>, torques: &Wheels<f64>) -> bool {
    torques.iter().all(|torque| torque.is_finite())
        && run_one(
            #[inline(always)]
            || state.within_bounds(),
        )
}

/// Moves a plan on by one decision, which has been applied.
pub(super) fn shift(plan: &mut [f64]) {
    plan.rotate_left(WHEELS);
    let end = plan.len() - WHEELS;
    plan[end..].fill(0.0);
}
