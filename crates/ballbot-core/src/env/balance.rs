//! The balance task: keep the robot upright and the ball at the setpoint.

use super::reward::{RewardScales, RewardTerms};
use crate::error::{Error, Result, check, finite, positive};
use crate::lane_state::MAX_RATE;
use crate::params::Params;
use crate::robot::ModelKind;
use crate::state::{State, attitude};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Everything that defines the task. SI units and radians.
#[derive(Clone, Debug, PartialEq)]
pub struct BalanceConfig {
    /// The robot.
    pub params: Params,
    /// Its model.
    pub model: ModelKind,
    /// Time step of the model, s.
    pub sim_dt: f64,
    /// Time between two actions, s; a whole multiple of `sim_dt`.
    pub control_dt: f64,
    /// Steps after which an episode is truncated.
    pub max_episode_steps: usize,
    /// Torque of an action of 1, N·m; at most the motors' limit.
    pub max_wheel_torque: f64,
    /// Where the ball should be, m.
    pub setpoint: [f64; 2],
    /// Half angle of the cone from which the first tilt is drawn, evenly over its opening, rad.
    pub reset_tilt: f64,
    /// The first yaw is drawn evenly within ± this, rad.
    pub reset_yaw: f64,
    /// Largest first ball speed, m/s; drawn evenly over the disc.
    pub reset_ball_speed: f64,
    /// Largest first tilt rate, rad/s; drawn evenly over the disc.
    pub reset_tilt_rate: f64,
    /// Tilt above which the episode is terminated, rad.
    pub fall_tilt: f64,
    /// The end of the episode over which success is judged, s.
    pub success_window: f64,
    /// Largest tilt in that window, rad.
    pub success_tilt: f64,
    /// Largest distance of the ball from the setpoint in that window, m.
    pub success_radius: f64,
    /// Weights of the reward's terms.
    pub reward: RewardScales,
}

impl Default for BalanceConfig {
    fn default() -> Self {
        Self {
            params: Params::paper(),
            model: ModelKind::Rigid,
            sim_dt: 0.002,
            control_dt: 0.01,
            max_episode_steps: 1000,
            max_wheel_torque: 1.0,
            setpoint: [0.0; 2],
            reset_tilt: 5.0_f64.to_radians(),
            reset_yaw: PI,
            reset_ball_speed: 0.1,
            reset_tilt_rate: 0.2,
            fall_tilt: 20.0_f64.to_radians(),
            success_window: 2.0,
            success_tilt: 1.0_f64.to_radians(),
            success_radius: 0.1,
            reward: RewardScales::default(),
        }
    }
}

/// Why an episode was terminated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Termination {
    /// The tilt exceeded `fall_tilt`.
    Tilt = 1,
    /// The body or a wheel touched the floor.
    BotOnFloor = 2,
    /// The state left the simulation's bounds.
    Diverged = 3,
}

impl Termination {
    /// All reasons.
    pub const ALL: [Self; 3] = [Self::Tilt, Self::BotOnFloor, Self::Diverged];

    /// The word by which an info names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tilt => "tilt",
            Self::BotOnFloor => "bot_on_floor",
            Self::Diverged => "diverged",
        }
    }
}

impl BalanceConfig {
    /// Model steps in one control step.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if `control_dt` is not a whole multiple of `sim_dt`.
    pub fn substeps(&self) -> Result<usize> {
        positive("sim_dt", self.sim_dt)?;
        positive("control_dt", self.control_dt)?;
        let ratio = self.control_dt / self.sim_dt;
        check(
            "control_dt / sim_dt",
            ratio,
            format!("a whole number from 1 to 10000 (control_dt = {}, sim_dt = {})", self.control_dt, self.sim_dt),
            |r| (r - r.round()).abs() <= 1e-6 * r && (0.5..10000.5).contains(&r),
        )?;
        Ok(ratio.round() as usize)
    }

