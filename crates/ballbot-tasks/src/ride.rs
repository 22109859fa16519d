//! The ride task: carry a rider who drives by leaning, and stop when the rider does.
//!
//! The rider is the first payload of the robot: a torso on springs, whose rest leans towards the velocity in the rider's mind. The seat
//! measures the deflection, and the robot accelerates along it. What the rider has in mind is not observed.

use super::heading_motion::{self, HeadingMotion};
use super::shared::{action_rows, alive, body_rows, bounded_error, effort, limited, squared_norm, velocity_rows};
use super::start::{check_range, drawn_steps, in_range, starts_and_falls, task_fields};
use super::{Geometry, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

task_fields! {
    fall 30.0, tilt 3.0;
    /// Options of the ride task. SI units and radians. Tilts are from the equilibrium.
    pub struct Ride {
        /// Speed that the rider has in mind, in any direction.
        pub speed: f64 = 1.574, "m/s", Limit::above(0.0).to(10.0), scaled;
        /// Largest rate of the heading that the rider has in mind; uniform within ± this.
        pub yaw_rate: f64 = 0.0, "rad/s", Limit::from(0.0).to(10.0), scaled;
        /// Shortest and longest time from the wish to go to the wish to stop, uniform.
        pub cruise_seconds: [f64; 2] = [7.0, 10.0], "s", Limit::above(0.0).to(1e9), scaled;
        /// Shortest and longest time from the wish to stop to the wish to go, uniform.
        pub stop_seconds: [f64; 2] = [6.0, 7.0], "s", Limit::above(0.0).to(1e9), scaled;
        /// Part of the body's mass that is the moving torso of the rider, of a robot that has no payload.
        pub rider_mass: f64 = 0.35, "", Limit::from(0.01).to(0.9);
        /// Height of that torso above the body's center of mass, in radii of gyration about the horizontal axes.
        pub rider_height: f64 = 0.6, "", Limit::from(0.0).to(1.0);
        /// Natural angular frequency of that torso on its springs.
        pub rider_frequency: f64 = 12.0, "1/s", Limit::above(0.0).to(1e3), scaled;
        /// Damping ratio of that torso on its springs.
        pub rider_damping: f64 = 0.5, "", Limit::from(0.0).to(2.0);
        /// Largest lean of the rider, as an angle about the ball's center.
        pub lean: f64 = 0.15, "rad", Limit::from(1e-6).to(1.0), scaled;
        /// Difference between the desired and current velocity at which the rider leans that far.
        pub eagerness: f64 = 1.1, "m/s", Limit::from(1e-6).to(100.0), scaled;
        /// Time constant with which the rider begins to lean.
        pub reaction: f64 = 0.2, "s", Limit::above(0.0).to(100.0), scaled;
        /// Acceleration that the robot commands while the seat measures `lean`, and at most.
        pub acceleration: f64 = 0.9, "m/s²", Limit::above(0.0).to(100.0), scaled;
        /// The commanded acceleration follows the seat with two poles at minus this value, at most 0.5 / control_dt.
        pub smoothing: f64 = 5.3, "1/s", Limit::above(0.0).to(1e3), scaled;
        /// Error of the velocity that costs half of `velocity`, and of `velocity_precision`.
        pub velocity_scales: [f64; 2] = [0.3, 0.06], "m/s", Limit::from(1e-6).to(10.0), scaled;
        /// Largest difference from the velocity in the rider's mind, when the rider begins to brake, in a success.
        pub success_velocity: f64 = 0.15, "m/s", Limit::above(0.0).to(10.0), scaled;
        /// Largest distance of the ball from where the rider began to brake in a success.
        pub success_distance: f64 = 3.2, "m", Limit::above(0.0).to(1e3), scaled;
        /// Speed below which the robot has stopped.
        pub stopped_speed: f64 = 0.1, "m/s", Limit::from(1e-6).to(10.0), scaled;
        /// Time for which it must be that slow to have stopped.
        pub stopped_seconds: f64 = 1.0, "s", Limit::above(0.0).to(1e9), scaled;
    }
}

/// Memory after the command: the robot's commanded motion; offset of the torso, m; lean of the rider, and its measurement by the
/// seat; acceleration that follows from it; the wanted velocity; whether the rider brakes, since when, until when the robot was faster than
/// stopped, its distance from where that began, that place, whether it has stopped; stops, and sums of their distances and times;
/// whether a leg failed; largest tilt and speed; sums over steps of the squared action and lean; steps; the poles of the commanded
/// acceleration; distance of the torso from the ball's center.
const MOTION: usize = 3;
const OFFSET: [usize; 2] = [AFTER, AFTER + 1];
const LEAN: [usize; 2] = [AFTER + 26, AFTER + 27];
const SEAT: [usize; 2] = [AFTER + 2, AFTER + 3];
const ASKED: [usize; 2] = [AFTER + 4, AFTER + 5];
const WANTED: [usize; 2] = [AFTER + 6, AFTER + 7];
const STOPPING: usize = AFTER + 8;
const SINCE: usize = AFTER + 9;
const TIME: usize = AFTER + 10;
const DISTANCE: usize = AFTER + 11;
const FROM: [usize; 2] = [AFTER + 12, AFTER + 13];
const STOPPED: usize = AFTER + 14;
const STOPS: usize = AFTER + 15;
const DISTANCES: usize = AFTER + 16;
const TIMES: usize = AFTER + 17;
const FAILED: usize = AFTER + 18;
const TILT: usize = AFTER + 19;
const FASTEST: usize = AFTER + 20;
const ACTIONS: usize = AFTER + 21;
const LEANS: usize = AFTER + 22;
const STEPS: usize = AFTER + 23;
const POLE: usize = AFTER + 24;
const LENGTH: usize = AFTER + 25;
const AFTER: usize = MOTION + heading_motion::LEN;

/// Least distance of the torso from the ball's center, m.
const LEAST_LENGTH: f64 = 1e-3;

/// Largest product of the poles of the commanded acceleration and a control step, beyond which its integration is not stable.
const FASTEST_POLE: f64 = 0.5;

impl Task for Ride {
    const NAME: &'static str = "ride";
    const ID: &'static str = "ballbot/Ride-v0";
    const SUMMARY: &'static str = "Carry a rider who drives by leaning, and brake when the rider does.";
    const MAX_EPISODE_STEPS: usize = 4000;
    const SUCCESS: &'static str = "not terminated, stopped at least once; each time the rider began to brake, within `success_velocity` of the velocity in \
         the rider's mind, and within `success_distance` from there until the next leg";
    const ANYWHERE: bool = true;
    const GEOMETRY: Option<Geometry> = Some(Geometry::Velocity);
    const COMMAND: &'static [Row] = &[
        Row::new("velocity in the rider's mind, heading x", "m/s", 10.0, 0.5),
        Row::new("velocity in the rider's mind, heading y", "m/s", 10.0, 0.5),
        Row::new("rate of the heading in the rider's mind", "rad/s", 10.0, 0.5),
    ];
    const LEAN: Option<[usize; 2]> = Some(OFFSET);
    const MEMORY: usize = AFTER + 28;

    fn robot(&self, params: &Params) -> Params {
        if params.has_payload() {
            return params.clone();
        }
        let [x, y, _] = params.body_inertia;
        let height = self.rider_height * (x.min(y) / params.body_mass).sqrt();
        let place: Vector3<f64> = params.body_com() + params.com_direction() * height;
        let mass = self.rider_mass * params.body_mass;
        Params {
            payload_mass: mass,
            payload_position: place.into(),
            payload_stiffness: [mass * self.rider_frequency.powi(2); 3],
            payload_damping: [2.0 * self.rider_damping * mass * self.rider_frequency; 3],
            ..params.clone()
        }
    }

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("cruise_seconds", self.cruise_seconds)?;
        check_range("stop_seconds", self.stop_seconds)?;
        if !params.has_payload() {
            return Err(Error::Inconsistent("payload_mass = 0 kg, but the rider of the task ride is a payload".into()));
        }
        let words =
            format_args!("at least {LEAST_LENGTH} m, as the rider of the task ride leans about the ball's center");
        check("the length of payload_position", length_of(params), words, |length| length >= LEAST_LENGTH)?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let goes = memory[..2] == [0.0; 2];
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let rate = in_range(rng, [-self.yaw_rate, self.yaw_rate]);
        let wish = if goes { [self.speed * cos, self.speed * sin, rate] } else { [0.0; 3] };
        memory[..3].copy_from_slice(&wish);
        drawn_steps(if goes { self.cruise_seconds } else { self.stop_seconds }, moment.control_dt, rng)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        HeadingMotion(MOTION).begin(moment, memory);
        memory[POLE] = self.smoothing.min(FASTEST_POLE / moment.control_dt);
        memory[LENGTH] = length_of(moment.params);
        let wanted = WANTED.map(|at| memory[at]);
        [memory[WANTED[0]], memory[WANTED[1]]] = [memory[0], memory[1]];
        let stops = memory[..2] == [0.0; 2];
        if memory[STOPPING] == 1.0 {
            if stops {
                return;
            }
            memory[FAILED] = memory[FAILED].max(1.0 - memory[STOPPED]);
        }
        memory[STOPPING] = 0.0;
        if stops && wanted != [0.0; 2] {
            let (ball, velocity) = (moment.state.ball_position, moment.state.ball_velocity);
            let [x, y] = Heading::new(moment.state.body_quaternion).of(velocity.x, velocity.y);
            if (x - wanted[0]).hypot(y - wanted[1]) > self.success_velocity {
                memory[FAILED] = 1.0;
            }
            [memory[FROM[0]], memory[FROM[1]]] = [ball.x, ball.y];
            memory[STOPPING] = 1.0;
            [SINCE, TIME, DISTANCE, STOPPED].into_iter().for_each(|at| memory[at] = 0.0);
        }
    }

    /// The motion that the seat commands.
    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        HeadingMotion(MOTION)
            .setpoint(memory, memory[2], |i, _, first, second| followed(memory[POLE], memory[ASKED[i]], first, second))
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let heading = Heading::new(sensed.state.body_quaternion);
        let velocity = sensed.state.ball_velocity;
        let [vx, vy] = heading.of(velocity.x, velocity.y);
        let motion = HeadingMotion(MOTION);
        let ([x, ax, _], [y, ay, _]) = (motion.along(memory, 0), motion.along(memory, 1));
        let rate = memory.get(2);
        let up = sensed.state.body_quaternion.rotation().rows[2];
        let turning = up.dot(sensed.state.body_angular_velocity);
        body_rows(sensed, rows);
        velocity_rows(sensed, &heading, rows);
        rows.row(Row::new("lean of the rider, body x", "rad", 1.0, 0.1), memory.get(SEAT[0]));
        rows.row(Row::new("lean of the rider, body y", "rad", 1.0, 0.1), memory.get(SEAT[1]));
        rows.row(Row::new("commanded velocity, heading x", "m/s", 10.0, 0.5), x);
        rows.row(Row::new("commanded velocity, heading y", "m/s", 10.0, 0.5), y);
        rows.row(Row::new("commanded rate of the heading", "rad/s", 10.0, 0.5), rate);
        rows.row(Row::new("commanded acceleration, heading x", "m/s²", 10.0, 0.5), ax);
        rows.row(Row::new("commanded acceleration, heading y", "m/s²", 10.0, 0.5), ay);
        rows.row(Row::new("error of the velocity, heading x", "m/s", 10.0, 0.1), x - vx);
        rows.row(Row::new("error of the velocity, heading y", "m/s", 10.0, 0.1), y - vy);
        rows.row(Row::new("error of the heading's rate", "rad/s", 10.0, 0.2), rate - turning);
        action_rows(sensed, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        self.drive(step, memory);
        self.judge(step, memory);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let failed = memory.get(FAILED);
        let zero = failed.zero();
        !terminated & failed.le(zero) & zero.lt(memory.get(STOPS))
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        let velocity = step.state.ball_velocity;
        let [vx, vy] = Heading::new(step.state.body_quaternion).of(velocity.x, velocity.y);
        let motion = HeadingMotion(MOTION);
        let ([x, ..], [y, ..]) = (motion.along(memory, 0), motion.along(memory, 1));
        let error = squared_norm([x - vx, y - vy]);
        let wish = squared_norm([memory.get(WANTED[0]) - vx, memory.get(WANTED[1]) - vy]);
        let turning = step.up.dot(step.state.body_angular_velocity) - memory.get(2);
        let [coarse, fine] = self.velocity_scales;
        alive(terminated, 1.0, step.tilt, terms);
        terms.term(
            Term::cost("velocity", 0.3, "e² / (e² + velocity_scales[0]²), e the error of the velocity"),
            bounded_error(error, coarse),
        );
        terms
            .term(Term::cost("velocity_precision", 0.2, "e² / (e² + velocity_scales[1]²)"), bounded_error(error, fine));
        terms.term(
            Term::cost("wish", 0.2, "d² / (d² + `eagerness`²), d the difference from the velocity in the rider's mind"),
            bounded_error(wish, self.eagerness),
        );
        terms.term(
            Term::cost("yaw_rate", 0.1, "e² / (e² + (0.3 rad/s)²), e the error of the heading's rate"),
            bounded_error(turning.squared(), 0.3),
        );
        effort(step, terms);
    }

    fn measure(&self, memory: &[f64], _: f64, metrics: &mut impl Metrics) {
        let per_stop = |sum: usize| memory[sum] / memory[STOPS];
        let rms = |sum: usize| (memory[sum] / memory[STEPS]).sqrt();
        metrics.metric(
            Metric::new(
                "braking_distance",
                "m",
                "largest distance from where the rider began to brake, mean of the stops",
            ),
            per_stop(DISTANCES),
        );
        metrics.metric(
            Metric::new(
                "braking_time",
                "s",
                "time from there until the ball stays slower than `stopped_speed`, mean of the stops",
            ),
            per_stop(TIMES),
        );
        metrics.metric(Metric::new("stops", "", "how often the robot stopped when the rider braked"), memory[STOPS]);
        metrics.metric(Metric::new("top_speed", "m/s", "largest speed of the ball"), memory[FASTEST]);
        metrics.metric(Metric::new("peak_tilt", "rad", "largest tilt from the equilibrium"), memory[TILT]);
        metrics.metric(Metric::new("effort", "", "root mean square of the actions"), rms(ACTIONS));
        metrics.metric(Metric::new("rider_effort", "rad", "root mean square of the rider's lean"), rms(LEANS));
    }
}

