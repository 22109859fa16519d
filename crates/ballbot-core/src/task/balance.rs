//! The balance task: keep the robot upright and the ball at the setpoint.

use super::{Row, Rows, Sensed, Step, Task, Term, Terms};
use crate::error::{Result, check};
use crate::fields::Limit;
use crate::kinematics::Omniwheels;
use crate::lane_state::MAX_RATE;
use crate::lanes::{Heading, Lane, Memory};
use crate::params::Params;
use crate::setpoint::Setpoint;
use crate::state::{State, attitude};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

crate::fields! {
    /// Options of the balance task. SI units and radians. Tilts are from the equilibrium: of the line from the ball's center
    /// to the body's center of mass, which is the mast of a symmetric robot.
    pub struct Balance {
        /// Where the ball should be.
        pub setpoint: [f64; 2] = [0.0; 2], "m", Limit::from(-1e4).to(1e4);
        /// Half angle of the cone about the equilibrium from which the first tilt is drawn, evenly over its opening; below
        /// `fall_tilt`.
        pub reset_tilt: f64 = 5.0_f64.to_radians(), "rad", Limit::NOT_NEGATIVE;
        /// The first yaw is drawn evenly within ± this.
        pub reset_yaw: f64 = PI, "rad", Limit::from(0.0).to(PI);
        /// Largest first ball speed; drawn evenly over the disc.
        pub reset_ball_speed: f64 = 0.1, "m/s", Limit::from(0.0).to(10.0);
        /// Largest first tilt rate; drawn evenly over the disc.
        pub reset_tilt_rate: f64 = 0.2, "rad/s", Limit::from(0.0).to(10.0);
        /// Tilt from the equilibrium above which the episode is terminated.
        pub fall_tilt: f64 = 20.0_f64.to_radians(), "rad", Limit::above(0.0).to(PI);
        /// The end of the episode over which success is judged.
        pub success_window: f64 = 2.0, "s", Limit::from(0.0).to(1e9);
        /// Largest tilt from the equilibrium in that window.
        pub success_tilt: f64 = 1.0_f64.to_radians(), "rad", Limit::above(0.0).to(PI);
        /// Largest distance of the ball from the setpoint in that window.
        pub success_radius: f64 = 0.1, "m", Limit::from(1e-12).to(1e6);
    }
}

/// Consecutive steps, up to now, within the bounds of success.
const GOOD_STEPS: usize = 0;

