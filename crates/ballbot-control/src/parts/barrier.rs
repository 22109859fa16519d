//! Control barriers for the speed of the ball and the distance to a boundary.

use super::balance_frame::Pose;
use super::lean_planes::{LeanPlane, LeanPlanes, product, require_stable};
use super::outer::share_within;
use crate::Constants;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_models::{LinearModel, Scale};
use nalgebra::{DMatrix, DVector};

/// Times at which the motion under the backup law is checked, over 1/λ. Later the lean has settled: the ball approaches
/// the place where it stops, which is checked, too.
const TIMES: [f64; TESTS] =
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0];
const TESTS: usize = 18;

/// Lean with which the backup law brakes, for the paper's robot, rad.
const BRAKING_LEAN: f64 = 0.087_266_462_599_716_47;

/// Largest lean that the backup law commands, over the lean with which it brakes.
const LARGEST: f64 = 2.0;

/// Poles of the backup law over λ: of the lean, and the largest of the speed and of the return to the boundary.
const LEAN_POLE: f64 = 0.7;
const LARGEST_POLE: f64 = 0.2;

/// Least width of a boundary, over the distance from it at which the ball stops.
const LEAST_WIDTH: f64 = 4.0;

/// Distance of the tests from the boundary, over the distance at which the ball stops.
const TESTED: f64 = 0.5;

/// Speed of the tests over the limit: the rest is for what the linear model neglects.
const TESTED_SPEED: f64 = 0.95;

/// Speed of the return to the boundary, over the limit.
const RETURNING: f64 = 0.8;

/// Projections onto the tests of the speed, before the rest is scaled.
const PROJECTIONS: usize = 3;

/// Speeds of projected changes over their bound: rounding must not decide whether a change that ends at the bound is kept.
const SLACK: f64 = 1.0 + 1e-6;

/// A bound of a lean acceleration that nothing limits, rad/s².
const FREE: f64 = 1e30;

/// Steps of the doubling that finds where the ball stops: 2³⁰ samples.
const DOUBLINGS: usize = 30;

/// Position and velocity after some samples of the backup law.
#[derive(Clone, Copy, Debug)]
struct Test {
    /// −row of the position and of the velocity for (y, θ, ẏ, θ̇).
    position: [f64; 4],
    velocity: [f64; 4],
    /// Both per lean acceleration in the sample before.
    displaced: f64,
    gained: f64,
}

/// The motion along an axis of the inertial frame.
#[derive(Clone, Copy, Debug)]
struct Axis {
    /// Lean accelerations of the backup law per lean, velocity and rate.
    gains: [f64; 3],
    tests: [Test; TESTS],
    /// The place where the ball stops, as in [`Test`].
    stop: [f64; 4],
    stop_displaced: f64,
    /// The least and largest places in the tests, and where the ball may stop, m.
    boundary: [f64; 2],
    within: [f64; 2],
}

/// A discrete-time control barrier by a backup law (Chen et al., CDC 2021), in each axis of the inertial frame.
///
/// The backup law brakes with a small lean, or returns where the ball would stop outside. A state is safe if under the
/// backup law the speed stays below the limit, the ball within the boundary, and it stops a margin within. The desired
/// torques are changed only if the state after this sample would be less safe than under the backup law, to nearly the
/// nearest torques for which it is not: the backup law is always feasible. Derived in `docs/safety.md`.
#[derive(Clone, Debug)]
pub(crate) struct Barrier {
    /// −A and B of a sample, for (y, θ, ẏ, θ̇) in each axis.
    free: [[f64; 4]; 4],
    driven: [f64; 4],
    axes: [Axis; 2],
    max_speed: Option<f64>,
    /// Acceleration of the leans per wheel torque, rad/(s²·N·m).
    leaning: [[f64; 3]; 2],
    planes: LeanPlanes,
    /// Largest lean acceleration for velocities, rad/s², rate of the return, 1/s, and its largest speed, m/s.
    largest: f64,
    return_rate: f64,
    return_speed: f64,
}