    /// Steps of the success window; the last step is always among them.
    pub(super) fn success_steps(&self) -> usize {
        ((self.success_window / self.control_dt).round() as usize).max(1)
    }

    /// Checks that the task can be run.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`] naming the value and the limit.
    pub fn validate(&self) -> Result<()> {
        self.params.validate()?;
        self.substeps()?;
        if self.max_episode_steps == 0 {
            return Err(Error::Inconsistent("max_episode_steps = 0, it must be at least 1".into()));
        }
        positive("max_wheel_torque", self.max_wheel_torque)?;
        let motor = self.params.max_wheel_torque;
        check(
            "max_wheel_torque",
            self.max_wheel_torque,
            format!("at most the motors' limit, params.max_wheel_torque = {motor} N·m"),
            |t| t <= motor,
        )?;
        finite("setpoint", &self.setpoint)?;
        let fall = self.fall_tilt;
        check("fall_tilt", fall, "between 0 and pi rad", |t| t > 0.0 && t <= PI)?;
        check("reset_tilt", self.reset_tilt, format!("from 0 to below fall_tilt = {fall}"), |t| t >= 0.0 && t < fall)?;
        check("reset_yaw", self.reset_yaw, "from 0 to pi rad", |v| (0.0..=PI).contains(&v))?;
        check("reset_ball_speed", self.reset_ball_speed, "from 0 to 10 m/s", |v| (0.0..=10.0).contains(&v))?;
        check("reset_tilt_rate", self.reset_tilt_rate, "from 0 to 10 rad/s", |v| (0.0..=10.0).contains(&v))?;
        let fastest = (self.reset_ball_speed / self.params.ball_radius + self.reset_tilt_rate)
            * self.params.gear_ratio().max(1.0);
        check(
            "the fastest first wheel or ball rate, from reset_ball_speed and reset_tilt_rate,",
            fastest,
            format!("at most {} rad/s", 0.5 * MAX_RATE),
            |rate| rate <= 0.5 * MAX_RATE,
        )?;
        check("success_window", self.success_window, ">= 0 s", |v| v >= 0.0)?;
        positive("success_tilt", self.success_tilt)?;
        positive("success_radius", self.success_radius)?;
        let r = &self.reward;
        for (name, scale) in
            RewardTerms::NAMES.iter().zip([r.alive, r.tilt, r.position, r.velocity, r.rate, r.action, r.action_change])
        {
            check(format!("reward.{name}"), scale, "within ±1e6", |s| s.abs() <= 1e6)?;
        }
        Ok(())
    }

    /// The starts that come nearest to the floor: leaning as far as they may, over each of the wheels.
    pub(super) fn lowest_starts(&self) -> [State; 3] {
        self.params.wheel_azimuths.map(|azimuth| {
            let about = Vector2::new(-azimuth.sin(), azimuth.cos());
            State::tilted(&self.params, about * self.reset_tilt, 0.0)
        })
    }

    /// The first state of an episode: rolling without slip, the ball at the origin.
    pub(super) fn draw_start(&self, rng: &mut ChaCha8Rng) -> State {
        let tilt = in_disc(rng, self.reset_tilt);
        let yaw = self.reset_yaw * (2.0 * rng.random::<f64>() - 1.0);
        let velocity = in_disc(rng, self.reset_ball_speed);
        let rate = in_disc(rng, self.reset_tilt_rate);
        let attitude = attitude(tilt, yaw);
        State::rolling(&self.params, velocity, 0.0, attitude, Vector3::new(rate.x, rate.y, 0.0))
    }
}

/// A point drawn evenly from a disc.
fn in_disc(rng: &mut ChaCha8Rng, radius: f64) -> Vector2<f64> {
    let radius = radius * rng.random::<f64>().sqrt();
    let angle = TAU * rng.random::<f64>();
    Vector2::new(angle.cos(), angle.sin()) * radius
}