impl Task for Balance {
    const NAME: &'static str = "balance";
    const ID: &'static str = "ballbot/Balance-v0";
    const SUMMARY: &'static str = "Keep a ballbot upright with its ball at the setpoint.";
    const REWARD_THRESHOLD: Option<f64> = Some(950.0);
    const TERMINATIONS: &'static [(&'static str, &'static str)] = &[
        ("tilt", "the tilt from the equilibrium exceeds `fall_tilt`"),
        ("bot_on_floor", "the body or a wheel touches the floor"),
    ];
    const SUCCESS: &'static str = "not terminated, and over the last `success_window` tilt within `success_tilt` and ball within `success_radius`";
    const MEMORY: usize = 1;

    fn validate(&self, params: &Params) -> Result<()> {
        let fall = self.fall_tilt;
        check("reset_tilt", self.reset_tilt, format_args!("from 0 to below fall_tilt = {fall}"), |t| t < fall)?;
        let fastest =
            (self.reset_ball_speed / params.ball_radius + self.reset_tilt_rate) * params.gear_ratio().max(1.0);
        check(
            "the fastest first wheel or ball rate, from reset_ball_speed and reset_tilt_rate,",
            fastest,
            format_args!("at most {} rad/s", 0.5 * MAX_RATE),
            |rate| rate <= 0.5 * MAX_RATE,
        )?;
        Ok(())
    }

    fn extreme_starts(&self, params: &Params) -> Vec<State> {
        let leaning = |azimuth: f64| {
            let about = Vector2::new(-azimuth.sin(), azimuth.cos());
            let body_quaternion = tilted_from_equilibrium(params, about * self.reset_tilt, 0.0);
            State { body_quaternion, ..State::upright(params) }
        };
        if params.body_com_offset == [0.0; 2] {
            return params.wheel_azimuths.into_iter().map(leaning).collect();
        }
        // A wheel is lowest in a tilt towards where it is in equilibrium, and the body in one towards the mast.
        let equilibrium = params.equilibrium_attitude(0.0);
        let azimuth = |direction: &Vector3<f64>| {
            let v = equilibrium * direction;
            v.y.atan2(v.x)
        };
        let wheels = Omniwheels::new(params).contact_directions;
        wheels.iter().chain([&Vector3::z()]).map(|direction| leaning(azimuth(direction))).collect()
    }

    /// Rolling without slip, the ball at the origin.
    fn start(&self, params: &Params, wheels: &Omniwheels, rng: &mut ChaCha8Rng) -> State {
        let tilt = in_disc(rng, self.reset_tilt);
        let yaw = self.reset_yaw * (2.0 * rng.random::<f64>() - 1.0);
        let velocity = in_disc(rng, self.reset_ball_speed);
        let rate = in_disc(rng, self.reset_tilt_rate);
        let attitude = tilted_from_equilibrium(params, tilt, yaw);
        let rate = Vector3::new(rate.x, rate.y, 0.0);
        State::rolling_on(
            params,
            wheels,
            velocity,
            0.0,
            attitude,
            params.to_balance_frame().inverse_transform_vector(&rate),
        )
    }

    fn setpoint(&self, _: &[f64]) -> Setpoint {
        Setpoint { position: self.setpoint.into(), ..Setpoint::default() }
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, _: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        let state = sensed.state;
        let up = state.body_quaternion.rotation().rows[2];
        let rate = state.body_angular_velocity;
        // Nothing depends on where the setpoint is or where the robot faces.
        let heading = Heading::new(state.body_quaternion);
        let [x, y] = heading.of(state.ball_position.x - self.setpoint[0], state.ball_position.y - self.setpoint[1]);
        let [vx, vy] = heading.of(state.ball_velocity.x, state.ball_velocity.y);
        let [w0, w1, w2] = state.wheel_speeds;
        let [a0, a1, a2] = sensed.last_action;
        rows.row(Row::new("gravity direction, body x", "", 1.0, 0.1), -up.x);
        rows.row(Row::new("gravity direction, body y", "", 1.0, 0.1), -up.y);
        rows.row(Row::new("gravity direction, body z", "", 1.0, 0.1), -up.z);
        rows.row(Row::new("body rate about body x", "rad/s", 20.0, 1.0), rate.x);
        rows.row(Row::new("body rate about body y", "rad/s", 20.0, 1.0), rate.y);
        rows.row(Row::new("body rate about body z", "rad/s", 20.0, 1.0), rate.z);
        rows.row(Row::new("wheel speed 0", "rad/s", 200.0, 5.0), w0);
        rows.row(Row::new("wheel speed 1", "rad/s", 200.0, 5.0), w1);
        rows.row(Row::new("wheel speed 2", "rad/s", 200.0, 5.0), w2);
        rows.row(Row::new("ball position from the setpoint, heading x", "m", 10.0, 0.1), x);
        rows.row(Row::new("ball position from the setpoint, heading y", "m", 10.0, 0.1), y);
        rows.row(Row::new("ball velocity, heading x", "m/s", 10.0, 0.2), vx);
        rows.row(Row::new("ball velocity, heading y", "m/s", 10.0, 0.2), vy);
        rows.row(Row::new("last action, wheel 0", "", 1.0, 0.5), a0);
        rows.row(Row::new("last action, wheel 1", "", 1.0, 0.5), a1);
        rows.row(Row::new("last action, wheel 2", "", 1.0, 0.5), a2);
    }

    #[inline(always)]
    fn terminate<L: Lane>(&self, step: &Step<'_, L>) -> L {
        let zero = step.tilt.zero();
        let tilted = zero.splat(self.fall_tilt).lt(step.tilt);
        L::select(tilted, zero.splat(1.0), L::select(step.on_floor, zero.splat(2.0), zero))
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let zero = step.tilt.zero();
        let near = self.distance_squared(step).le(zero.splat(self.success_radius * self.success_radius));
        let good = !terminated & near & step.tilt.le(zero.splat(self.success_tilt));
        let good_steps = L::select(good, memory.get(GOOD_STEPS) + 1.0, zero);
        memory.set(GOOD_STEPS, good_steps);
        // The last step is always in the window.
        let window = (self.success_window / step.control_dt).round().max(1.0);
        !terminated & zero.splat(window).le(good_steps)
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
        let zero = step.tilt.zero();
        let one = zero.splat(1.0);
        let tilt = (step.tilt / self.fall_tilt).squared().min(one);
        let distance = self.distance_squared(step);
        let v = step.state.ball_velocity;
        let speed = v.x.mul_add(v.x, v.y.squared()).min(one);
        let rate = step.state.body_angular_velocity.norm_squared().min(zero.splat(100.0));
        let [a, b, c] = step.action;
        let [last_a, last_b, last_c] = step.last_action;
        terms.term(Term::reward("alive", 1.0, "1, unless the step ends in a fall"), L::select(terminated, zero, one));
        terms.term(Term::cost("tilt", 1.0, "(tilt / fall_tilt)², at most 1"), tilt);
        terms.term(
            Term::cost("position", 0.5, "d² / (d² + success_radius²), d the distance of the ball from the setpoint"),
            distance / (distance + self.success_radius * self.success_radius),
        );
        terms.term(Term::cost("velocity", 0.2, "squared ball speed in m/s, at most 1"), speed);
        terms.term(Term::cost("rate", 0.01, "squared body rate in rad/s, at most 100"), rate);
        terms.term(Term::cost("action", 0.02, "mean squared action"), mean_square([a, b, c]));
        terms.term(
            Term::cost("action_change", 0.02, "mean squared change of the action"),
            mean_square([a - last_a, b - last_b, c - last_c]),
        );
    }
}

impl Balance {
    /// Of the ball from the setpoint, m².
    #[inline(always)]
    fn distance_squared<L: Lane>(&self, step: &Step<'_, L>) -> L {
        let position = step.state.ball_position;
        let (x, y) = (position.x - self.setpoint[0], position.y - self.setpoint[1]);
        x.mul_add(x, y.squared())
    }
}

/// Attitude of a robot at the heading `yaw`, tilted from its equilibrium by the rotation vector (`tilt` x, `tilt` y, 0).
fn tilted_from_equilibrium(params: &Params, tilt: Vector2<f64>, yaw: f64) -> UnitQuaternion<f64> {
    attitude(tilt, yaw) * params.to_balance_frame()
}

#[inline(always)]
fn mean_square<L: Lane>([a, b, c]: [L; 3]) -> L {
    (a.squared() + b.squared() + c.squared()) / 3.0
}

/// A point drawn evenly from a disc.
fn in_disc(rng: &mut ChaCha8Rng, radius: f64) -> Vector2<f64> {
    let radius = radius * rng.random::<f64>().sqrt();
    let angle = TAU * rng.random::<f64>();
    Vector2::new(angle.cos(), angle.sin()) * radius
}