impl Barrier {
    /// The barrier of the robot of `params`; `None` without limits.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a speed or a boundary out of range, [`Error::Inconsistent`] for a boundary that is too
    /// narrow or a sampling time that is too long.
    pub(crate) fn new(
        params: &Params,
        control_dt: f64,
        max_speed: Option<f64>,
        boundary: Option<[f64; 4]>,
    ) -> Result<Option<Self>> {
        if max_speed.is_none() && boundary.is_none() {
            return Ok(None);
        }
        if let Some(speed) = max_speed {
            check("speed_limit", speed, "from 0.01 to 1000 m/s", |speed| (0.01..=1e3).contains(&speed))?;
        }
        let planes = LeanPlanes::new(params);
        let [x, y] = planes.planes;
        let plane = LeanPlane {
            toppling: planes.toppling_rate(),
            acceleration: 0.5 * (x.acceleration + y.acceleration),
            lever: 0.5 * (x.lever + y.lever),
        };
        let lean = BRAKING_LEAN * Scale::of(params).factor("rad").expect("leans scale");
        // A robot that begins to lean with this lean rolls back by half of this.
        let margin = plane.lever * lean / TESTED;
        let limits = match boundary {
            Some([x_min, x_max, y_min, y_max]) => [[x_min, x_max], [y_min, y_max]],
            None => [[-FREE, FREE]; 2],
        };
        for ([low, high], axis) in limits.into_iter().zip(["x", "y"]) {
            for bound in [low, high] {
                check("boundary", bound, "finite, within ±1e6 m", |bound| bound.abs() <= 1e6 || boundary.is_none())?;
            }
            let least = LEAST_WIDTH * margin;
            if high - low < least {
                return Err(Error::Inconsistent(format!(
                    "boundary is from {axis} = {low} m to {high} m: it must be at least {least:.3} m wide"
                )));
            }
        }
        let braking = plane.acceleration * lean;
        let (fastest, lean_pole) = (LARGEST_POLE * plane.toppling, LEAN_POLE * plane.toppling);
        let pole = |[low, high]: [f64; 2]| {
            let by_speed = max_speed.map_or(0.0, |speed| braking / speed);
            by_speed.max((braking / (high - low)).sqrt()).min(fastest)
        };
        let poles = limits.map(pole);
        let [(ax, bx), (ay, by)] = [0, 1].map(|axis| planes.sampled(axis, params, control_dt));
        let (a, b) = (0.5 * (ax + ay), 0.5 * (bx + by));
        let axis = |index: usize| Axis::new([&a, &b], control_dt, &plane, [poles[index], lean_pole], limits[index]);
        let mut axes = [axis(0)?, axis(1)?];
        for axis in &mut axes {
            let [low, high] = axis.boundary;
            axis.within = [low + margin, high - margin];
            axis.boundary = [low + TESTED * margin, high - TESTED * margin];
        }
        let turning = LinearModel::new(params).b;
        let reachable = braking / poles[0].max(poles[1]);
        Ok(Some(Self {
            free: std::array::from_fn(|i| negative(&a, i)),
            driven: std::array::from_fn(|i| b[i]),
            axes,
            max_speed: max_speed.map(|speed| TESTED_SPEED * speed),
            // Leaning towards y turns about −x.
            leaning: [
                std::array::from_fn(|wheel| turning[(8, wheel)]),
                std::array::from_fn(|wheel| -turning[(7, wheel)]),
            ],
            planes,
            largest: LARGEST * lean * (axes[0].gains[0] - plane.toppling_squared()),
            return_rate: fastest,
            return_speed: RETURNING * max_speed.map_or(reachable, |speed| speed.min(reachable)),
        }))
    }

