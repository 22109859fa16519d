//! The regulator of position, tilt and heading with an integral of the position.

use crate::parts::delayed::{DelayOptions, Delayed};
use crate::parts::joined::joined_fields;
use crate::parts::lean_planes::product;
use crate::parts::outer::{Outer, equal_torques, share_within};
use crate::parts::riccati::{self, Regulator, dynamic, rows};
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Constants, Law, LqrWeights, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::{DMatrix, SMatrix};

ballbot_base::fields! {
    /// Options of [`Lqi`] in addition to [`LqrWeights`].
    #[derive(Copy)]
    pub struct IntegralWeights {
        /// Integral of the deviation of the ball position.
        pub integral: f64 = 0.5, "m·s", Limit::from(1e-6).to(1e6);
        /// Not a cost: the largest lean that the integral may command.
        pub max_integral_lean: f64 = 0.069_813_170_079_773_18, "rad", Limit::from(1e-6).to(1e6);
    }
}

joined_fields! {
    /// Options of [`Lqi`]: deviations of equal cost, and the delay of the motors.
    pub struct LqiOptions {
        /// Weights of the states and inputs of [`crate::Lqr`].
        pub weights: LqrWeights,
        /// Weights of the integral.
        pub integral: IntegralWeights,
        /// Delay of the prediction.
        pub delay: DelayOptions,
    }
}

/// Number of states with the integral.
const SIZE: usize = STATES + 2;

/// τ = −K (x, z) with the integral z of the position's deviation, by the Riccati equation of the linear model with two
/// more states, z⁺ = z + T (x, y) (derived in `docs/laws.md`). A constant force, a slope or a wrong center of mass
/// leaves no offset if it requires no more lean than the integral may command; a larger disturbance leaves the offset
/// of [`crate::Lqr`], reduced by the integral.
///
/// z is stored in the inertial frame, so that a turning robot does not wind it up, and rotated into the heading frame.
/// It is limited as a vector so that it commands at most the lean `max_integral_lean`. It is held while the torques are
/// limited, while speed or lean are limited as in [`crate::Lqr`], and while the position deviation commands a larger
/// lean than z may: no disturbance that z can compensate leaves such an offset. With a delay x and z are predicted for
/// the time at which the torque acts; a held z is not predicted.
#[derive(Clone, Debug)]
pub struct Lqi {
    regulator: Regulator,
    /// K of the linear model's states, row by row.
    gain: [[f64; STATES]; INPUTS],
    /// K of the integral.
    integral_gain: [[f64; 2]; INPUTS],
    /// Lean about x and y with the same torques as an integral.
    lean: [[f64; 2]; 2],
    /// Lean about x and y with the same torques as a position deviation.
    position_lean: [[f64; 2]; 2],
    max_integral_lean: f64,
    tracking: Tracking,
    delayed: Delayed<SIZE>,
    outer: Outer,
}

impl NamedLaw for Lqi {
    const NAME: &'static str = "lqi";
    const SUMMARY: &'static str =
        "The regulator with an integral of the position: constant disturbances up to a limit leave no offset.";
    const LABEL: &'static str = "LQI";
    type Options = LqiOptions;

    fn design(plant: &Plant<'_>, options: &LqiOptions) -> Result<Self> {
        let LqiOptions { weights, integral, delay } = options;
        let (a, b) = model(plant);
        let (cost, r) = weights.matrices();
        let mut q = DMatrix::zeros(SIZE, SIZE);
        q.view_mut((0, 0), (STATES, STATES)).copy_from(&cost);
        for axis in 0..2 {
            q[(STATES + axis, STATES + axis)] = integral.integral.powi(-2);
        }
        let regulator = riccati::solve(&dynamic(&a), &dynamic(&b), &q, &r)?;
        let k = &regulator.gain;
        let lean_of =
            |first: usize| rows(&equal_torques(k.columns(2, 2).into_owned(), &k.columns(first, 2).into_owned()), 0);
        Ok(Self {
            gain: rows(k, 0),
            integral_gain: rows(k, STATES),
            lean: lean_of(STATES),
            position_lean: lean_of(0),
            max_integral_lean: integral.max_integral_lean,
            outer: Outer::new(k, [weights.max_lean, weights.max_speed]),
            tracking: Tracking::new(plant.params),
            delayed: Delayed::of(&a, &b, plant.control_dt, delay.delay)?,
            regulator,
        })
    }
}

