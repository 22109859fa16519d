//! Controllers: from states and setpoints to wheel torques. They depend on the state, never on an engine.
//!
//! A feedback law is written once over lanes ([`Law`]); [`Controller`] is any law, for one robot or for eight.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod controllers;
mod parts;
pub mod reference;
mod registry;

pub use controllers::*;
pub use parts::delayed::DelayOptions;
pub use parts::lean_observer::ObserverOptions;
pub use parts::limits::{DEFAULT_TRACTION, LimitOptions, Limited, TorqueLimits};
pub use parts::rule_table::{RuleTable, SETS, memberships};
pub use parts::{common_lyapunov, riccati};
pub use reference::{Motion, Reference, Turning};
pub use registry::{
    ControllerKind, MakeController, NamedLaw, controller_kind, controller_kinds, fields_with, register_controller,
};

pub use ballbot_base::constants::{Constant, Constants};
pub use ballbot_base::setpoint::{LaneSetpoint, MOTION_PARTS, SETPOINT_PARTS, Setpoint};

use ballbot_base::error::{Result, check};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Eight, Kernel, Lane, Memory, Registers, Scalar, Wide, run_eight, run_one};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;
use ballbot_models::traction_torque;
use std::sync::atomic::{AtomicU64, Ordering};

/// A feedback law, written once over lanes.
///
/// ```
/// use ballbot_core::control::{
///     LaneSetpoint, Law, LimitOptions, NamedLaw, Sampling, Setpoint, TorqueLimits, controller_kind, register_controller,
/// };
/// use ballbot_core::fields::Limit;
/// use ballbot_core::kinematics::{Omniwheels, TorqueMap};
/// use ballbot_core::lanes::{Lane, Memory};
/// use ballbot_core::nalgebra::Vector3;
/// use ballbot_core::{LaneState, Params, Result, State, Wheels};
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
///     limits: TorqueLimits,
///     sampling: Sampling,
/// }
///
/// impl NamedLaw for Upright {
///     const NAME: &'static str = "upright";
///     const SUMMARY: &'static str = "PD of the tilt.";
///     const LABEL: &'static str = "PD";
///     const LIMITS: LimitOptions = LimitOptions::CAP;
///     type Options = Gains;
///
///     fn with_options(params: &Params, control_dt: f64, gains: &Gains, limits: &LimitOptions) -> Result<Self> {
///         let wheels = Omniwheels::new(params);
///         Ok(Self {
///             gains: gains.clone(),
///             wheels: [Vector3::x(), Vector3::y()].map(|axis| wheels.wheel_torques(&axis, TorqueMap::Consistent)),
///             limits: TorqueLimits::new(params, limits)?,
///             sampling: Sampling::new(control_dt, Self::MEMORY),
///         })
///     }
/// }
///
/// impl Law for Upright {
///     const MEMORY: usize = 0;
///     const PARTS: &'static [&'static str] = &[];
///
///     fn sampling(&self) -> &Sampling {
///         &self.sampling
///     }
///
///     fn sampling_mut(&mut self) -> &mut Sampling {
///         &mut self.sampling
///     }
///
///     fn torques<L: Lane>(
///         &self,
///         state: &LaneState<L>,
///         _: &LaneSetpoint<L>,
///         largest: f64,
///         _: &mut Memory<'_, L>,
///     ) -> Wheels<L> {
///         let [tilt_x, tilt_y] = state.body_quaternion.tilt_components();
///         let rate = state.body_angular_velocity;
///         let x = tilt_x * -self.gains.tilt - rate.x * self.gains.rate;
///         let y = tilt_y * -self.gains.tilt - rate.y * self.gains.rate;
///         let wheel = |i: usize| x * self.wheels[0][i] + y * self.wheels[1][i];
///         self.limits.apply(Wheels::from_fn(wheel), state, largest).torques
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
    /// Number of values that it stores per robot from one call to the next; initially zero.
    const MEMORY: usize;

    /// [`Law::MEMORY`] for a law in which it depends on the options.
    fn kept(&self) -> usize {
        Self::MEMORY
    }

    /// The parts of a setpoint that it follows, of [`SETPOINT_PARTS`].
    const PARTS: &'static [&'static str];

    /// Common data of all laws.
    fn sampling(&self) -> &Sampling;

    /// Common data of all laws, mutable.
    fn sampling_mut(&mut self) -> &mut Sampling;

    /// Numbers from which it computes torques; `None` for a law that does not provide them.
    fn constants(&self) -> Option<Constants> {
        None
    }

    /// Motor torques for the next `control_dt`, N·m; torques above `largest` are not applied.
    fn torques<L: Lane>(
        &self,
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        largest: f64,
        memory: &mut Memory<'_, L>,
    ) -> Wheels<L>;
}

/// Common data of all laws: the sampling time, and the stored values of the robot of [`Controller::wheel_torques`].
#[derive(Debug)]
pub struct Sampling {
    id: u64,
    control_dt: f64,
    memory: Vec<f64>,
}

