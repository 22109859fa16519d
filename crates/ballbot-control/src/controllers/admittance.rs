//! Yielding to an external force: a virtual mass and damping above the linear-quadratic regulator.

use crate::parts::delayed::DelayOptions;
use crate::parts::joined::joined_fields;
use crate::parts::joint_friction::JointFriction;
use crate::parts::outer::share_within;
use crate::{LaneSetpoint, Law, Lqr, LqrOptions, LqrWeights, MOTION_PARTS, NamedLaw, ObserverOptions, Plant, Sample};
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;

ballbot_base::fields! {
    /// How [`Admittance`] yields.
    #[derive(Copy)]
    pub struct Yielding {
        /// Virtual mass, which a force accelerates.
        pub virtual_mass: f64 = 4.0, "kg", Limit::from(1e-6).to(1e6), scaled;
        /// Virtual damping: a constant force moves the robot at the force over it.
        pub virtual_damping: f64 = 4.0, "N·s/m", Limit::from(1e-6).to(1e6), scaled;
        /// Part of a force that moves nothing, against drift by errors of model and sensors; the dry friction of wheels at rest is
        /// added.
        pub deadband: f64 = 0.2, "N", Limit::NOT_NEGATIVE.to(1e6), scaled;
        /// Largest speed at which it yields.
        pub yield_speed: f64 = 0.6, "m/s", Limit::NOT_NEGATIVE.to(1e6), scaled;
        /// Largest acceleration at which it yields.
        pub yield_acceleration: f64 = 0.4, "m/s²", Limit::from(1e-6).to(1e6), scaled;
        /// Rate at which the force and the lean in equilibrium are estimated.
        pub force_observer: f64 = 3.0, "1/s", Limit::from(1e-3).to(1e3), scaled;
    }
}

joined_fields! {
    /// Options of [`Admittance`]: how it yields, then the weights of the regulator and the delay of the motors.
    pub struct AdmittanceOptions {
        /// How it yields.
        pub yielding: Yielding,
        /// Deviations of equal cost of the regulator.
        pub weights: LqrWeights,
        /// Delay of the prediction.
        pub delay: DelayOptions,
    }
}

/// Indices of its numbers, vectors of the inertial frame: how far it has yielded, m, and its velocity, m/s.
const MOVED: usize = 0;
const VELOCITY: usize = 2;

/// Admittance (Hogan 1985): the estimated external force moves a virtual mass with damping, m v̇ = F − d v, whose motion
/// is added to the setpoint of an [`Lqr`]. So the robot is led by the hand, and stays where it is left.
///
/// The force is estimated with the lean in equilibrium (`lean_observer` of [`Lqr`]); the regulator leans against it, and
/// yields only by this law. A slope is not distinguished from a force. The deadband is subtracted from the length of the force, and at
/// rest the force that the dry friction of the wheel joints may feign.
/// Speed and acceleration of the virtual mass are limited as vectors. Derived in `docs/laws.md`.
#[derive(Clone, Debug)]
pub struct Admittance {
    lqr: Lqr,
    /// Index of the force among the numbers of the regulator.
    force: usize,
    deadband: f64,
    /// Part of the deadband by the dry friction of each wheel at rest, N.
    friction: Wheels<f64>,
    /// Velocity per force, s/kg.
    mobility: f64,
    max_speed: f64,
    /// Largest change of the velocity in a sample, m/s.
    max_change: f64,
    /// Fraction of the way to the steady velocity in a sample, 1 − e^(−d T/m).
    share: f64,
}

impl NamedLaw for Admittance {
    const NAME: &'static str = "admittance";
    const SUMMARY: &'static str = "Yields to a force: a virtual mass and damping move the setpoint of a regulator.";
    const LABEL: &'static str = "Admittance";
    type Options = AdmittanceOptions;

    fn design(plant: &Plant<'_>, AdmittanceOptions { yielding, weights, delay }: &AdmittanceOptions) -> Result<Self> {
        let Yielding { virtual_mass, virtual_damping, deadband, yield_speed, yield_acceleration, force_observer } =
            *yielding;
        let observer = ObserverOptions { lean_observer: force_observer };
        let lqr = Lqr::design(plant, &LqrOptions { weights: *weights, delay: *delay, observer })?;
        let missing = || Error::Inconsistent("the regulator has no estimate of the force".into());
        Ok(Self {
            force: lqr.force_index().ok_or_else(missing)?,
            friction: feigned(lqr.force_per_torque().ok_or_else(missing)?, plant.dry_friction),
            lqr,
            deadband,
            mobility: virtual_damping.recip(),
            max_speed: yield_speed,
            max_change: yield_acceleration * plant.control_dt,
            share: -(-virtual_damping / virtual_mass * plant.control_dt).exp_m1(),
        })
    }
}

/// The part of each wheel in the largest force that dry friction of the joints, N·m, may feign.
fn feigned([x, y]: [Wheels<f64>; 2], dry: f64) -> Wheels<f64> {
    let sizes = Wheels::from_fn(|i| x[i].hypot(y[i]));
    let sum = |signs: usize, of: &Wheels<f64>| -> f64 {
        of.iter().enumerate().map(|(i, part)| if signs >> i & 1 == 1 { *part } else { -part }).sum()
    };
    let most = (0..8).map(|signs| sum(signs, &x).hypot(sum(signs, &y))).fold(0.0, f64::max);
    sizes * (dry * most / sizes.iter().sum::<f64>())
}

impl Law for Admittance {
    const MEMORY: usize = 4;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn kept(&self) -> usize {
        Self::MEMORY + self.lqr.kept()
    }

    fn force_index(&self) -> Option<usize> {
        Some(Self::MEMORY + self.force)
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.lqr.force_deviation(noise)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Sample { state, setpoint, control_dt: dt, limits, largest, .. } = *sample;
        let first = Self::MEMORY + self.force;
        let force = [sample.memory.get(first), sample.memory.get(first + 1)];
        let length = force[0].mul_add(force[0], force[1].squared()).sqrt();
        let (zero, least) = (length.zero(), length.splat(f64::MIN_POSITIVE));
        let mut deadband = length.splat(self.deadband);
        if self.friction[0] > 0.0 {
            for (speed, most) in state.wheel_speeds.into_iter().zip(self.friction) {
                deadband = JointFriction::dry_left(speed).mul_add_all(most, deadband);
            }
        }
        let mobility = (length - deadband).max(zero) / length.max(least) * self.mobility;
        let mut goal = [force[0] * mobility, force[1] * mobility];
        let within = share_within(goal, self.max_speed);
        let mut velocity = [zero; 2];
        let mut change = [zero; 2];
        for axis in 0..2 {
            goal[axis] = goal[axis] * within;
            velocity[axis] = sample.memory.get(VELOCITY + axis);
            change[axis] = (goal[axis] - velocity[axis]) * self.share;
        }
        let within = share_within(change, self.max_change);
        let mut moved = *setpoint;
        for axis in 0..2 {
            let change = change[axis] * within;
            let place = sample.memory.get(MOVED + axis);
            moved.position[axis] += place;
            moved.velocity[axis] += velocity[axis];
            moved.acceleration[axis] += change / dt;
            let middle = change.mul_add_all(0.5, velocity[axis]);
            sample.memory.set(MOVED + axis, middle.mul_add_all(dt, place));
            sample.memory.set(VELOCITY + axis, velocity[axis] + change);
        }
        let memory = sample.memory.after(Self::MEMORY);
        let setpoint: &LaneSetpoint<L> = &moved;
        self.lqr.torques(&mut Sample { state, setpoint, memory, control_dt: dt, limits, largest })
    }
}