impl Lqi {
    /// The Riccati solution behind the gains; the last two columns of K belong to the integral.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }

    /// Torque of a wheel before any limit, N·m.
    #[inline(always)]
    fn torque<L: Lane>(&self, wheel: usize, x: &[L; STATES], z: &[L; 2]) -> L {
        product(&self.gain[wheel], x) + product(&self.integral_gain[wheel], z)
    }
}

/// A and B of the sampled linear model with the integral of the position.
fn model(plant: &Plant<'_>) -> (SMatrix<f64, SIZE, SIZE>, SMatrix<f64, SIZE, INPUTS>) {
    let (model_a, model_b) = plant.sampled();
    let mut a = SMatrix::<f64, SIZE, SIZE>::identity();
    let mut b = SMatrix::<f64, SIZE, INPUTS>::zeros();
    a.view_mut((0, 0), (STATES, STATES)).copy_from(&model_a);
    b.view_mut((0, 0), (STATES, INPUTS)).copy_from(&model_b);
    (a[(STATES, 0)], a[(STATES + 1, 1)]) = (plant.control_dt, plant.control_dt);
    (a, b)
}

impl Law for Lqi {
    const MEMORY: usize = 2;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn kept(&self) -> usize {
        Self::MEMORY + self.delayed.kept()
    }

    fn constants(&self) -> Option<Constants> {
        let constants = self.tracking.add_to(Constants::default()).matrix("gain", &self.gain);
        let constants = constants
            .matrix("integral_gain", &self.integral_gain)
            .matrix("lean_per_integral", &self.lean)
            .matrix("lean_per_position", &self.position_lean)
            .number("max_integral_lean", self.max_integral_lean);
        Some(self.outer.add_to(constants))
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Sample { state, setpoint, control_dt: dt, .. } = *sample;
        let Deviation { mut x, forward, pose } = self.tracking.deviation(state, setpoint);
        let heading = pose.heading;
        let integral = [sample.memory.get(0), sample.memory.get(1)];
        let z = heading.of(integral[0], integral[1]);
        let (zero, one) = (x[0].zero(), x[0].splat(1.0));
        let delays = self.delayed.kept();
        let (mut forward, mut later) = (forward, z);
        if delays > 0 {
            let mut both = [zero; SIZE];
            both[..STATES].copy_from_slice(&x);
            both[STATES..].copy_from_slice(&z);
            let both = self.delayed.state(both, &sample.memory.after(Self::MEMORY));
            x.copy_from_slice(&both[..STATES]);
            later.copy_from_slice(&both[STATES..]);
            forward = self.tracking.forward_after(&heading, setpoint, self.delayed.seconds());
        }
        let [left, _] = self.outer.clip(&mut x);
        let near = turned(&self.position_lean, [x[0], x[1]]);
        let far = left.lt(one) | share_within(near, self.max_integral_lean).lt(one);
        let mut used = z;
        if delays > 0 {
            let within = share_within(turned(&self.lean, later), self.max_integral_lean);
            used = [L::select(far, z[0], later[0] * within), L::select(far, z[1], later[1] * within)];
        }
        let reference = self.tracking.planes.wheel_torques(forward, zero);
        let mut desired = reference;
        for (wheel, torque) in desired.iter_mut().enumerate() {
            *torque += self.torque(wheel, &x, &used);
        }
        let limited = sample.limited_at(desired, &pose);
        self.delayed.keep(limited.torques - reference, &mut sample.memory.after(Self::MEMORY));
        let held = far | limited.share.lt(one);
        let p = state.ball_position;
        let next = [
            (p.x - setpoint.position[0]).mul_add_all(dt, integral[0]),
            (p.y - setpoint.position[1]).mul_add_all(dt, integral[1]),
        ];
        // The length of the lean does not depend on the heading for a robot that is symmetric in all directions.
        let lean = turned(&self.lean, heading.of(next[0], next[1]));
        let share = share_within(lean, self.max_integral_lean);
        for axis in 0..2 {
            sample.memory.set(axis, L::select(held, integral[axis], next[axis] * share));
        }
        limited.torques
    }
}

/// A matrix times a vector.
#[inline(always)]
fn turned<L: Lane>([[a, b], [c, d]]: &[[f64; 2]; 2], [x, y]: [L; 2]) -> [L; 2] {
    [y.mul_add_all(*b, x * *a), y.mul_add_all(*d, x * *c)]
}
