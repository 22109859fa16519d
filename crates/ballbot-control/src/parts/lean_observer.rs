//! Observer of the lean and torque in equilibrium: on a slope, under a force, with a wrong center of mass.

use super::balance_frame::Pose;
use super::lean_planes::PLACES;
use super::outer::share_within;
use super::outside_force;
use super::tracking::{Deviation, Tracking};
use crate::{Plant, Sample};
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::Limit;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::wheels::Wheels;
use ballbot_models::LinearModel;
use nalgebra::Matrix2;

ballbot_base::fields! {
    /// Options of the estimate of constant disturbances.
    #[derive(Copy)]
    pub struct ObserverOptions {
        /// Rate at which the estimate of the lean in equilibrium converges; 0 for none, as on a level floor.
        pub lean_observer: f64 = 0.0, "1/s", LIMIT;
    }
}

/// Limit of the option `lean_observer` of all controllers.
pub(crate) const LIMIT: Limit = Limit::NOT_NEGATIVE.to(1e3);

/// Indices of its numbers: vectors of the inertial frame, whether the prediction is valid, and the force.
const LEAN: usize = 0;
const ACCELERATION: usize = 2;
const VELOCITY: usize = 4;
const RATE: usize = 6;
const COUNTS: usize = 8;
const FORCE: usize = 9;
const MEMORY: usize = 11;

/// Largest lean in equilibrium, and its largest error, rad: a larger value is an impulse or a slip.
const MAX_LEAN: f64 = 0.3;

/// An observer of the equilibrium (θ₀, u₀) in each vertical plane, the lean and the lean acceleration by the motors. A
/// constant force, a slope and an offset center of mass move the equilibrium of the linear model and change nothing
/// else (Vaidya, Shomin, Hollis and Kantor, ICRA 2015): the sampled plane is x⁺ = A (x − x₀) + b (u − u₀), and the
/// velocities ẏ and θ̇ after a sample deviate from their prediction by M (θ̂₀ − θ₀, û₀ − u₀). The errors of the
/// estimates decay by e^(−L T) per sample (derived in `docs/laws.md`).
///
/// û₀ is also the horizontal external force: [`outside_force`].
///
/// There is no correction after a sample with limited torques. θ̂₀ and its error are limited as vectors to 0.3 rad, so
/// that an impulse moves the estimate only slightly; û₀ and its error are limited to the largest acceleration by the
/// motors.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LeanObserver {
    observed: Option<Observed>,
}

#[derive(Clone, Copy, Debug)]
struct Observed {
    /// 1 − e^(−L T).
    gain: f64,
    planes: [Plane; 2],
    /// Largest acceleration of a lean by the motors, rad/s².
    max_acceleration: f64,
}

#[derive(Clone, Copy, Debug)]
struct Plane {
    /// Rows of ẏ and θ̇ of the sampled plane, per (θ, ẏ, θ̇, u).
    rows: [[f64; 4]; 2],
    /// −M⁻¹: error of (θ̂₀, û₀) per error of the predicted (ẏ, θ̇).
    corrections: [[f64; 2]; 2],
    /// u per wheel torque, rad/(s²·N·m).
    driven: Wheels<f64>,
    /// Horizontal external force per û₀, N·s²/rad.
    force: f64,
}

/// θ̂₀ and û₀ in the planes of the heading frame; `None` without an estimate.
pub(crate) struct Equilibrium<L>(Option<[[L; 2]; 2]>);

impl<L: Lane> Equilibrium<L> {
    /// A deviation from the motion about this equilibrium.
    #[inline(always)]
    fn deviation(&self, Deviation { mut x, forward, pose }: Deviation<L>) -> Deviation<L> {
        if let Self(Some([[lean_x, lean_y], _])) = *self {
            // Leaning towards y turns about −x.
            x[2] += lean_y;
            x[3] -= lean_x;
        }
        Deviation { x, forward: self.forward(forward), pose }
    }

    /// Accelerations of the leans by the motors in a motion, including the equilibrium accelerations.
    #[inline(always)]
    pub(crate) fn forward(&self, forward: [L; 2]) -> [L; 2] {
        match *self {
            Self(Some([_, [x, y]])) => [forward[0] + x, forward[1] + y],
            Self(None) => forward,
        }
    }
}

