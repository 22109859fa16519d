//! Nonlinear model predictive control.

use super::descent::{Descent, Problem};
use super::horizon::{Horizon, Workspaces, can_be_simulated, shift};
use crate::control::{
    Controller, LaneSetpoint, LimitOptions, Lqr, LqrWeights, MOTION_PARTS, Sampled, Setpoint, TorqueLimits,
};
use ballbot_base::error::Result;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::Scale;

crate::fields! {
    /// Deviations of equal cost, as in [`LqrWeights`], and the horizon and iterations of [`Nmpc`].
    #[derive(Copy)]
    pub struct NmpcOptions {
        /// Deviation of the ball position.
        pub position: f64 = 0.15, "m", Limit::from(1e-6).to(1e6);
        /// Deviation of the ball velocity.
        pub velocity: f64 = 0.4, "m/s", Limit::from(1e-6).to(1e6);
        /// Tilt.
        pub tilt: f64 = 0.1, "rad", Limit::from(1e-6).to(1e6);
        /// Tilt rate.
        pub tilt_rate: f64 = 1.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Deviation of the heading.
        pub yaw: f64 = 0.5, "rad", Limit::from(1e-6).to(1e6);
        /// Rate of the heading.
        pub yaw_rate: f64 = 2.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Wheel torque.
        pub torque: f64 = 0.2, "N·m", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest lean that deviations of position and velocity may command.
        pub max_lean: f64 = 0.226_892_802_759_262_85, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
        /// Violation of the limit of a load or traction at one decision, as a fraction of a wheel's load in equilibrium.
        pub violation: f64 = 0.02, "", Limit::from(1e-3).to(1e3);
        /// How far a motion looks ahead.
        pub horizon: f64 = 0.6, "s", Limit::from(1e-3).to(10.0), scaled;
        /// Longest time step of the simulation in it.
        pub step: f64 = 0.005, "s", Limit::from(1e-4).to(0.02), scaled;
        /// Most improvements of the plan in a call, rounded.
        pub iterations: f64 = 2.0, "", Limit::from(1.0).to(1_000.0);
    }
}

impl NmpcOptions {
    /// The weights of the regulator.
    pub fn weights(&self) -> LqrWeights {
        let Self { position, velocity, tilt, tilt_rate, yaw, yaw_rate, torque, max_lean, max_speed, .. } = *self;
        LqrWeights { position, velocity, tilt, tilt_rate, yaw, yaw_rate, torque, max_lean, max_speed }
    }
}

/// Nonlinear model predictive control on the model `contact`, by iterative linear-quadratic regulators with limits
/// (Tassa, Mansard, Todorov, "Control-limited differential dynamic programming", ICRA 2014).
///
/// Torques are the torques of [`Lqr`], with the larger `max_lean` of [`Mpc`](crate::control::Mpc), plus a plan δ, within
/// [`TorqueLimits::nearest`](crate::control::TorqueLimits::nearest). In each call the motion under the regulator and δ
/// is simulated from the robot's state and differentiated, exactly while the wheels roll; a backward sweep finds the change
/// of its torques, which a line search shortens until the cost falls. The cost is the cost of the regulator along the
/// motion, its cost-to-go at the end, and the violations of the limits by loads and tractions in the last time step before
/// each decision. A motion that ends in a fall is improved up to the fall. The setpoint is extrapolated over the horizon by
/// its derivatives; the model has a level floor, on which the robot rolls at first, and no friction of the wheel joints,
/// which the regulator compensates.
#[derive(Debug)]
pub struct Nmpc {
    /// The regulator of the robot, with the friction of its joints.
    base: Sampled<Lqr>,
    problem: Problem,
    iterations: usize,
    memory: Vec<f64>,
    room: Workspaces<Descent>,
}

impl Nmpc {
    /// Default time between two calls, s.
    pub const CONTROL_DT: f64 = 0.01;

    /// A controller for `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for an option out of range, a horizon that is shorter than `control_dt` or has more
    /// than 500 decisions; errors of [`Lqr::with_weights`](crate::control::Lqr::with_weights).
    pub fn with_options(
        params: &Params,
        control_dt: f64,
        options: &NmpcOptions,
        limits: &LimitOptions,
    ) -> Result<Self> {
        params.validate()?;
        let options = Scale::of(params).fit(options);
        options.check_limits()?;
        let (weights, seconds) = (options.weights(), options.horizon);
        let base = Lqr::with_weights(params, control_dt, &weights, limits)?;
        // As of the laws: the friction of the joints is compensated.
        let smooth = Params { wheel_viscous_friction: 0.0, wheel_coulomb_friction: 0.0, ..params.clone() };
        // The plan may use all friction, at the cost of a violation.
        let whole = LimitOptions { traction: limits.traction.map(|_| 1.0), ..*limits };
        let horizon = Horizon {
            limits: TorqueLimits::new(&smooth, control_dt, &whole)?,
            ..Horizon::new(&smooth, control_dt, seconds, &weights, limits)?
        };
        let memory = vec![0.0; WHEELS * horizon.decisions];
        Ok(Self {
            problem: Problem::new(&smooth, horizon, options.step, limits.traction, options.violation),
            iterations: options.iterations.round() as usize,
            base,
            memory,
            room: Workspaces::new(),
        })
    }
}

impl Controller for Nmpc {
    fn id(&self) -> u64 {
        self.base.id()
    }

    fn control_dt(&self) -> f64 {
        self.base.control_dt()
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
        // Diverged robots are not simulated further.
        if !can_be_simulated(state, &base) {
            memory.fill(0.0);
            return base;
        }
        shift(memory);
        let (problem, start, target) = (&self.problem, State::from(*state), Setpoint::from(setpoint));
        self.room.with(
            || Descent::new(problem),
            |descent| descent.improve(problem, &start, &target, largest, self.iterations, memory),
        );
        self.problem.limited(base, Wheels::from_fn(|i| base[i] + memory[i]), state, largest)
    }
}
