//! [`Sampled`]: a law as a [`Controller`]; [`Plant`]: what it is designed for; [`Sample`]: what it computes torques from.

use crate::parts::balance_frame::Pose;
use crate::parts::joint_friction::JointFriction;
use crate::parts::lean_planes::require_stable;
use crate::parts::riccati::dynamic;
use crate::{Constants, Controller, LaneSetpoint, Law, LimitOptions, Limited, TorqueLimits, check_control_dt};
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::Fields;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Eight, Kernel, Lane, Memory, Registers, Scalar, Wide, run_eight, run_one};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_models::linear::{INPUTS, STATES};
use ballbot_models::{LinearModel, Scale};
use nalgebra::{DMatrix, SMatrix};
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};

/// A robot that a law is designed for, from [`Sampled::new`]: its parameters, sampling time and limits are valid. Its
/// wheel joints have no friction: [`Sampled`] compensates the friction of the joints.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Plant<'a> {
    /// Parameters of the robot.
    pub params: &'a Params,
    /// Time between two samples, s.
    pub control_dt: f64,
    /// Limits of the torques.
    pub limits: &'a TorqueLimits,
    /// Dry friction of each wheel joint that [`Sampled`] compensates, N·m: not of a wheel at rest.
    pub dry_friction: f64,
}

impl Plant<'_> {
    /// A and B of the sampled linear model.
    pub(crate) fn sampled(&self) -> (SMatrix<f64, STATES, STATES>, SMatrix<f64, STATES, INPUTS>) {
        LinearModel::new(self.params).discretize(self.control_dt)
    }

    /// Checks that the sampled linear model is stable under τ = −K x.
    pub(crate) fn require_stable(&self, gain: &DMatrix<f64>) -> Result<()> {
        let (a, b) = self.sampled();
        let closed: SMatrix<f64, STATES, STATES> = a - b * gain;
        require_stable(dynamic(&closed), self.control_dt)
    }
}

/// The input of a law at one time: for one robot, or for eight.
pub struct Sample<'a, L: Lane> {
    /// The state.
    pub state: &'a LaneState<L>,
    /// The setpoint.
    pub setpoint: &'a LaneSetpoint<L>,
    /// Values that the law has stored for the robot.
    pub memory: Memory<'a, L>,
    /// Time until the next sample, s.
    pub control_dt: f64,
    pub(crate) limits: &'a TorqueLimits,
    pub(crate) largest: f64,
}

impl<L: Lane> Sample<'_, L> {
    /// The applied torques for the desired torques, as [`TorqueLimits::apply`].
    #[inline(always)]
    pub fn limited(&self, desired: Wheels<L>) -> Limited<L> {
        self.limits.apply(desired, self.state, self.largest)
    }

    /// [`Sample::limited`] for a robot with known pose.
    #[inline(always)]
    pub(crate) fn limited_at(&self, desired: Wheels<L>, pose: &Pose<L>) -> Limited<L> {
        self.limits.apply_at(desired, self.state, pose, self.largest)
    }

    /// Largest torque of a wheel in this sample, N·m.
    #[inline(always)]
    pub fn max_torque(&self) -> f64 {
        self.limits.max_torque().min(self.largest)
    }

    /// Adds errors, times the sampling time, to the integrals in the first numbers of the memory. Limited torques, of
    /// which the fraction `share` is left, hold the integrals: they cannot act on them.
    #[inline(always)]
    pub(crate) fn integrate(&mut self, errors: [L; 2], share: L) {
        let held = share.lt(share.splat(1.0));
        for (axis, error) in errors.into_iter().enumerate() {
            let integral = self.memory.get(axis);
            let next = error.mul_add_all(self.control_dt, integral);
            self.memory.set(axis, L::select(held, integral, next));
        }
    }
}

/// A law as a [`Controller`]: with a sampling time, limits of its torques, compensation of the friction of the wheel
/// joints at their present speeds, and the stored values of the robot of [`Controller::wheel_torques`].
#[derive(Debug)]
pub struct Sampled<T> {
    law: T,
    id: u64,
    pub(crate) control_dt: f64,
    pub(crate) limits: TorqueLimits,
    friction: JointFriction,
    memory: Vec<f64>,
}

/// The error of a design, with the sampling time if it is too long for the robot.
fn with_sampling(error: Error, params: &Params, control_dt: f64) -> Error {
    // Within a sample the lean grows tenfold.
    const GROWTH: f64 = 10.0;
    let rate = LinearModel::new(params).toppling_squared().sqrt();
    match error {
        Error::Riccati(reason) if (rate * control_dt).exp() > GROWTH => Error::Riccati(format!(
            "control_dt = {control_dt} s is too long for a robot that topples within {:.2} s ({reason})",
            rate.recip()
        )),
        other => other,
    }
}

