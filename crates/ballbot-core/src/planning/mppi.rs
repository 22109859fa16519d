//! Model predictive path integral control.

use super::horizon::{Horizon, Workspaces, can_be_simulated, shift};
use super::rollouts::{Noise, Rollouts};
use crate::control::{Controller, LaneSetpoint, LimitOptions, LqrWeights, MOTION_PARTS, Setpoint, default_max_torque};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::EIGHT;
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};

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

/// Largest number of samples times decisions: 24 bytes each are stored.
const MAX_ALL: f64 = 1e6;

/// Model predictive path integral control (Williams, Drews, Goldfain, Rehg, Theodorou, "Information-theoretic model
/// predictive control", IEEE T-RO 34(6), 2018) on the model `contact`, including slip and lift-off.
///
/// Torques are the torques of [`Lqr`](crate::control::Lqr) plus a sequence δ. In each call all sampled motions start from
/// the robot's state, under the regulator and δ + ε with noise ε; δ becomes the mean of δ + ε with the weights exp(−J / T),
/// where J is the cost of the regulator along the motion plus its cost-to-go at the end. The samples depend only on the
/// seed and the call number. The setpoint is extrapolated over the horizon by its derivatives.
#[derive(Debug)]
pub struct Mppi {
    horizon: Horizon,
    options: MppiOptions,
    params: Params,
    memory: Vec<f64>,
    room: Workspaces<Rollouts>,
}

impl Mppi {
    /// Default time between two calls, s.
    pub const CONTROL_DT: f64 = 0.02;

    /// A controller for `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for an option out of range, a horizon that is shorter than `control_dt` or has more
    /// than 500 decisions; errors of [`Lqr::with_weights`](crate::control::Lqr::with_weights).
    pub fn with_options(
        params: &Params,
        control_dt: f64,
        options: &MppiOptions,
        limits: &LimitOptions,
    ) -> Result<Self> {
        options.check_limits()?;
        params.validate()?;
        let horizon = Horizon::new(params, control_dt, options.horizon, &LqrWeights::default(), limits)?;
        let decisions = horizon.decisions;
        let all = options.samples * decisions as f64;
        check(
            "samples",
            options.samples,
            format_args!("at most {MAX_ALL} over all decisions within the horizon"),
            |_| all <= MAX_ALL,
        )?;
        Ok(Self {
            horizon,
            options: *options,
            params: params.clone(),
            memory: vec![0.0; 1 + WHEELS * decisions],
            room: Workspaces::new(),
        })
    }

    /// Improves the sequence in `plan` for a robot, in call number `call`.
    fn improve(&self, state: &State, setpoint: &Setpoint, largest: f64, call: f64, plan: &mut [f64]) {
        let Horizon { limits, control_dt, decisions, .. } = &self.horizon;
        let options = &self.options;
        let noise = Noise {
            key: [options.seed, call],
            deviation: options.noise * default_max_torque(&self.params),
            correlation: options.correlation,
            largest: largest.min(limits.max_torque()),
        };
        let make = || {
            let groups = (options.samples / EIGHT as f64).ceil() as usize;
            Rollouts::new(&self.params, *control_dt, options.step, groups, *decisions)
        };
        self.room.with(make, |rollouts| {
            for (decision, cells) in rollouts.setpoints.iter_mut().enumerate() {
                let one = LaneSetpoint::from(&self.horizon.ahead(setpoint, decision));
                (0..EIGHT).for_each(|i| cells.set_lane(i, &one));
            }
            rollouts.run(&self.horizon, state, plan, &noise);
            rollouts.average(options.temperature, plan);
        });
    }
}

impl Controller for Mppi {
    fn id(&self) -> u64 {
        self.horizon.base.id()
    }

    fn control_dt(&self) -> f64 {
        self.horizon.control_dt
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
        let base = self.horizon.base.torques_one(state, setpoint, largest, &mut []);
        // Diverged samples are not simulated further.
        if !can_be_simulated(state, &base) {
            return base;
        }
        let (call, plan) = memory.split_first_mut().expect("the number of the call");
        shift(plan);
        let mut start = State::from(*state);
        // The floor of the samples is level, at height 0.
        let height = start.ball_position.z - self.params.ball_radius;
        start.ball_position.z -= height;
        start.body_position.z -= height;
        self.improve(&start, &Setpoint::from(setpoint), largest, *call, plan);
        *call += 1.0;
        self.horizon.limited(Wheels::from_fn(|i| base[i] + plan[i]), state, largest)
    }
}
