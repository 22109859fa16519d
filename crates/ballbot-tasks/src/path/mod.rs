//! The path task: follow a point that moves along a closed curve.

mod curve;
mod kinds;

use self::curve::{Curve, NUMBERS, Phase};
use super::shared::{action_rows, alive, body_rows, bounded_error, effort, squared_norm, velocity_rows};
use super::start::{check_range, in_range, starts_and_falls, task_fields};
use super::{Geometry, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory, Scalar};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use rand_chacha::ChaCha8Rng;

task_fields! {
    fall 30.0, tilt 5.0;
    /// Options of the path task. SI units and radians. Tilts are from the equilibrium.
    pub struct Path {
        /// Smallest and largest speed along the path, uniform.
        pub path_speed: [f64; 2] = [0.2, 0.5], "m/s", Limit::from(0.0).to(10.0), scaled;
        /// Smallest and largest half width of a path, uniform.
        pub path_size: [f64; 2] = [0.5, 1.0], "m", Limit::from(0.1).to(100.0), scaled;
        /// Largest acceleration of the point: it starts with half of it, and its speed is lower where the curve requires more.
        pub path_acceleration: f64 = 0.6, "m/s²", Limit::above(0.0).to(10.0), scaled;
        /// Largest jerk of the point at its commanded speed; its snap is at most jerk²/acceleration.
        pub path_jerk: f64 = 2.0, "m/s³", Limit::above(0.0).to(1e3), scaled;
        /// Relative frequencies of circles, lemniscates, rounded squares and random curves.
        pub path_kinds: [f64; 4] = [1.0; 4], "", Limit::from(0.0).to(1e6);
        /// Time from the start of an episode from which errors are counted.
        pub settling: f64 = 3.0, "s", Limit::from(0.0).to(1e9), scaled;
        /// Distance of the ball from the point that costs half.
        pub position_scale: f64 = 0.05, "m", Limit::from(1e-6).to(10.0), scaled;
        /// Distance of the ball from the point that costs half of `distance`.
        pub distance_scale: f64 = 0.3, "m", Limit::from(1e-6).to(100.0), scaled;
        /// Largest root mean square of the distance across the path in a success.
        pub success_error: f64 = 0.02, "m", Limit::above(0.0).to(10.0), scaled;
    }
}

/// Memory: commanded speed and curve, center of the curve, cosine and sine of the phase, current speed, position of the
/// point, its unit tangent, sums of the squared cross-track and total errors with their count, and the steps.
const SPEED: usize = 0;
const CURVE: usize = 1;
const CENTER: [usize; 2] = [CURVE + NUMBERS, CURVE + NUMBERS + 1];
const PHASE: [usize; 2] = [CENTER[1] + 1, CENTER[1] + 2];
const NOW: usize = PHASE[1] + 1;
const POINT: [usize; 2] = [NOW + 1, NOW + 2];
const TANGENT: [usize; 2] = [NOW + 3, NOW + 4];
const ACROSS: usize = NOW + 5;
const ERRORS: usize = NOW + 6;
const COUNTED: usize = NOW + 7;
const STEPS: usize = NOW + 8;

/// Time between two points of the preview, s.
const PREVIEW: f64 = 0.2;

/// Bound and typical magnitude of the points of the preview, m.
const PREVIEW_ROWS: [[Row; 2]; 5] = [
    [preview("path 0.2 s ahead, heading x"), preview("path 0.2 s ahead, heading y")],
    [preview("path 0.4 s ahead, heading x"), preview("path 0.4 s ahead, heading y")],
    [preview("path 0.6 s ahead, heading x"), preview("path 0.6 s ahead, heading y")],
    [preview("path 0.8 s ahead, heading x"), preview("path 0.8 s ahead, heading y")],
    [preview("path 1.0 s ahead, heading x"), preview("path 1.0 s ahead, heading y")],
];

const fn preview(name: &'static str) -> Row {
    Row::new(name, "m", 10.0, 0.2)
}

