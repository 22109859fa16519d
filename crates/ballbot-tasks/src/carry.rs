//! The carry task: bring a glass of water to points on the floor without spilling.
//!
//! The moving part of the water is a damped pendulum in the glass: its slope s in the plane of the tray follows the slope
//! at which a free surface is at rest, s'' + 2 ζ ω s' + ω² (s − f_xy / f_z) = 0, with the force f of the glass per mass. It
//! has no effect on the robot; a load that has one is a payload of the robot.

use super::shared::bounded_error;
use super::start::{starts_and_falls, task_fields};
use super::{Geometry, Goal, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Memory, Vec3};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

task_fields! {
    fall 30.0, tilt 3.0;
    /// Options of the carry task. SI units and radians. Tilts are from the equilibrium.
    pub struct Carry {
        /// Smallest and largest distance of a goal from the ball, uniform, in any direction.
        pub goal_distance: [f64; 2] = [0.5, 2.0], "m", Limit::from(0.0).to(100.0);
        /// Shortest and longest time from one goal to the next, uniform.
        pub goal_seconds: [f64; 2] = [8.0, 12.0], "s", Limit::above(0.0).to(1e9);
        /// Distance within which the ball is at its goal.
        pub goal_radius: f64 = 0.05, "m", Limit::from(1e-6).to(10.0);
        /// Deceleration a of the approach that costs nothing, with the speed d / (`approach_time` + √(d / 2a)) at distance d.
        pub approach_acceleration: f64 = 0.3, "m/s²", Limit::above(0.0).to(100.0);
        /// Time constant of the end of that approach.
        pub approach_time: f64 = 0.5, "s", Limit::above(0.0).to(100.0);
        /// How long the ball must have been at its goal when the next goal is given.
        pub hold_seconds: f64 = 1.0, "s", Limit::from(0.0).to(1e9);
        /// Height of the glass on the mast above the ball's center.
        pub glass_height: f64 = 0.3, "m", Limit::from(0.0).to(100.0), scaled;
        /// Radius R of the surface of the water.
        pub glass_radius: f64 = 0.035, "m", Limit::from(1e-3).to(10.0);
        /// Frequency of the water's first mode: of a deep glass √(1.84 g / R) / 2π, less in a shallow one.
        pub slosh_frequency: f64 = 3.6, "Hz", Limit::from(0.01).to(100.0);
        /// Damping ratio ζ of that mode.
        pub slosh_damping: f64 = 0.02, "", Limit::from(0.0).to(2.0);
        /// Height of the rim above the water at rest: it spills when the surface is higher at the wall.
        pub freeboard: f64 = 0.015, "m", Limit::from(1e-6).to(10.0);
    }
}

/// Memory after the memory of [`Goal`]: slope of the surface and its rate, body x and y; velocity of the glass after the last
/// step; acceleration of gravity, upwards, inertial frame; steps; largest height of the water at the wall; sum over steps of the squared
/// force per mass in the plane of the tray.
const SLOPE: [usize; 2] = [Goal::MEMORY, Goal::MEMORY + 1];
const RATE: [usize; 2] = [Goal::MEMORY + 2, Goal::MEMORY + 3];
const VELOCITY: [usize; 3] = [Goal::MEMORY + 4, Goal::MEMORY + 5, Goal::MEMORY + 6];
const GRAVITY: [usize; 3] = [Goal::MEMORY + 7, Goal::MEMORY + 8, Goal::MEMORY + 9];
const STEPS: usize = Goal::MEMORY + 10;
const HIGHEST: usize = Goal::MEMORY + 11;
const FORCE: usize = Goal::MEMORY + 12;

/// Largest slope of the surface that is simulated.
const STEEPEST: f64 = 10.0;

impl Task for Carry {
    const NAME: &'static str = "carry";
    const ID: &'static str = "ballbot/Carry-v0";
    const SUMMARY: &'static str = "Carry a glass of water to points on the floor without spilling.";
    const MAX_EPISODE_STEPS: usize = 2000;
    const SUCCESS: &'static str = "not terminated, nothing spilled, and every goal held within `goal_radius` for the last `hold_seconds` of its time";
    const GEOMETRY: Option<Geometry> = Some(Geometry::Point);
    const COMMAND: &'static [Row] = Goal::COMMAND;
    const MEMORY: usize = Goal::MEMORY + 13;

    fn validate(&self, params: &Params) -> Result<()> {
        params.require_still_floor("the water of the task carry")?;
        self.goal().validate(params)
    }