impl<T: Law> Sampled<T> {
    /// The law that `design` returns for `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// Invalid parameters, sampling time, options or limits; errors of `design`.
    pub fn new<O: Fields>(
        params: &Params,
        control_dt: f64,
        options: &O,
        limits: &LimitOptions,
        design: impl FnOnce(&Plant<'_>, &O) -> Result<T>,
    ) -> Result<Self> {
        params.validate()?;
        check_control_dt(control_dt)?;
        let options = Scale::of(params).fit(options);
        options.check_limits()?;
        let (friction, params) = JointFriction::of(params);
        let limits = TorqueLimits::new(&params, control_dt, limits)?;
        let law =
            design(&Plant { params: &params, control_dt, limits: &limits, dry_friction: friction.dry() }, &options)
                .map_err(|error| with_sampling(error, &params, control_dt))?;
        Ok(Self::of(law, control_dt, limits, friction))
    }

    /// A law whose torques are limited to `max_torque` (N·m) alone, without compensation of the friction of the joints, as
    /// a policy that has learned to use its motors.
    ///
    /// # Errors
    /// Invalid parameters or sampling time; a largest torque beyond the motors' limit.
    pub fn uncompensated(law: T, params: &Params, control_dt: f64, max_torque: f64) -> Result<Self> {
        params.validate()?;
        check_control_dt(control_dt)?;
        let limits = TorqueLimits::new(params, control_dt, &LimitOptions::capped(max_torque))?;
        let (_, without_friction) = JointFriction::of(params);
        Ok(Self::of(law, control_dt, limits, JointFriction::of(&without_friction).0))
    }

    fn of(law: T, control_dt: f64, limits: TorqueLimits, friction: JointFriction) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let memory = vec![0.0; law.kept()];
        Self { law, id: NEXT.fetch_add(1, Ordering::Relaxed), control_dt, limits, friction, memory }
    }

    #[inline(always)]
    fn torques<L: Lane>(
        &self,
        token: L::Token,
        state: &LaneState<L::Cell>,
        setpoint: &LaneSetpoint<L::Cell>,
        largest: f64,
        memory: &mut [L::Cell],
    ) -> Wheels<L> {
        let state = &state.load(token);
        let mut sample = Sample {
            state,
            setpoint: &setpoint.load(token),
            memory: Memory::new(token, memory),
            control_dt: self.control_dt,
            limits: &self.limits,
            largest,
        };
        let torques = self.law.torques(&mut sample);
        self.friction.compensated(torques, &state.wheel_speeds, sample.max_torque())
    }
}

/// A clone is another controller: stored values of a robot are not shared.
impl<T: Law + Clone> Clone for Sampled<T> {
    fn clone(&self) -> Self {
        Self::of(self.law.clone(), self.control_dt, self.limits.clone(), self.friction)
    }
}

impl<T> Deref for Sampled<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.law
    }
}

impl<T: Law> Controller for Sampled<T> {
    fn id(&self) -> u64 {
        self.id
    }

    fn control_dt(&self) -> f64 {
        self.control_dt
    }

    fn parts(&self) -> &'static [&'static str] {
        T::PARTS
    }

    fn memory_len(&self) -> usize {
        self.law.kept()
    }

    fn constants(&self) -> Option<Constants> {
        let constants = if self.law.kept() > T::MEMORY { None } else { self.law.constants() };
        constants.map(|constants| self.friction.add_to(self.limits.add_to(constants)))
    }

    fn force_index(&self) -> Option<usize> {
        self.law.force_index()
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.law.force_deviation(noise)
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
        run_one(
            #[inline(always)]
            || self.torques::<f64>(Scalar, state, setpoint, largest, memory),
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
    law: &'a Sampled<T>,
    states: &'a LaneState<Eight>,
    setpoints: &'a LaneSetpoint<Eight>,
    largest: f64,
    memory: &'a mut [Eight],
    torques: &'a mut Wheels<Eight>,
}

impl<T: Law> Kernel for Torques<'_, T> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        let Self { law, states, setpoints, largest, memory, torques } = self;
        law.torques::<Wide<S>>(simd, states, setpoints, largest, memory).store(torques);
    }

    fn run_one_by_one(self) {
        let Self { law, states, setpoints, largest, memory, torques } = self;
        *torques = law.torques_one_by_one(states, setpoints, largest, memory);
    }
}