const fn coefficient(name: &'static str) -> Row {
    Row::new(name, "m", 100.0, 0.5)
}

impl Task for Path {
    const NAME: &'static str = "path";
    const ID: &'static str = "ballbot/Path-v0";
    const SUMMARY: &'static str = "Follow a point that moves along a closed curve, with a preview of one second.";
    const MAX_EPISODE_STEPS: usize = 2000;
    const REWARD_THRESHOLD: Option<f64> = Some(1800.0);
    const SUCCESS: &'static str = "not terminated, and the error across the path within `success_error`";
    const GEOMETRY: Option<Geometry> = Some(Geometry::Curve);
    const COMMAND: &'static [Row] = &[
        Row::new("speed along the path", "m/s", 10.0, 0.5),
        coefficient("cosine of x"),
        coefficient("sine of x"),
        coefficient("second cosine of x"),
        coefficient("second sine of x"),
        coefficient("third cosine of x"),
        coefficient("third sine of x"),
        coefficient("cosine of y"),
        coefficient("sine of y"),
        coefficient("second cosine of y"),
        coefficient("second sine of y"),
        coefficient("third cosine of y"),
        coefficient("third sine of y"),
    ];
    const MEMORY: usize = STEPS + 1;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("path_speed", self.path_speed)?;
        check_range("path_size", self.path_size)?;
        check("the sum of path_kinds", self.path_kinds.iter().sum(), "above 0", |sum| sum > 0.0)?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn command(&self, _: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let size = in_range(rng, self.path_size);
        let curve = kinds::draw(self.path_kinds, size, rng);
        memory[SPEED] = in_range(rng, self.path_speed);
        memory[CURVE..CURVE + NUMBERS].copy_from_slice(&curve);
        f64::INFINITY
    }

    fn check_command(&self, command: &[f64]) -> Result<()> {
        check(Self::COMMAND[SPEED].name, command[SPEED], "from 0 on", |speed| speed >= 0.0)?;
        Ok(())
    }

    /// The curve begins at the ball, at rest. Where it would need more than the allowed acceleration or jerk, the speed
    /// is lower.
    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        let (acceleration, jerk) = (self.path_acceleration, self.path_jerk);
        let most = kinds::largest_speed(&memory[CURVE..], [acceleration, jerk, jerk * jerk / acceleration]);
        memory[SPEED] = memory[SPEED].clamp(0.0, most);
        let ball = moment.state.ball_position;
        let start = Phase { cos: 1.0, sin: 0.0 };
        let point = Curve::load(&Memory::<f64>::new(Scalar, memory), CURVE).at(start);
        memory[CENTER[0]] = ball.x - point.position[0];
        memory[CENTER[1]] = ball.y - point.position[1];
        (memory[PHASE[0]], memory[PHASE[1]]) = (start.cos, start.sin);
        (memory[POINT[0]], memory[POINT[1]]) = (ball.x, ball.y);
        [memory[TANGENT[0]], memory[TANGENT[1]]] = point.tangent();
        memory[NOW] = 0.0;
        memory[STEPS] = 0.0;
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        let mut memory: [f64; Self::MEMORY] = std::array::from_fn(|i| memory[i]);
        let phase = Phase { cos: memory[PHASE[0]], sin: memory[PHASE[1]] };
        let speed = memory[NOW];
        let acceleration = if speed < memory[SPEED] { 0.5 * self.path_acceleration } else { 0.0 };
        let curve = Curve::load(&Memory::<f64>::new(Scalar, &mut memory), CURVE);
        let [velocity, acceleration, jerk, snap] = curve.motion(phase, speed, acceleration);
        let position = [memory[POINT[0]], memory[POINT[1]]].into();
        Setpoint { position, velocity, acceleration, jerk, snap, ..Setpoint::default() }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let heading = Heading::new(sensed.state.body_quaternion);
        let ball = sensed.state.ball_position;
        let [x, y] = heading.of(memory.get(POINT[0]) - ball.x, memory.get(POINT[1]) - ball.y);
        let speed = memory.get(SPEED);
        let curve = Curve::load(memory, CURVE);
        let from_ball = [memory.get(CENTER[0]) - ball.x, memory.get(CENTER[1]) - ball.y];
        body_rows(sensed, rows);
        velocity_rows(sensed, &heading, rows);
        rows.row(Row::new("path now, heading x", "m", 10.0, 0.1), x);
        rows.row(Row::new("path now, heading y", "m", 10.0, 0.1), y);
        let mut phase = Phase { cos: memory.get(PHASE[0]), sin: memory.get(PHASE[1]) };
        for [row_x, row_y] in PREVIEW_ROWS {
            phase = curve.after(phase, speed * PREVIEW);
            let [px, py] = curve.at(phase).position;
            let [x, y] = heading.of(px + from_ball[0], py + from_ball[1]);
            rows.row(row_x, x);
            rows.row(row_y, y);
        }
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let dt = step.control_dt;
        let curve = Curve::load(memory, CURVE);
        let speed = memory.get(SPEED).min(memory.get(NOW) + 0.5 * self.path_acceleration * dt);
        let before = Phase { cos: memory.get(PHASE[0]), sin: memory.get(PHASE[1]) };
        let phase = curve.after(before, speed * dt);
        let point = curve.at(phase);
        let [tx, ty] = point.tangent();
        memory.set(NOW, speed);
        memory.set(PHASE[0], phase.cos);
        memory.set(PHASE[1], phase.sin);
        memory.set(POINT[0], memory.get(CENTER[0]) + point.position[0]);
        memory.set(POINT[1], memory.get(CENTER[1]) + point.position[1]);
        memory.set(TANGENT[0], tx);
        memory.set(TANGENT[1], ty);

        let steps = memory.get(STEPS) + 1.0;
        let zero = steps.zero();
        let counted = steps.splat(self.settling / dt).lt(steps);
        let [x, y] = Self::error(step, memory);
        let across = ty.mul_add(x, -(tx * y)).squared();
        memory.set(STEPS, steps);
        memory.set(ACROSS, memory.get(ACROSS) + L::select(counted, across, zero));
        memory.set(ERRORS, memory.get(ERRORS) + L::select(counted, squared_norm([x, y]), zero));
        memory.set(COUNTED, memory.get(COUNTED) + L::select(counted, steps.splat(1.0), zero));
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let counted = memory.get(COUNTED);
        let most = self.success_error * self.success_error;
        !terminated & counted.zero().lt(counted) & memory.get(ACROSS).le(counted * most)
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let error = squared_norm(Self::error(step, memory));
        let distance = error.sqrt();
        alive(terminated, 1.0, step.tilt, terms);
        terms.term(
            Term::cost("position", 0.5, "d² / (d² + position_scale²), d the distance of the ball from the point"),
            bounded_error(error, self.position_scale),
        );
        terms
            .term(Term::cost("distance", 0.3, "d / (d + distance_scale)"), distance / (distance + self.distance_scale));
        effort(step, terms);
    }

    fn measure(&self, memory: &[f64], _: f64, metrics: &mut impl Metrics) {
        metrics.metric(
            Metric::new("cross_track_error", "m", "root mean square of the distance of the ball across the path"),
            (memory[ACROSS] / memory[COUNTED]).sqrt(),
        );
        metrics.metric(
            Metric::new("tracking_error", "m", "root mean square of the distance of the ball from the moving point"),
            (memory[ERRORS] / memory[COUNTED]).sqrt(),
        );
    }
}

impl Path {
    /// Vector from the ball to the point, m.
    #[inline(always)]
    fn error<L: Lane>(step: &Step<'_, L>, memory: &Memory<'_, L>) -> [L; 2] {
        let ball = step.state.ball_position;
        [memory.get(POINT[0]) - ball.x, memory.get(POINT[1]) - ball.y]
    }
}