    starts_and_falls!();

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        self.goal().command(moment, rng, memory)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        let gravity = moment.params.gravity_vector();
        GRAVITY.into_iter().zip(&gravity).for_each(|(at, g)| memory[at] = 0.0 - g);
        self.goal().commanded(moment, memory);
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        self.goal().setpoint(memory)
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        self.goal().observe(sensed, memory, rows);
        rows.row(Row::new("slope of the water, body x", "", 1.0, 0.1), memory.get(SLOPE[0]));
        rows.row(Row::new("slope of the water, body y", "", 1.0, 0.1), memory.get(SLOPE[1]));
        rows.row(Row::new("rate of that slope, body x", "1/s", 20.0, 2.0), memory.get(RATE[0]));
        rows.row(Row::new("rate of that slope, body y", "1/s", 20.0, 2.0), memory.get(RATE[1]));
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        self.goal().advance(step, memory);
        let dt = step.control_dt;
        let state = step.state;
        let rotation = state.body_quaternion.rotation();
        let zero = step.tilt.zero();
        let arm = Vec3::new(zero, zero, zero.splat(self.glass_height));
        let velocity = state.body_velocity + rotation.apply(state.body_angular_velocity.cross(arm));
        let before = Vec3::new(memory.get(VELOCITY[0]), memory.get(VELOCITY[1]), memory.get(VELOCITY[2]));
        let is_first = memory.get(STEPS).le(zero);
        let change = Vec3::select(is_first, Vec3::zero(zero), velocity - before);
        let gravity = Vec3::new(memory.get(GRAVITY[0]), memory.get(GRAVITY[1]), memory.get(GRAVITY[2]));
        let force = rotation.apply_transposed(gravity.plus(change, zero.splat(dt.recip())));
        // In free fall the water has no surface.
        let down = force.z.max(gravity.z * 0.1);
        let rest = [limited(force.x / down), limited(force.y / down)];
        let mut squared = zero;
        let [[a, b], [c, d]] = transition(TAU * self.slosh_frequency, self.slosh_damping, dt);
        for (i, rest) in rest.into_iter().enumerate() {
            let (offset, rate) = (memory.get(SLOPE[i]) - rest, memory.get(RATE[i]));
            let slope = offset.mul_add_all(a, rate.mul_add_all(b, rest));
            let rate = offset.mul_add_all(c, rate * d);
            let slope = L::select(is_first, rest, limited(slope));
            memory.set(SLOPE[i], slope);
            memory.set(RATE[i], L::select(is_first, zero, rate));
            squared += slope.squared();
        }
        memory.set(HIGHEST, memory.get(HIGHEST).max(squared.sqrt() * self.glass_radius));
        memory.set(FORCE, memory.get(FORCE) + force.x.squared() + force.y.squared());
        memory.set(STEPS, memory.get(STEPS) + 1.0);
        memory.set(VELOCITY[0], velocity.x);
        memory.set(VELOCITY[1], velocity.y);
        memory.set(VELOCITY[2], velocity.z);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        let highest = memory.get(HIGHEST);
        self.goal().success(step, terminated, memory) & highest.le(highest.splat(self.freeboard))
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        self.goal().reward(step, terminated, memory, terms);
        let squared = memory.get(SLOPE[0]).squared() + memory.get(SLOPE[1]).squared();
        terms.term(
            Term::cost("slosh", 0.3, "h² / (h² + (0.5 `freeboard`)²), h the height of the water at the wall"),
            bounded_error(squared, 0.5 * self.freeboard / self.glass_radius),
        );
    }

    fn measure(&self, memory: &[f64], control_dt: f64, metrics: &mut impl Metrics) {
        self.goal().measure(&memory[..Goal::MEMORY], control_dt, metrics);
        metrics.metric(
            Metric::new("spilled", "", "1 if water has spilled, else 0"),
            f64::from(u8::from(memory[HIGHEST] > self.freeboard)),
        );
        metrics.metric(Metric::new("slosh", "m", "largest height of the water at the wall"), memory[HIGHEST]);
        metrics.metric(
            Metric::new("tray_acceleration", "m/s²", "rms of the force per mass of the glass in the plane of the tray"),
            (memory[FORCE] / memory[STEPS]).sqrt(),
        );
    }
}

impl Carry {
    /// The task of going to the goals.
    #[inline(always)]
    fn goal(&self) -> Goal {
        Goal {
            goal_distance: self.goal_distance,
            goal_seconds: self.goal_seconds,
            goal_radius: self.goal_radius,
            approach_acceleration: self.approach_acceleration,
            approach_time: self.approach_time,
            hold_seconds: self.hold_seconds,
            reset_tilt: self.reset_tilt,
            reset_yaw: self.reset_yaw,
            reset_ball_speed: self.reset_ball_speed,
            reset_tilt_rate: self.reset_tilt_rate,
            reset_yaw_rate: self.reset_yaw_rate,
            fall_tilt: self.fall_tilt,
        }
    }
}

/// A slope that is simulated.
#[inline(always)]
fn limited<L: Lane>(slope: L) -> L {
    slope.max(slope.splat(-STEEPEST)).min(slope.splat(STEEPEST))
}

/// Matrix of x, x' after `dt` seconds of x'' + 2 ζ ω x' + ω² x = 0.
fn transition(omega: f64, damping: f64, dt: f64) -> [[f64; 2]; 2] {
    let decay = damping * omega;
    let squared = omega * omega * (1.0 - damping * damping);
    let turned = squared.abs().sqrt() * dt;
    // cos and sin / rate of the damped frequency, or their hyperbolic counterparts of an overdamped mode, with the decay.
    let scale = (-decay * dt).exp();
    let (cos, sine) = if turned < 1e-6 {
        (scale, scale * dt)
    } else if squared > 0.0 {
        (scale * turned.cos(), scale * turned.sin() * dt / turned)
    } else {
        // The hyperbolic functions alone overflow.
        let (slow, fast) = ((turned - decay * dt).exp(), (-turned - decay * dt).exp());
        (0.5 * (slow + fast), 0.5 * (slow - fast) * dt / turned)
    };
    [[cos + decay * sine, sine], [-omega * omega * sine, cos - decay * sine]]
}
