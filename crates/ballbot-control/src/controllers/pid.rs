//! The paper's controller (section III-A): a PID with filtered derivative on each tilt component.

use crate::parts::balance_frame::BalanceFrame;
use crate::{Constants, Law, LimitOptions, Limited, NamedLaw, Plant, Sample, Sampled};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::kinematics::{Omniwheels, TorqueMap};
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;

ballbot_base::fields! {
    /// Gains of C(s) = k_p + k_i / s + k_d N s / (s + N), from tilt error to virtual torque. Defaults from the paper
    /// (section III-A).
    #[derive(Copy)]
    pub struct PidGains {
        /// k_p.
        pub proportional: f64 = 20.39, "N·m/rad", Limit::from(0.0).to(1e9);
        /// k_i.
        pub integral: f64 = 56.57, "N·m/(rad·s)", Limit::from(0.0).to(1e9);
        /// k_d.
        pub derivative: f64 = 1.34, "N·m·s/rad", Limit::from(0.0).to(1e9);
        /// N, the bandwidth of the derivative filter.
        pub filter_coefficient: f64 = 327.0, "rad/s", Limit::above(0.0).to(1e9);
    }
}

/// Two PID controllers, about the x and y axes of the heading frame. They control only the tilt: nothing holds the
/// ball's position or the heading. The tilt is relative to the equilibrium: the tilt of the line from the ball's center
/// to the body's center of mass. The design is for a level floor: on a slope the ball rolls away.
#[derive(Clone, Debug)]
pub struct Pid {
    /// Wheel torques per virtual torque about x and y.
    map: Wheels<[f64; 2]>,
    frame: BalanceFrame,
    gains: PidGains,
    /// Fraction of the distance to the error that the derivative filter covers in a sample; exact for a held error.
    filter_share: f64,
}

/// Stored values of a robot after the integrals of the errors: states of the derivative filters, and whether the filters
/// are initialized. A filter starts at the first error, so that a start away from the setpoint is not a step.
const FILTERED: [usize; 2] = [2, 3];
const STARTED: usize = 4;

impl NamedLaw for Pid {
    const NAME: &'static str = "pid";
    const SUMMARY: &'static str = "The paper's PID of the tilt; nothing holds the ball's position or the heading.";
    const LABEL: &'static str = "PID";
    const CONTROL_DT: Option<f64> = Some(Self::PAPER_CONTROL_DT);
    const LIMITS: LimitOptions = LimitOptions::CAP;
    type Options = PidGains;

    fn design(plant: &Plant<'_>, gains: &PidGains) -> Result<Self> {
        Self::of_map(plant, gains, TorqueMap::Consistent)
    }
}

impl Pid {
    /// Sampling time of the paper's gains, s: their derivative filter of 327 rad/s is unstable above about 9.9 ms
    /// (docs/paper.md).
    pub const PAPER_CONTROL_DT: f64 = 0.002;

    /// [`Pid::with_map`] with the limits [`LimitOptions::CAP`].
    ///
    /// # Errors
    /// As [`Pid::with_map`].
    pub fn new(params: &Params, control_dt: f64, gains: &PidGains, map: TorqueMap) -> Result<Sampled<Self>> {
        Self::with_map(params, control_dt, gains, map, &LimitOptions::CAP)
    }

    /// A PID with the wheel torques of a map.
    ///
    /// # Errors
    /// As [`Sampled::new`] and [`TorqueMap::require`].
    pub fn with_map(
        params: &Params,
        control_dt: f64,
        gains: &PidGains,
        map: TorqueMap,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        Sampled::new(params, control_dt, gains, limits, |plant, gains| Self::of_map(plant, gains, map))
    }

    fn of_map(&Plant { params, control_dt, .. }: &Plant<'_>, gains: &PidGains, map: TorqueMap) -> Result<Self> {
        map.require(params)?;
        let wheels = Omniwheels::new(params);
        let frame = BalanceFrame::new(params);
        let column = |axis: Vector3<f64>| wheels.torques_on_body(&frame.in_body(&axis), map);
        let (about_x, about_y) = (column(Vector3::x()), column(Vector3::y()));
        Ok(Self {
            map: Wheels::from_fn(|i| [about_x[i], about_y[i]]),
            frame,
            filter_share: 1.0 - (-gains.filter_coefficient * control_dt).exp(),
            gains: *gains,
        })
    }

    /// Virtual torque for a tilt error about one axis of the heading frame, before any limit, N·m; updates the filter.
    #[inline(always)]
    fn virtual_torque<L: Lane>(&self, axis: usize, error: L, started: L::Mask, memory: &mut Memory<'_, L>) -> L {
        let g = &self.gains;
        let filtered = L::select(started, memory.get(FILTERED[axis]), error);
        let lag = error - filtered;
        memory.set(FILTERED[axis], lag.mul_add_all(self.filter_share, filtered));
        let derivative = lag * (g.derivative * g.filter_coefficient);
        error * g.proportional + memory.get(axis) * g.integral + derivative
    }
}

impl Law for Pid {
    const MEMORY: usize = 5;
    const PARTS: &'static [&'static str] = &["tilt"];

    fn constants(&self) -> Option<Constants> {
        let g = &self.gains;
        let constants = self
            .frame
            .add_to(Constants::default())
            .matrix("torques_of_virtual", &self.map.0)
            .number("proportional", g.proportional)
            .number("integral", g.integral)
            .number("filtered_derivative", g.derivative * g.filter_coefficient)
            .number("filter_share", self.filter_share);
        Some(constants)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let (attitude, goal) = (self.frame.attitude(sample.state.body_quaternion), sample.setpoint.tilt);
        let heading = Heading::new(attitude);
        let [tilt_x, tilt_y] = attitude.tilt_components();
        let [tilt_x, tilt_y] = heading.of(tilt_x, tilt_y);
        let errors = [goal[0] - tilt_x, goal[1] - tilt_y];
        let zero = tilt_x.zero();
        let memory = &mut sample.memory;
        let started = zero.lt(memory.get(STARTED));
        memory.set(STARTED, zero.splat(1.0));
        let x = self.virtual_torque(0, errors[0], started, memory);
        let y = self.virtual_torque(1, errors[1], started, memory);
        let desired = self.map.map(|[of_x, of_y]| x * of_x + y * of_y);
        let Limited { torques, share, .. } = sample.limited(desired);
        sample.integrate(errors, share);
        torques
    }
}
