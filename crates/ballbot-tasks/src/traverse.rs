//! The terrain task: follow a commanded velocity over uneven ground, on tiles of rising difficulty.

use super::shared::{bounded_error, squared_norm};
use super::start::{check_range, drawn_steps, in_range, starts_and_falls, task_fields};
use super::velocity::{MOTION, POSITION, Velocity};
use super::{Geometry, Metric, Metrics, Moment, Row, Rows, Sensed, Step, Task, Term, Terms};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Heading, Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_base::terrain::Terrain;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

task_fields! {
    fall 30.0, tilt 5.0;
    /// Options of the terrain task. SI units and radians. Tilts are from the equilibrium.
    pub struct Traverse {
        /// Smallest and largest commanded speed, uniform, in any direction of the heading frame.
        pub speed_range: [f64; 2] = [0.2, 0.5], "m/s", Limit::from(0.0).to(10.0), scaled;
        /// Shortest and longest time from one command to the next, uniform.
        pub command_seconds: [f64; 2] = [20.0, 20.0], "s", Limit::above(0.0).to(1e9);
        /// The motion that a controller tracks follows the command with three poles at minus this value.
        pub smoothing: f64 = 4.0, "1/s", Limit::above(0.0).to(1e3), scaled;
        /// Error of the velocity that costs half of `velocity`, and of `velocity_precision`.
        pub velocity_scales: [f64; 2] = [0.2, 0.04], "m/s", Limit::from(1e-6).to(10.0), scaled;
        /// Error of the heading's rate that costs half of `yaw_rate`, and of `yaw_rate_precision`.
        pub yaw_rate_scales: [f64; 2] = [0.5, 0.1], "rad/s", Limit::from(1e-6).to(10.0), scaled;
        /// Distance from where the commands lead that costs half of `position`.
        pub position_scale: f64 = 0.3, "m", Limit::from(1e-6).to(100.0), scaled;
        /// Steepest level of the terrain where none is chosen, as a fraction of the slope that the robot can hold.
        pub hardest: f64 = 0.7, "", Limit::from(0.0).to(1.0);
        /// Smallest fraction of the distance of the smoothed command in a success.
        pub success_share: f64 = 0.8, "", Limit::from(0.0).to(1.0);
    }
}

/// Memory: the memory of the velocity task, the distances of the smoothed command and of the ball in the commanded
/// direction, m, and the level.
const COMMANDED: usize = Velocity::MEMORY;
const TRAVELLED: usize = Velocity::MEMORY + 1;
const LEVEL: usize = Velocity::MEMORY + 2;

/// Levels of the terrain where none is chosen.
const LEVELS: f64 = 5.0;

/// Wavelength of that terrain in radii of the ball, and the minimum of the same per unit of the slope's tangent:
/// valleys then have less than half the curvature of the ball.
const WAVELENGTH: f64 = 12.0;
const WAVELENGTH_OF_SLOPE: f64 = 50.0;

impl Traverse {
    /// The velocity task with these options.
    #[inline(always)]
    fn velocity(&self) -> Velocity {
        Velocity {
            speed: self.speed_range[1],
            yaw_rate: 0.0,
            standing: 0.0,
            command_seconds: self.command_seconds,
            smoothing: self.smoothing,
            settling: 0.0,
            velocity_scales: self.velocity_scales,
            yaw_rate_scales: self.yaw_rate_scales,
            success_velocity: 1.0,
            success_yaw_rate: 1.0,
            reset_tilt: self.reset_tilt,
            reset_yaw: self.reset_yaw,
            reset_ball_speed: self.reset_ball_speed,
            reset_tilt_rate: self.reset_tilt_rate,
            reset_yaw_rate: self.reset_yaw_rate,
            fall_tilt: self.fall_tilt,
        }
    }
}

/// The vector from the ball to where the commands since the start lead, heading frame, m.
#[inline(always)]
fn behind<L: Lane>(state: &LaneState<L>, memory: &Memory<'_, L>) -> [L; 2] {
    let [x, y] = [memory.get(POSITION), memory.get(POSITION + 1)];
    Heading::new(state.body_quaternion).of(x - state.ball_position.x, y - state.ball_position.y)
}

