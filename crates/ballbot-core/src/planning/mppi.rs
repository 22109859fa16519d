//! Model predictive path integral control.

use super::rollouts::{Objective, Rollouts};
use crate::control::{
    Controller, LaneSetpoint, LimitOptions, Lqr, LqrWeights, MOTION_PARTS, Sampled, Setpoint, TorqueLimits,
    default_max_torque,
};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{EIGHT, run_one};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::Scale;
use std::sync::{Mutex, PoisonError};

crate::fields! {
    /// Sampling options of [`Mppi`].
    #[derive(Copy)]
    pub struct MppiOptions {
        /// Number of sampled motions; rounded up to a multiple of eight.
        pub samples: f64 = 512.0, "", Limit::from(8.0).to(65_536.0);
        /// How far they look ahead.
        pub horizon: f64 = 0.5, "s", Limit::from(1e-3).to(10.0);
        /// Longest time step of the simulation in them.
        pub step: f64 = 0.01, "s", Limit::from(1e-4).to(0.02);
        /// Standard deviation of the sampled torques, over the torque at which a wheel of the upright robot slips.
        pub noise: f64 = 0.3, "", Limit::above(0.0).to(10.0);
        /// Correlation of the sampled torques from one decision to the next.
        pub correlation: f64 = 0.8, "", Limit::from(0.0).below(1.0);
        /// Temperature of the weights, over the standard deviation of the costs.
        pub temperature: f64 = 0.2, "", Limit::above(0.0).to(100.0);
        /// Seed of the samples.
        pub seed: f64 = 0.0, "", Limit::from(0.0).to(4_294_967_295.0);
    }
}

/// Largest number of decisions within the horizon.
const MAX_DECISIONS: usize = 500;

/// Largest number of samples times decisions: 24 bytes each are stored.
const MAX_ALL: f64 = 1e6;

/// Model predictive path integral control (Williams, Drews, Goldfain, Rehg, Theodorou, "Information-theoretic model
/// predictive control", IEEE T-RO 34(6), 2018) on the model `contact`, including slip and lift-off.
///
/// Torques are the torques of [`Lqr`] plus a sequence δ. In each call all sampled motions start from the robot's state,
/// under the regulator and δ + ε with noise ε; δ becomes the mean of δ + ε with the weights exp(−J / T), where J is the
/// cost of the regulator along the motion plus its cost-to-go at the end. The samples depend only on the seed and the
/// call number. The setpoint is extrapolated over the horizon by its derivatives.
#[derive(Debug)]
pub struct Mppi {
    base: Sampled<Lqr>,
    limits: TorqueLimits,
    objective: Objective,
    options: MppiOptions,
    params: Params,
    control_dt: f64,
    decisions: usize,
    memory: Vec<f64>,
    /// Workspaces for concurrent calls.
    room: Mutex<Vec<Rollouts>>,
}

impl Mppi {
    /// Default time between two calls, s.
    pub const CONTROL_DT: f64 = 0.02;

    /// A controller for `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for an option out of range, a horizon that is shorter than `control_dt` or has more
    /// than 500 decisions; errors of [`Lqr::with_weights`].
    pub fn with_options(
        params: &Params,
        control_dt: f64,
        options: &MppiOptions,
        limits: &LimitOptions,
    ) -> Result<Self> {
        options.check_limits()?;
        params.validate()?;
        let weights = Scale::of(params).fit(&LqrWeights::default());
        let base = Lqr::with_weights(params, control_dt, &weights, limits)?;
        let limit = format_args!("from control_dt = {control_dt} s to {MAX_DECISIONS} times it");
        let decisions = options.horizon / control_dt;
        check("horizon", options.horizon, limit, |_| (1.0 - 1e-9..=MAX_DECISIONS as f64 + 0.5).contains(&decisions))?;
        let decisions = decisions.round().max(1.0) as usize;
        let all = options.samples * decisions as f64;
        check(
            "samples",
            options.samples,
            format_args!("at most {MAX_ALL} over all decisions within the horizon"),
            |_| all <= MAX_ALL,
        )?;
        let (q, r) = weights.matrices();
        let cost = &base.regulator().cost;
        let objective = Objective {
            states: std::array::from_fn(|i| q[(i, i)]),
            torques: r[(0, 0)],
            to_go: std::array::from_fn(|i| std::array::from_fn(|j| cost[(i, j)])),
        };
        Ok(Self {
            limits: TorqueLimits::new(params, limits)?,
            base,
            objective,
            options: *options,
            params: params.clone(),
            control_dt,
            decisions,
            memory: vec![0.0; 1 + 3 * decisions],
            room: Mutex::new(Vec::new()),
        })
    }

    /// The setpoint extrapolated by `time` seconds.
    fn ahead(&self, setpoint: &Setpoint, time: f64) -> Setpoint {
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

    /// Improves the sequence in `plan` for a robot, in call number `call`.
    fn improve(&self, state: &State, setpoint: &Setpoint, largest: f64, call: f64, plan: &mut [f64]) {
        let mut taken = self.room.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let rollouts = taken.get_or_insert_with(|| {
            let groups = (self.options.samples / EIGHT as f64).ceil() as usize;
            Rollouts::new(&self.params, self.control_dt, self.options.step, groups, self.decisions)
        });
        for (decision, cells) in rollouts.setpoints.iter_mut().enumerate() {
            let one = LaneSetpoint::from(&self.ahead(setpoint, decision as f64 * self.control_dt));
            (0..EIGHT).for_each(|i| cells.set_lane(i, &one));
        }
        let deviation = self.options.noise * default_max_torque(&self.params);
        rollouts.run(
            &self.base,
            &self.limits,
            &self.objective,
            state,
            plan,
            &super::rollouts::Noise {
                key: [self.options.seed, call],
                deviation,
                correlation: self.options.correlation,
                largest: largest.min(self.limits.max_torque()),
            },
        );
        rollouts.average(self.options.temperature, plan);
        self.room.lock().unwrap_or_else(PoisonError::into_inner).extend(taken);
    }
}

impl Controller for Mppi {
    fn id(&self) -> u64 {
        self.base.id()
    }

    fn control_dt(&self) -> f64 {
        self.control_dt
    }

    fn parts(&self) -> &'static [&'static str] {
        MOTION_PARTS
    }

    fn memory_len(&self) -> usize {
        self.memory.len()
    }

    fn memory_mut(&mut self) -> &mut Vec<f64> {
        &mut self.memory
    }

    fn torques_one(
        &self,
        state: &LaneState<f64>,
        setpoint: &LaneSetpoint<f64>,
        largest: f64,
        memory: &mut [f64],
    ) -> Wheels<f64> {
        let base = self.base.torques_one(state, setpoint, largest, &mut []);
        // Diverged samples are not simulated further.
        if !run_one(
            #[inline(always)]
            || state.within_bounds(),
        ) || base.iter().any(|torque| !torque.is_finite())
        {
            return base;
        }
        let (call, plan) = memory.split_first_mut().expect("the number of the call");
        // The decision of the last call has been applied.
        plan.rotate_left(WHEELS);
        let end = plan.len() - WHEELS;
        plan[end..].fill(0.0);
        self.improve(&State::from(*state), &Setpoint::from(setpoint), largest, *call, plan);
        *call += 1.0;
        let desired = Wheels::from_fn(|i| base[i] + plan[i]);
        run_one(
            #[inline(always)]
            || self.limits.apply(desired, state, largest).torques,
        )
    }
}