impl Ride {
    /// The rider leans, and the commanded motion follows the seat.
    #[inline(always)]
    fn drive<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let dt = step.control_dt;
        let velocity = step.state.ball_velocity;
        let [vx, vy] = Heading::new(step.state.body_quaternion).of(velocity.x, velocity.y);
        let wish = [memory.get(WANTED[0]) - vx, memory.get(WANTED[1]) - vy];
        let per_speed = self.lean / self.eagerness;
        let target = limited([wish[0] * per_speed, wish[1] * per_speed], self.lean);
        let share = -(-dt / self.reaction).exp_m1();
        let length = memory.get(LENGTH);
        let seat = [step.lean.x / length, step.lean.y / length];
        let per_lean = self.acceleration / self.lean;
        let asked = limited([seat[0] * per_lean, seat[1] * per_lean], self.acceleration);
        for i in 0..2 {
            let lean = memory.get(LEAN[i]);
            let lean = lean + (target[i] - lean) * share;
            memory.set(LEAN[i], lean);
            memory.set(OFFSET[i], lean * length);
            memory.set(SEAT[i], seat[i]);
            memory.set(ASKED[i], asked[i]);
        }
        let pole = memory.get(POLE);
        HeadingMotion(MOTION).advance(
            memory,
            memory.get(2),
            dt,
            #[inline(always)]
            |i, _, first, second| followed(pole, asked[i], first, second),
        );
    }

    /// Measures the leg.
    #[inline(always)]
    fn judge<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        let dt = step.control_dt;
        let (ball, velocity) = (step.state.ball_position, step.state.ball_velocity);
        let zero = step.tilt.zero();
        let one = zero.splat(1.0);
        let speed = squared_norm([velocity.x, velocity.y]).sqrt();
        memory.set(TILT, memory.get(TILT).max(step.tilt));
        memory.set(FASTEST, memory.get(FASTEST).max(speed));
        let [a, b, c] = step.action.0;
        memory.set(ACTIONS, memory.get(ACTIONS) + (a.squared() + b.squared() + c.squared()) / 3.0);
        memory.set(LEANS, memory.get(LEANS) + squared_norm([memory.get(LEAN[0]), memory.get(LEAN[1])]));
        memory.set(STEPS, memory.get(STEPS) + 1.0);

        let stopping = zero.lt(memory.get(STOPPING));
        let since = memory.get(SINCE) + dt;
        memory.set(SINCE, since);
        let moves = zero.splat(self.stopped_speed).lt(speed);
        let time = L::select(moves, since, memory.get(TIME));
        memory.set(TIME, time);
        let distance = squared_norm([ball.x - memory.get(FROM[0]), ball.y - memory.get(FROM[1])]).sqrt();
        let distance = L::select(stopping, distance, zero).max(memory.get(DISTANCE));
        memory.set(DISTANCE, distance);
        let stopped = memory.get(STOPPED);
        let stops = stopping & stopped.le(zero) & zero.splat(self.stopped_seconds).le(since - time);
        memory.set(STOPPED, L::select(stops, one, stopped));
        let count = L::select(stops, one, zero);
        memory.set(STOPS, memory.get(STOPS) + count);
        memory.set(DISTANCES, memory.get(DISTANCES) + L::select(stops, distance, zero));
        memory.set(TIMES, memory.get(TIMES) + L::select(stops, time, zero));
        let too_far = zero.splat(self.success_distance).lt(distance);
        memory.set(FAILED, L::select(too_far, one, memory.get(FAILED)));
    }
}

/// Distance of the torso from the ball's center, m.
fn length_of(params: &Params) -> f64 {
    Vector3::from(params.payload_position).norm()
}

/// Second derivative of an acceleration that follows another with two poles at −`p`.
#[inline(always)]
fn followed<L: Lane>(p: L, asked: L, first: L, second: L) -> L {
    (asked - first) * p.squared() - second * (p * 2.0)
}