impl Task for Traverse {
    const NAME: &'static str = "terrain";
    const ID: &'static str = "ballbot/Terrain-v0";
    const SUMMARY: &'static str = "Follow a commanded velocity over uneven ground.";
    const REWARD_THRESHOLD: Option<f64> = Some(650.0);
    const SUCCESS: &'static str =
        "not terminated, and `success_share` of the distance of the smoothed command traveled";
    const ANYWHERE: bool = true;
    const HAS_TERRAIN: bool = true;
    const GEOMETRY: Option<Geometry> = Some(Geometry::Velocity);
    const COMMAND: &'static [Row] = Velocity::COMMAND;
    const MEMORY: usize = LEVEL + 1;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("speed_range", self.speed_range)?;
        check_range("command_seconds", self.command_seconds)?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn terrain(&self, params: &Params) -> Result<Option<Arc<Terrain>>> {
        let slope = self.hardest * params.slope_limits(self.fall_tilt.min(FRAC_PI_2))?.smallest();
        let wavelength = params.ball_radius * WAVELENGTH.max(WAVELENGTH_OF_SLOPE * slope.tan());
        let cell = wavelength / 30.0;
        let parameters = [("slope", slope), ("levels", LEVELS), ("wavelength", wavelength), ("cell", cell)];
        Terrain::shared("levels", 0, &parameters).map(Some)
    }

    fn command(&self, moment: &Moment<'_>, rng: &mut ChaCha8Rng, memory: &mut [f64]) -> f64 {
        let speed = in_range(rng, self.speed_range);
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        memory[..3].copy_from_slice(&[speed * cos, speed * sin, 0.0]);
        memory[LEVEL] = moment.level as f64;
        drawn_steps(self.command_seconds, moment.control_dt, rng)
    }

    fn commanded(&self, moment: &Moment<'_>, memory: &mut [f64]) {
        self.velocity().commanded(moment, memory);
    }

    fn share(&self, memory: &[f64]) -> f64 {
        if memory[COMMANDED] > 0.0 { memory[TRAVELLED] / memory[COMMANDED] } else { 1.0 }
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        self.velocity().setpoint(memory)
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        self.velocity().observe(sensed, memory, rows);
        let [x, y] = behind(sensed.state, memory);
        rows.row(Row::new("way to where the commands lead, heading x", "m", 1.0, 0.2), x);
        rows.row(Row::new("way to where the commands lead, heading y", "m", 1.0, 0.2), y);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        self.velocity().advance(step, memory);
        let [x, y, _] = memory.get3(0);
        let velocity = step.state.ball_velocity;
        let [vx, vy] = Heading::new(step.state.body_quaternion).of(velocity.x, velocity.y);
        let speed = x.mul_add(x, y.squared()).sqrt();
        let least = speed.splat(1e-9);
        let along = |vx: L, vy: L| x.mul_add(vx, y * vy) / speed.max(least) * step.control_dt;
        let commanded = along(memory.get(MOTION), memory.get(MOTION + 1));
        memory.set(COMMANDED, memory.get(COMMANDED) + commanded);
        memory.set(TRAVELLED, memory.get(TRAVELLED) + along(vx, vy));
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, memory: &mut Memory<'_, L>) -> L::Mask {
        !terminated & (memory.get(COMMANDED) * self.success_share).le(memory.get(TRAVELLED))
    }

    #[inline(always)]
    fn reward<L: Lane>(
        &self,
        step: &Step<'_, L>,
        terminated: L::Mask,
        memory: &Memory<'_, L>,
        terms: &mut impl Terms<L>,
    ) {
        self.velocity().reward(step, terminated, memory, terms);
        terms.term(
            Term::cost("position", 0.1, "d² / (d² + position_scale²), d the distance from where the commands lead"),
            bounded_error(squared_norm(behind(step.state, memory)), self.position_scale),
        );
    }

    fn measure(&self, memory: &[f64], control_dt: f64, metrics: &mut impl Metrics) {
        self.velocity().measure(memory, control_dt, metrics);
        metrics.metric(
            Metric::new("share", "", "distance of the ball in the commanded direction, over the smoothed command's"),
            memory[TRAVELLED] / memory[COMMANDED],
        );
        metrics.metric(Metric::new("level", "", "level of the tile of the terrain, from 0 on"), memory[LEVEL]);
    }
}
