//! Controllers: from states and setpoints to wheel torques. They depend on the state, never on an engine.
//!
//! A feedback law is written once over lanes ([`Law`]); [`Controller`] is any law, for one robot or for eight.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod controllers;
mod parts;
pub mod reference;
mod registry;
mod sampled;

pub use controllers::*;
pub use parts::delayed::DelayOptions;
pub use parts::lean_observer::ObserverOptions;
pub use parts::limits::{DEFAULT_TRACTION, LEAST_LOAD, LimitOptions, Limited, TorqueLimits};
pub use parts::moving_frame::{Followed, MovingFrame};
pub use parts::rule_table::{RuleTable, SETS, memberships};
pub use parts::{common_lyapunov, riccati};
pub use reference::{Motion, Reference, Turning};
pub use registry::{
    ControllerKind, MakeController, NamedLaw, controller_kind, controller_kinds, fields_with, register_controller,
};
pub use sampled::{Plant, Sample, Sampled};

pub use ballbot_base::constants::{Constant, Constants};
pub use ballbot_base::setpoint::{LaneSetpoint, MOTION_PARTS, SETPOINT_PARTS, Setpoint};

use ballbot_base::error::{Result, check};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{EIGHT, Eight, Lane};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;
use ballbot_models::traction_torque;

/// A feedback law, written once over lanes; [`Sampled`] is the controller.
///
/// ```
/// use ballbot_core::control::{
///     LimitOptions, Law, NamedLaw, Plant, Sample, Setpoint, controller_kind, register_controller,
/// };
/// use ballbot_core::fields::Limit;
/// use ballbot_core::kinematics::{Omniwheels, TorqueMap};
/// use ballbot_core::lanes::Lane;
/// use ballbot_core::nalgebra::Vector3;
/// use ballbot_core::{Params, Result, State, Wheels};
///
/// ballbot_core::fields! {
///     /// Gains.
///     pub struct Gains {
///         /// Torque for a tilt.
///         pub tilt: f64 = 20.0, "N·m/rad", Limit::NOT_NEGATIVE;
///         /// Torque for a tilt rate.
///         pub rate: f64 = 1.3, "N·m·s/rad", Limit::NOT_NEGATIVE;
///     }
/// }
///
/// /// PD of the tilt.
/// struct Upright {
///     gains: Gains,
///     /// Wheel torques for torques of 1 N·m about x and y.
///     wheels: [Wheels<f64>; 2],
/// }
///
/// impl NamedLaw for Upright {
///     const NAME: &'static str = "upright";
///     const SUMMARY: &'static str = "PD of the tilt.";
///     const LABEL: &'static str = "PD";
///     const LIMITS: LimitOptions = LimitOptions::CAP;
///     type Options = Gains;
///
///     fn design(plant: &Plant<'_>, gains: &Gains) -> Result<Self> {
///         let wheels = Omniwheels::new(plant.params);
///         let wheels = [Vector3::x(), Vector3::y()].map(|axis| wheels.wheel_torques(&axis, TorqueMap::Consistent));
///         Ok(Self { gains: gains.clone(), wheels })
///     }
/// }
///
/// impl Law for Upright {
///     const PARTS: &'static [&'static str] = &[];
///
///     fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
///         let [tilt_x, tilt_y] = sample.state.body_quaternion.tilt_components();
///         let rate = sample.state.body_angular_velocity;
///         let x = tilt_x * -self.gains.tilt - rate.x * self.gains.rate;
///         let y = tilt_y * -self.gains.tilt - rate.y * self.gains.rate;
///         sample.limited(Wheels::from_fn(|i| x * self.wheels[0][i] + y * self.wheels[1][i])).torques
///     }
/// }
///
/// register_controller(Upright::KIND)?;
///
/// let params = Params::paper();
/// let kind = controller_kind("upright")?;
/// let mut upright = (kind.make)(&params, 0.01, &kind.limits, &[("rate", &[1.5])])?;
/// let torques = upright.wheel_torques(&State::tilted(&params, [0.1, 0.0].into(), 0.0), &Setpoint::default());
/// assert!(torques.iter().any(|torque| torque.abs() > 0.1));
/// # Ok::<(), ballbot_core::Error>(())
/// ```
pub trait Law: Send + Sync {
    /// Number of values that it stores per robot from one sample to the next; initially zero.
    const MEMORY: usize = 0;

    /// [`Law::MEMORY`], or more with options that need more; the law then has no [`Controller::constants`].
    fn kept(&self) -> usize {
        Self::MEMORY
    }

    /// The parts of a setpoint that it follows, of [`SETPOINT_PARTS`].
    const PARTS: &'static [&'static str];

    /// Numbers from which it computes torques; `None` for a law that does not provide them. [`Controller::constants`]
    /// adds the limits.
    fn constants(&self) -> Option<Constants> {
        None
    }

    /// Index of the first of two stored numbers that are its estimate of the horizontal external force on the body,
    /// inertial frame, N; `None` without an estimate.
    fn force_index(&self) -> Option<usize> {
        None
    }

    /// Standard deviation of that estimate along x and y of the heading frame, N, by white noise of the measured lean, ball
    /// velocity and lean rate with these standard deviations (rad, m/s, rad/s).
    fn force_deviation(&self, _noise: &[f64; 3]) -> Option<[f64; 2]> {
        None
    }

    /// Motor torques until the next sample, within the limits of the sample ([`Sample::limited`]), N·m.
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L>;
}