impl Plane {
    fn new(axis: usize, tracking: &Tracking, &Plant { params, control_dt: dt, .. }: &Plant<'_>) -> Result<Self> {
        let (a, b) = tracking.planes.sampled(axis, params, dt);
        let rows = [2, 3].map(|row| [a[(row, 1)], a[(row, 2)], a[(row, 3)], b[row]]);
        let m = Matrix2::new(rows[0][0], rows[0][3], rows[1][0], rows[1][3]);
        let inverse = m.try_inverse().filter(|m| m.iter().all(|part| part.is_finite())).ok_or_else(|| {
            Error::Inconsistent(format!("sampled every control_dt = {dt} s, no lean in equilibrium can be observed"))
        })?;
        let turning = LinearModel::new(params).b;
        // Leaning towards y turns about −x.
        let (place, sign) = (PLACES[axis][3], if axis == 0 { 1.0 } else { -1.0 });
        Ok(Self {
            rows,
            corrections: std::array::from_fn(|i| std::array::from_fn(|j| -inverse[(i, j)])),
            driven: Wheels::from_fn(|wheel| sign * turning[(place, wheel)]),
            force: outside_force::per_acceleration(axis, params, &tracking.planes.planes[axis]),
        })
    }
}

impl Plane {
    /// [`LeanObserver::force_deviation`] in this plane, of a correction by the share `gain`.
    fn force_deviation(&self, gain: f64, noise: &[f64; 3]) -> f64 {
        let [_, [per_velocity, per_rate]] = self.corrections;
        // The error follows e⁺ = (1 − gain) e + gain (a n⁺ + b n) with the noise n of (θ, ẏ, θ̇).
        let a = [0.0, per_velocity, per_rate];
        let [moving, leaning] = &self.rows;
        let keeps = 1.0 - gain;
        let variance = (0..3).map(|i| {
            let b = -(per_velocity * moving[i] + per_rate * leaning[i]);
            let later = keeps * a[i] + b;
            (a[i].powi(2) + later.powi(2) / (1.0 - keeps * keeps)) * noise[i].powi(2)
        });
        gain * variance.sum::<f64>().sqrt() * self.force.abs()
    }
}

impl LeanObserver {
    /// An observer that converges at `rate` (1/s); no estimate at rate 0.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the samples are too long for observation.
    pub(crate) fn new(plant: &Plant<'_>, tracking: &Tracking, rate: f64) -> Result<Self> {
        if rate == 0.0 {
            return Ok(Self::default());
        }
        let planes = [Plane::new(0, tracking, plant)?, Plane::new(1, tracking, plant)?];
        let max_torque = plant.limits.max_torque();
        let accelerations = planes.map(|plane| max_torque * plane.driven.iter().map(|part| part.abs()).sum::<f64>());
        Ok(Self {
            observed: Some(Observed {
                gain: -(-rate * plant.control_dt).exp_m1(),
                planes,
                max_acceleration: accelerations[0].max(accelerations[1]),
            }),
        })
    }

    /// Number of stored values per robot: θ̂₀ and û₀ in the planes of the inertial frame's x and y, then the
    /// prediction, then the external force.
    pub(crate) fn kept(&self) -> usize {
        if self.observed.is_some() { MEMORY } else { 0 }
    }

    /// Number of the first of the two stored values of the external force, if there is an estimate; the stored values
    /// begin at number `first`.
    pub(crate) fn force_index(&self, first: usize) -> Option<usize> {
        self.observed.map(|_| first + FORCE)
    }

    /// Estimates of the force in the planes of x and y by a torque of 1 N·m on each wheel that is not known, N.
    pub(crate) fn force_per_torque(&self) -> Option<[Wheels<f64>; 2]> {
        self.observed.map(|Observed { planes, .. }| {
            planes.map(|Plane { driven, force, .. }| Wheels::from_fn(|i| -driven[i] * force))
        })
    }

    /// Standard deviation of the estimate of the force in the planes of x and y, N, by white noise of the measured lean,
    /// ball velocity and lean rate with standard deviations `noise` (rad, m/s, rad/s).
    pub(crate) fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.observed.map(|Observed { gain, planes, .. }| planes.map(|plane| plane.force_deviation(gain, noise)))
    }

    /// The deviation from the setpoint's motion about the equilibrium, which the state at the end of the last sample
    /// corrects. The stored values begin at number `first`.
    #[inline(always)]
    pub(crate) fn deviation<L: Lane>(
        &self,
        tracking: &Tracking,
        sample: &mut Sample<'_, L>,
        first: usize,
    ) -> (Deviation<L>, Equilibrium<L>) {
        let deviation = tracking.deviation(sample.state, sample.setpoint);
        let equilibrium = Equilibrium(match &self.observed {
            Some(observed) => {
                Some(observed.correct(sample.state, &deviation.pose.heading, &mut sample.memory.after(first)))
            }
            None => None,
        });
        (equilibrium.deviation(deviation), equilibrium)
    }

    /// Predicts the velocities after a sample under wheel torques (N·m), of which the limits leave the fraction
    /// `share`.
    #[inline(always)]
    pub(crate) fn predict<L: Lane>(
        &self,
        sample: &mut Sample<'_, L>,
        first: usize,
        pose: &Pose<L>,
        torques: Wheels<L>,
        share: L,
    ) {
        if let Some(observed) = &self.observed {
            observed.predict(sample.state, pose, torques, share, &mut sample.memory.after(first));
        }
    }
}