impl Sampling {
    /// For a law with `memory` numbers, sampled every `control_dt` seconds.
    pub fn new(control_dt: f64, memory: usize) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        Self { id: NEXT.fetch_add(1, Ordering::Relaxed), control_dt, memory: vec![0.0; memory] }
    }
}

/// A clone is another controller: stored values of a robot are not shared.
impl Clone for Sampling {
    fn clone(&self) -> Self {
        Self::new(self.control_dt, self.memory.len())
    }
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

    /// Forgets the past of the robot of [`Controller::wheel_torques`].
    fn reset(&mut self);

    /// Motor torques for the next `control_dt`, N·m.
    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> Wheels<f64>;

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
    ) -> Wheels<Eight>;
}

impl<T: Law> Controller for T {
    fn id(&self) -> u64 {
        self.sampling().id
    }

    fn control_dt(&self) -> f64 {
        self.sampling().control_dt
    }

    fn parts(&self) -> &'static [&'static str] {
        T::PARTS
    }

    fn memory_len(&self) -> usize {
        self.kept()
    }

    fn constants(&self) -> Option<Constants> {
        Law::constants(self)
    }

    fn reset(&mut self) {
        self.sampling_mut().memory.fill(0.0);
    }

    fn wheel_torques(&mut self, state: &State, setpoint: &Setpoint) -> Wheels<f64> {
        let mut memory = std::mem::take(&mut self.sampling_mut().memory);
        let torques = self.torques_one(&state.into(), &setpoint.into(), f64::INFINITY, &mut memory);
        self.sampling_mut().memory = memory;
        torques
    }

    fn torques_one(
        &self,
        state: &LaneState<f64>,
        setpoint: &LaneSetpoint<f64>,
        largest: f64,
        memory: &mut [f64],
    ) -> Wheels<f64> {
        run_one(
            #[inline(always)]
            || {
                let mut memory = Memory::<f64>::new(Scalar, memory);
                self.torques(state, setpoint, largest, &mut memory)
            },
        )
    }

    fn torques_eight(
        &self,
        states: &LaneState<Eight>,
        setpoints: &LaneSetpoint<Eight>,
        largest: f64,
        memory: &mut [Eight],
    ) -> Wheels<Eight> {
        let mut torques = Wheels::default();
        run_eight(Torques { law: self, states, setpoints, largest, memory, torques: &mut torques });
        torques
    }
}

struct Torques<'a, T> {
    law: &'a T,
    states: &'a LaneState<Eight>,
    setpoints: &'a LaneSetpoint<Eight>,
    largest: f64,
    memory: &'a mut [Eight],
    torques: &'a mut Wheels<Eight>,
}

impl<T: Law> Kernel for Torques<'_, T> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let mut memory = Memory::<Wide<S>>::new(simd, self.memory);
        let (state, setpoint) = (self.states.load(simd), self.setpoints.load(simd));
        self.law.torques(&state, &setpoint, self.largest, &mut memory).store(self.torques);
    }

    fn run_one_by_one(self) {
        let mut one = vec![0.0; self.memory.len()];
        for i in 0..ballbot_base::lanes::EIGHT {
            one.iter_mut().zip(&*self.memory).for_each(|(one, all)| *one = all.0[i]);
            let torques = self.law.torques_one(&self.states.lane(i), &self.setpoints.lane(i), self.largest, &mut one);
            self.torques.iter_mut().zip(torques).for_each(|(all, torque)| all.0[i] = torque);
            self.memory.iter_mut().zip(&one).for_each(|(all, one)| all.0[i] = *one);
        }
    }
}

/// Cells on which a controller can run.
pub trait LaneWidth: Sized {
    /// Torques of the robots in these cells, none applied above `largest` (N·m).
    fn torques(
        controller: &dyn Controller,
        states: &LaneState<Self>,
        setpoints: &LaneSetpoint<Self>,
        largest: f64,
        memory: &mut [Self],
    ) -> Wheels<Self>;

    /// Replaces the setpoint of one robot.
    fn set_setpoint(setpoints: &mut LaneSetpoint<Self>, index: usize, one: &Setpoint);
}

impl LaneWidth for f64 {
    fn torques(
        controller: &dyn Controller,
        states: &LaneState<f64>,
        setpoints: &LaneSetpoint<f64>,
        largest: f64,
        memory: &mut [f64],
    ) -> Wheels<f64> {
        controller.torques_one(states, setpoints, largest, memory)
    }

    fn set_setpoint(setpoints: &mut LaneSetpoint<f64>, _: usize, one: &Setpoint) {
        *setpoints = one.into();
    }
}

impl LaneWidth for Eight {
    fn torques(
        controller: &dyn Controller,
        states: &LaneState<Eight>,
        setpoints: &LaneSetpoint<Eight>,
        largest: f64,
        memory: &mut [Eight],
    ) -> Wheels<Eight> {
        controller.torques_eight(states, setpoints, largest, memory)
    }

    fn set_setpoint(setpoints: &mut LaneSetpoint<Eight>, index: usize, one: &Setpoint) {
        setpoints.set_lane(index, &one.into());
    }
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