/// Any feedback law, sampled every `control_dt`.
pub trait Controller: Send + Sync {
    /// Unique number of this controller.
    fn id(&self) -> u64;

    /// Time between two calls of [`Controller::wheel_torques`], s.
    fn control_dt(&self) -> f64;

    /// The parts of a setpoint that it follows.
    fn parts(&self) -> &'static [&'static str];

    /// Number of values that it stores per robot.
    fn memory_len(&self) -> usize;

    /// Numbers from which it computes torques; `None` for a law that does not provide them.
    fn constants(&self) -> Option<Constants> {
        None
    }

    /// As [`Law::force_index`].
    fn force_index(&self) -> Option<usize> {
        None
    }

    /// As [`Law::force_deviation`].
    fn force_deviation(&self, _noise: &[f64; 3]) -> Option<[f64; 2]> {
        None
    }

    /// The stored values of the robot of [`Controller::wheel_torques`], [`Controller::memory_len`] of them.
    fn memory_mut(&mut self) -> &mut Vec<f64>;

    /// Forgets the past of the robot of [`Controller::wheel_torques`].
    fn reset(&mut self) {
        self.memory_mut().fill(0.0);
    }

    /// Motor torques for the next `control_dt`, N·m.
    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> Wheels<f64> {
        let mut memory = std::mem::take(self.memory_mut());
        let torques = self.torques_one(&state.into(), &setpoint.into(), f64::INFINITY, &mut memory);
        *self.memory_mut() = memory;
        torques
    }

    /// [`Controller::wheel_torques`] of a robot whose stored values the caller keeps. Applies no torque above `largest`
    /// (N·m).
    fn torques_one(
        &self,
        state: &LaneState<f64>,
        setpoint: &LaneSetpoint<f64>,
        largest: f64,
        memory: &mut [f64],
    ) -> Wheels<f64>;

    /// [`Controller::torques_one`] for eight robots.
    fn torques_eight(
        &self,
        states: &LaneState<Eight>,
        setpoints: &LaneSetpoint<Eight>,
        largest: f64,
        memory: &mut [Eight],
    ) -> Wheels<Eight> {
        self.torques_one_by_one(states, setpoints, largest, memory)
    }

    /// [`Controller::torques_eight`] by eight calls of [`Controller::torques_one`].
    fn torques_one_by_one(
        &self,
        states: &LaneState<Eight>,
        setpoints: &LaneSetpoint<Eight>,
        largest: f64,
        memory: &mut [Eight],
    ) -> Wheels<Eight> {
        let (mut torques, mut one) = (Wheels::<Eight>::default(), vec![0.0; memory.len()]);
        for i in 0..EIGHT {
            one.iter_mut().zip(&*memory).for_each(|(one, all)| *one = all.0[i]);
            let found = self.torques_one(&states.lane(i), &setpoints.lane(i), largest, &mut one);
            torques.iter_mut().zip(found).for_each(|(all, torque)| all.0[i] = torque);
            memory.iter_mut().zip(&one).for_each(|(all, one)| all.0[i] = *one);
        }
        torques
    }
}

/// [`Controller::torques_one`] or [`Controller::torques_eight`].
pub type TorquesOf<C> = fn(&dyn Controller, &LaneState<C>, &LaneSetpoint<C>, f64, &mut [C]) -> Wheels<C>;

/// Cells on which a controller can run.
pub trait LaneWidth: Sized {
    /// Torques of the robots in these cells.
    const TORQUES: TorquesOf<Self>;
}

impl LaneWidth for f64 {
    const TORQUES: TorquesOf<f64> =
        |law, states, setpoints, largest, memory| law.torques_one(states, setpoints, largest, memory);
}

impl LaneWidth for Eight {
    const TORQUES: TorquesOf<Eight> =
        |law, states, setpoints, largest, memory| law.torques_eight(states, setpoints, largest, memory);
}

/// Longest time between two calls of a controller, s.
const MAX_CONTROL_DT: f64 = 1e3;

/// Returns the time between two calls of a controller if it is above 0 and at most 1000 s.
///
/// # Errors
/// [`ballbot_base::Error::OutOfRange`] otherwise.
pub fn check_control_dt(control_dt: f64) -> Result<f64> {
    let limit = format_args!("> 0 and <= {MAX_CONTROL_DT} s");
    check("control_dt", control_dt, limit, |dt| dt > 0.0 && dt <= MAX_CONTROL_DT)
}

/// Returns a limit of wheel torques if it is positive and within the motors' limit.
///
/// # Errors
/// [`ballbot_base::Error::OutOfRange`] otherwise.
pub fn check_max_torque(max_torque: f64, motor_torque: f64) -> Result<f64> {
    let limit = format_args!("above 0 and at most params.max_wheel_torque = {motor_torque} N·m");
    check("max_torque", max_torque, limit, |t| t > 0.0 && t <= motor_torque)
}

/// Fraction of the robot's traction that a controller uses by default: the rest is for nonzero tilts and rates.
const TRACTION_SHARE: f64 = 0.9;

/// Default limit of wheel torques of controllers: 0.9 of [`traction_torque`], N·m. Above it a wheel slips, and a
/// controller that expects grip falls.
pub fn default_max_torque(params: &Params) -> f64 {
    TRACTION_SHARE * traction_torque(params)
}