impl Observed {
    /// θ̂₀ and û₀ in the planes of the heading frame.
    #[inline(always)]
    fn correct<L: Lane>(&self, state: &LaneState<L>, heading: &Heading<L>, memory: &mut Memory<'_, L>) -> [[L; 2]; 2] {
        let (velocity, rate) = (state.ball_velocity, rates(state));
        let [vx, vy] = heading.of(velocity.x - memory.get(VELOCITY), velocity.y - memory.get(VELOCITY + 1));
        let [rx, ry] = heading.of(rate[0] - memory.get(RATE), rate[1] - memory.get(RATE + 1));
        let [x, y] = &self.planes;
        let leans = [correction(&x.corrections[0], vx, rx), correction(&y.corrections[0], vy, ry)];
        let accelerations = [correction(&x.corrections[1], vx, rx), correction(&y.corrections[1], vy, ry)];
        let within = share_within(leans, MAX_LEAN).min(share_within(accelerations, self.max_acceleration));
        let zero = vx.zero();
        let part = L::select(zero.lt(memory.get(COUNTS)), within * self.gain, zero);
        let leans = corrected(heading, memory, LEAN, leans, part, MAX_LEAN);
        let accelerations = corrected(heading, memory, ACCELERATION, accelerations, part, self.max_acceleration);
        keep(heading, memory, FORCE, [accelerations[0] * x.force, accelerations[1] * y.force]);
        [leans, accelerations]
    }

    #[inline(always)]
    fn predict<L: Lane>(
        &self,
        state: &LaneState<L>,
        pose: &Pose<L>,
        torques: Wheels<L>,
        share: L,
        memory: &mut Memory<'_, L>,
    ) {
        let Pose { heading, tilt: [tilt_x, tilt_y], .. } = pose;
        let [lean_x, lean_y] = heading.of(memory.get(LEAN), memory.get(LEAN + 1));
        let lean = [*tilt_y - lean_x, -*tilt_x - lean_y];
        let velocity = heading.of(state.ball_velocity.x, state.ball_velocity.y);
        let [rate_x, rate_y] = rates(state);
        let rate = heading.of(rate_x, rate_y);
        let resting = heading.of(memory.get(ACCELERATION), memory.get(ACCELERATION + 1));
        let (mut velocities, mut turning) = (velocity, rate);
        for axis in 0..2 {
            let Plane { rows: [moving, leaning], driven, .. } = &self.planes[axis];
            let Wheels([a, b, c]) = torques;
            let u = c.mul_add_all(driven[2], b.mul_add_all(driven[1], a.mul_add_all(driven[0], -resting[axis])));
            let x = [lean[axis], velocity[axis], rate[axis], u];
            velocities[axis] = predicted(moving, x);
            turning[axis] = predicted(leaning, x);
        }
        keep(heading, memory, VELOCITY, velocities);
        keep(heading, memory, RATE, turning);
        let one = share.splat(1.0);
        memory.set(COUNTS, L::select(share.lt(one), share.zero(), one));
    }
}

/// Rates of the leans in the planes of the inertial frame.
#[inline(always)]
fn rates<L: Lane>(state: &LaneState<L>) -> [L; 2] {
    let rate = state.body_quaternion.rotation().apply(state.body_angular_velocity);
    [rate.y, -rate.x]
}

#[inline(always)]
fn correction<L: Lane>(row: &[f64; 2], velocity: L, rate: L) -> L {
    rate.mul_add_all(row[1], velocity * row[0])
}

#[inline(always)]
fn predicted<L: Lane>(row: &[f64; 4], [lean, velocity, rate, u]: [L; 4]) -> L {
    u.mul_add_all(row[3], rate.mul_add_all(row[2], velocity.mul_add_all(row[1], lean * row[0])))
}

/// Changes the vector stored from index `first` by `part` of a correction, and limits its length to `longest`. Returns
/// it in the heading frame.
#[inline(always)]
fn corrected<L: Lane>(
    heading: &Heading<L>,
    memory: &mut Memory<'_, L>,
    first: usize,
    correction: [L; 2],
    part: L,
    longest: f64,
) -> [L; 2] {
    let kept = heading.of(memory.get(first), memory.get(first + 1));
    let moved = [correction[0].mul_add(part, kept[0]), correction[1].mul_add(part, kept[1])];
    let within = share_within(moved, longest);
    let moved = [moved[0] * within, moved[1] * within];
    keep(heading, memory, first, moved);
    moved
}

/// Stores a vector of the heading frame in the inertial frame.
#[inline(always)]
fn keep<L: Lane>(heading: &Heading<L>, memory: &mut Memory<'_, L>, first: usize, [x, y]: [L; 2]) {
    let [x, y] = heading.to_inertial(x, y);
    memory.set(first, x);
    memory.set(first + 1, y);
}