    /// Adds A and B, the backup law, the tests of both axes (rows of position and velocity, each per lean acceleration),
    /// where the ball stops, and the limits.
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        let motion: [[f64; 5]; 4] = std::array::from_fn(|i| {
            let [y, lean, velocity, rate] = self.free[i].map(|free| -free);
            [y, lean, velocity, rate, self.driven[i]]
        });
        let tests: Vec<[f64; 10]> = self.axes.iter().flat_map(|axis| axis.tests.iter().map(Test::row)).collect();
        let stops = self.axes.map(|axis| {
            let [y, lean, velocity, rate] = axis.stop.map(|stop| -stop);
            [y, lean, velocity, rate, axis.stop_displaced]
        });
        let [x, y] = [0, 1].map(|axis| self.planes.driven(axis));
        let torques: [[f64; 2]; 3] = std::array::from_fn(|wheel| [x[wheel], y[wheel]]);
        constants
            .matrix("barrier_motion", &motion)
            .matrix("barrier_gains", &self.axes.map(|axis| axis.gains))
            .matrix("barrier_tests", &tests)
            .matrix("barrier_stops", &stops)
            .matrix("barrier_boundary", &self.axes.map(|axis| axis.boundary))
            .matrix("barrier_within", &self.axes.map(|axis| axis.within))
            .matrix("barrier_accelerations", &self.leaning)
            .matrix("barrier_torques", &torques)
            .number("barrier_speed", self.max_speed.unwrap_or(FREE))
            .number("barrier_largest", self.largest)
            .number("barrier_return_rate", self.return_rate)
            .number("barrier_return_speed", self.return_speed)
            .number("barrier_free", FREE)
            .number("barrier_slack", SLACK)
            .number("barrier_least_displaced", LEAST_DISPLACED)
    }

    /// The torques near `desired` that respect the barrier, and whether they differ from it. Torques that do are
    /// unchanged to the last bit; NaN passes through.
    #[inline(always)]
    pub(crate) fn filter<L: Lane>(
        &self,
        desired: Wheels<L>,
        state: &LaneState<L>,
        pose: &Pose<L>,
    ) -> (Wheels<L>, L::Mask) {
        let (p, v, heading) = (state.ball_position, state.ball_velocity, &pose.heading);
        let [lean_x, lean_y] = heading.to_inertial(pose.tilt[1], -pose.tilt[0]);
        let [rate_x, rate_y] = heading.to_inertial(pose.rate.y, -pose.rate.x);
        let states = [[p.x, lean_x, v.x, rate_x], [p.y, lean_y, v.y, rate_y]];
        let wanted = self.leaning.each_ref();
        let [of_x, of_y] = [product(wanted[0], &desired.0), product(wanted[1], &desired.0)];
        let law = heading.to_inertial(-of_x, -of_y);
        let backup = self.backup(&states);
        let zero = p.x.zero();
        // The states after this sample under the backup law, and the tests from there.
        let mut after = states;
        let mut speeds = [[zero; TESTS]; 2];
        let (mut low, mut high) = ([zero.splat(-FREE); 2], [zero.splat(FREE); 2]);
        for (a, axis) in self.axes.iter().enumerate() {
            for (i, next) in after[a].iter_mut().enumerate() {
                *next = backup[a].mul_add_all(self.driven[i], product(&self.free[i], &states[a]));
            }
            // Each test has its own bound: with the farthest for all, a ball beyond a limit could stay so in every test.
            for (k, test) in axis.tests.iter().enumerate() {
                speeds[a][k] = product(&test.velocity, &after[a]);
                let place = product(&test.position, &after[a]);
                narrow(&mut low[a], &mut high[a], test.displaced, place, axis.boundary);
            }
            let stop = product(&axis.stop, &after[a]);
            narrow(&mut low[a], &mut high[a], axis.stop_displaced, stop, axis.within);
        }
        let mut change = [law[0] - backup[0], law[1] - backup[1]];
        let mut changes = change[0].lt(low[0]) | high[0].lt(change[0]) | change[1].lt(low[1]) | high[1].lt(change[1]);
        let mut bounds = [zero; TESTS];
        if let Some(speed) = self.max_speed {
            for (k, bound) in bounds.iter_mut().enumerate() {
                *bound = length([speeds[0][k], speeds[1][k]]).max(zero.splat(speed));
                changes = changes | bound.lt(length(self.speed(&speeds, change, k)));
            }
        }
        if !L::any(changes) {
            return (desired, changes);
        }
        change = [change[0].max(low[0]).min(high[0]), change[1].max(low[1]).min(high[1])];
        if self.max_speed.is_some() {
            for _ in 0..PROJECTIONS {
                let step = self.step(&speeds, change, &bounds);
                for a in 0..2 {
                    change[a] = (change[a] - step[a]).max(low[a]).min(high[a]);
                }
            }
            // The speed is convex in the change: a chord is an upper bound.
            let one = zero.splat(1.0);
            let mut share = one;
            for (k, bound) in bounds.iter().enumerate() {
                let bound = *bound * SLACK;
                let (far, near) = (length(self.speed(&speeds, change, k)), length([speeds[0][k], speeds[1][k]]));
                let beyond = bound.lt(far);
                share = share.min(L::select(beyond, (bound - near) / L::select(beyond, far - near, one), one));
            }
            change = [change[0] * share, change[1] * share];
        }
        let [x, y] = heading.of(backup[0] + change[0] - law[0], backup[1] + change[1] - law[1]);
        let added = self.planes.wheel_torques([x, y], zero);
        let mut torques = desired;
        for (torque, added) in torques.iter_mut().zip(added) {
            *torque = L::select(changes, *torque + added, *torque);
        }
        (torques, changes)
    }

    /// Lean accelerations of the backup law.
    #[inline(always)]
    fn backup<L: Lane>(&self, states: &[[L; 4]; 2]) -> [L; 2] {
        let zero = states[0][0].zero();
        let mut returning = [zero; 2];
        for (a, axis) in self.axes.iter().enumerate() {
            let stop = product(&axis.stop, &states[a]);
            let inside = stop.max(zero.splat(axis.within[0])).min(zero.splat(axis.within[1]));
            returning[a] = (inside - stop) * self.return_rate;
        }
        let slower = share_within(returning, self.return_speed);
        let mut commanded = [zero; 2];
        for (a, axis) in self.axes.iter().enumerate() {
            commanded[a] = (states[a][2] - returning[a] * slower) * axis.gains[1];
        }
        let less = share_within(commanded, self.largest);
        let mut backup = [zero; 2];
        for (a, axis) in self.axes.iter().enumerate() {
            let [lean, _, rate] = axis.gains;
            let upright = states[a][1].mul_add_all(-lean, states[a][3] * -rate);
            backup[a] = upright - commanded[a] * less;
        }
        backup
    }

    /// The velocity of a test.
    #[inline(always)]
    fn speed<L: Lane>(&self, speeds: &[[L; TESTS]; 2], change: [L; 2], k: usize) -> [L; 2] {
        let [x, y] = &self.axes;
        [change[0].mul_add_all(x.tests[k].gained, speeds[0][k]), change[1].mul_add_all(y.tests[k].gained, speeds[1][k])]
    }

    /// The step to the linear bound of the test that is farthest beyond it.
    #[inline(always)]
    fn step<L: Lane>(&self, speeds: &[[L; TESTS]; 2], change: [L; 2], bounds: &[L; TESTS]) -> [L; 2] {
        let (zero, [ax, ay]) = (change[0].zero(), &self.axes);
        let (mut step, mut farthest) = ([zero; 2], zero);
        for (k, &bound) in bounds.iter().enumerate() {
            let [x, y] = self.speed(speeds, change, k);
            let length = length([x, y]);
            let beyond = bound.lt(length);
            let (gx, gy) = (x * ax.tests[k].gained, y * ay.tests[k].gained);
            let slope = L::select(beyond, gx.mul_add(gx, gy.squared()), zero.splat(1.0)).max(zero.splat(1e-30));
            let away = (length - bound) * length / slope;
            let size = (length - bound) * length / slope.sqrt();
            let farther = beyond & farthest.lt(size);
            farthest = L::select(farther, size, farthest);
            step = [L::select(farther, gx * away, step[0]), L::select(farther, gy * away, step[1])];
        }
        step
    }
}

#[inline(always)]
fn length<L: Lane>([x, y]: [L; 2]) -> L {
    x.mul_add(x, y.squared()).sqrt()
}

impl Test {
    /// Its numbers in a row.
    fn row(&self) -> [f64; 10] {
        let ([a, b, c, d], [e, f, g, h]) = (self.position.map(|row| -row), self.velocity.map(|row| -row));
        [a, b, c, d, e, f, g, h, self.displaced, self.gained]
    }
}

impl Axis {
    /// The motion with the poles `slow` of the speed and `fast` (twice) of the lean.
    fn new(
        [a, b]: [&DMatrix<f64>; 2],
        control_dt: f64,
        plane: &LeanPlane,
        [slow, fast]: [f64; 2],
        boundary: [f64; 2],
    ) -> Result<Self> {
        let velocity = slow * fast * fast / plane.acceleration;
        let lean = plane.toppling_squared() + fast * (fast + 2.0 * slow);
        let rate = slow + 2.0 * fast + plane.lever * velocity;
        let closed = a - b * DMatrix::from_row_slice(1, 4, &[0.0, lean, velocity, rate]);
        require_stable(closed.view((1, 1), (3, 3)).into_owned(), control_dt)?;
        let along = |row: &[f64; 4]| -> f64 { row.iter().zip(b.iter()).map(|(row, b)| -row * b).sum() };
        let tests = TIMES.map(|time| {
            let power = power(&closed, (time / (plane.toppling * control_dt)).round() as usize);
            let (position, velocity) = (negative(&power, 0), negative(&power, 2));
            Test { displaced: along(&position), gained: along(&velocity), position, velocity }
        });
        let mut last = closed;
        for _ in 0..DOUBLINGS {
            last = &last * &last;
            // Rounding must not grow: a displacement stays.
            last.set_column(0, &DVector::from_column_slice(&[1.0, 0.0, 0.0, 0.0]));
        }
        let stop = negative(&last, 0);
        Ok(Self {
            gains: [lean, velocity, rate],
            tests,
            stop_displaced: along(&stop),
            stop,
            boundary,
            within: boundary,
        })
    }
}

/// The negative of a row.
fn negative(matrix: &DMatrix<f64>, row: usize) -> [f64; 4] {
    std::array::from_fn(|column| -matrix[(row, column)])
}

/// A power of a matrix.
fn power(matrix: &DMatrix<f64>, exponent: usize) -> DMatrix<f64> {
    (0..exponent).fold(DMatrix::identity(matrix.nrows(), matrix.ncols()), |power, _| power * matrix)
}

/// Least displacement per lean acceleration that can be a condition, m·s².
const LEAST_DISPLACED: f64 = 1e-12;

/// Narrows the bounds of a lean acceleration such that it displaces a place to within `limits`, or no farther beyond them.
#[inline(always)]
fn narrow<L: Lane>(low: &mut L, high: &mut L, displaced: f64, place: L, limits: [f64; 2]) {
    let [least, most] = limits.map(|limit| place.splat(limit));
    let (least, most) = (least.min(place) - place, most.max(place) - place);
    let inverse = displaced.recip();
    if displaced > LEAST_DISPLACED {
        *low = low.max(least * inverse);
        *high = high.min(most * inverse);
    } else if displaced < -LEAST_DISPLACED {
        *low = low.max(most * inverse);
        *high = high.min(least * inverse);
    }
}
