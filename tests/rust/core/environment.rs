//! The balance task: starts, observations, rewards, ends of episodes ([`episodes`]) and scaled observations
//! ([`scaling`]).

mod episodes;
mod scaling;

use ballbot_core::batch::{BalanceConfig, Environment, Outcome};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::task::{ACTION_LEN, Balance, Row, TaskDescription};
use ballbot_core::{Error, ModelKind, Params, State, attitude};
use nalgebra::{Rotation3, UnitQuaternion, Vector2, Vector3};
use std::f64::consts::PI;

/// Length of an observation.
const OBSERVATION_LEN: usize = 16;

type Observation = [f32; OBSERVATION_LEN];

/// Description of the observation.
fn rows() -> Vec<Row> {
    TaskDescription::of::<Balance>().rows
}

fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig { model, max_wheel_torque: Some(1.0), scale_observations: false, ..BalanceConfig::default() }
}

/// An environment and its last observation.
struct Episode {
    env: Environment,
    seen: Observation,
}

impl Episode {
    fn new(config: &BalanceConfig, seed: u64) -> Self {
        let mut episode = Self { env: Environment::new(config, seed).unwrap(), seen: [0.0; OBSERVATION_LEN] };
        episode.reset();
        episode
    }

    fn from(config: &BalanceConfig, start: &State) -> Self {
        let mut episode = Self::new(config, 0);
        episode.env.reset_to(start, &mut episode.seen).unwrap();
        episode
    }

    fn reset(&mut self) {
        self.env.reset(&mut self.seen);
    }

    fn step(&mut self, action: [f32; ACTION_LEN]) -> Outcome {
        self.env.step(&action, &mut self.seen)
    }

    /// A step under the regulator, towards a point in the initial heading.
    fn regulated(&mut self, position: Vector2<f64>) -> Outcome {
        let config = self.env.config();
        let mut lqr = Lqr::new(&config.params, config.control_dt).unwrap();
        let state = self.env.robot().state();
        let setpoint = Setpoint { position, yaw: state.yaw(), ..Setpoint::default() };
        let torques = lqr.wheel_torques(&state, &setpoint);
        self.step(torques.map(|torque| (torque / config.action_torque()) as f32).0)
    }

    /// Steps until the episode ends; returns how many, and the last outcome.
    fn finish(&mut self, mut step: impl FnMut(&mut Self) -> Outcome) -> (usize, Outcome) {
        for k in 1..=10_000 {
            assert!(!self.env.over());
            let outcome = step(self);
            assert_eq!(self.env.over(), outcome.done());
            if outcome.done() {
                return (k, outcome);
            }
        }
        panic!("the episode does not end");
    }
}

/// Tilted, yawed, rolling and turning, away from the origin.
fn lively(yaw: f64) -> State {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let tilt = (turn * Vector3::new(0.12, -0.2, 0.0)).xy();
    let velocity = (turn * Vector3::new(0.3, -0.4, 0.0)).xy();
    let rate = Vector3::new(0.4, -0.3, 0.8);
    let mut state = State::rolling(&Params::paper(), velocity, 0.7, attitude(tilt, yaw), rate);
    state.ball_position += turn * Vector3::new(0.05, -0.07, 0.0);
    state.body_position = state.ball_position;
    state
}

#[track_caller]
fn assert_seen(seen: &Observation, expected: &[f64], tolerance: f64) {
    for ((found, expected), row) in seen.iter().zip(expected).zip(rows()) {
        assert!((f64::from(*found) - expected).abs() <= tolerance, "{}: {found}, expected {expected}", row.name);
    }
}

/// A horizontal part of a state.
type Component = fn(&State) -> Vector2<f64>;

#[test]
fn starts_are_uniform_over_their_discs() {
    let config = config(ModelKind::Spatial);
    let mut episode = Episode::new(&config, 3);
    let n = 4000;
    let starts: Vec<State> = (0..n)
        .map(|_| {
            episode.reset();
            episode.env.robot().state()
        })
        .collect();
    let discs: [(f64, Component); 3] = [
        (config.task.reset_tilt, State::tilt_components),
        (config.task.reset_ball_speed, |s| s.ball_velocity.xy()),
        (config.task.reset_tilt_rate, |s| s.body_angular_velocity.xy()),
    ];
    // Four standard errors of each mean over an evenly filled disc.
    let four_sigma = 4.0 / f64::from(n).sqrt();
    let mean = |f: &dyn Fn(&State) -> f64| starts.iter().map(f).sum::<f64>() / f64::from(n);
    for (radius, of) in discs {
        assert!(starts.iter().all(|s| of(s).norm() <= radius * (1.0 + 1e-12)), "outside the disc of {radius}");
        let distance = mean(&|s| of(s).norm() / radius);
        assert!((distance - 2.0 / 3.0).abs() < 0.2357 * four_sigma, "mean distance {distance} of {radius}");
        let inner = mean(&|s| f64::from(of(s).norm() < 0.5 * radius));
        assert!((inner - 0.25).abs() < 0.433 * four_sigma, "{inner} of the starts within half of {radius}");
        let center = [mean(&|s| of(s).x / radius), mean(&|s| of(s).y / radius)];
        assert!(center.iter().all(|c| c.abs() < 0.5 * four_sigma), "center {center:?} of {radius}");
    }
    // Any heading: mean 0 and variance 1/3 of yaw / π.
    assert!(mean(&|s| s.yaw() / PI).abs() < 3.0_f64.sqrt().recip() * four_sigma);
    assert!((mean(&|s| (s.yaw() / PI).powi(2)) - 1.0 / 3.0).abs() < 0.298 * four_sigma);
    for state in &starts {
        assert_eq!(state.ball_position, Vector3::new(0.0, 0.0, config.params.ball_radius));
        assert_eq!(state.body_angular_velocity.z, 0.0);
    }
}

#[test]
fn robots_that_start_turning_start_as_others_otherwise() {
    let still = config(ModelKind::Spatial);
    let mut turning = config(ModelKind::Spatial);
    turning.task.reset_yaw_rate = 0.5;
    let (mut a, mut b) = (Episode::new(&still, 3), Episode::new(&turning, 3));
    let n = 2000;
    let mut rates = Vec::with_capacity(n);
    for seed in 0..n {
        let [a, b] = [&mut a, &mut b].map(|episode| {
            episode.env.seed(seed as u64);
            episode.reset();
            episode.env.robot().state()
        });
        assert_eq!((a.body_quaternion, a.ball_velocity), (b.body_quaternion, b.ball_velocity));
        assert_eq!(a.ball_angular_velocity, b.ball_angular_velocity);
        assert_eq!(a.body_angular_velocity.xy(), b.body_angular_velocity.xy());
        rates.push(b.body_angular_velocity.z / 0.5);
    }
    assert!(rates.iter().all(|rate| rate.abs() <= 1.0));
    // Four standard errors of a uniform distribution over ±1.
    let mean = |f: &dyn Fn(f64) -> f64| rates.iter().map(|&rate| f(rate)).sum::<f64>() / n as f64;
    let four_sigma = 4.0 / (n as f64).sqrt();
    assert!(mean(&|rate| rate).abs() < 3.0_f64.sqrt().recip() * four_sigma);
    assert!((mean(&|rate| rate * rate) - 1.0 / 3.0).abs() < 0.298 * four_sigma);
}

#[test]
fn start_depends_only_on_the_seed() {
    let start = |model, seed| Episode::new(&config(model), seed).seen;
    let expected = start(ModelKind::Spatial, 5);
    assert_eq!(start(ModelKind::Spatial, 5), expected);
    assert_ne!(start(ModelKind::Spatial, 6), expected);
    assert_seen(&start(ModelKind::Rigid, 5), &expected.map(f64::from), 1e-6);
    let mut episode = Episode::new(&config(ModelKind::Spatial), 99);
    episode.env.seed(5);
    episode.reset();
    assert_eq!(episode.seen, expected);
    let mut narrow = config(ModelKind::Spatial);
    (narrow.task.reset_yaw, narrow.task.reset_tilt) = (0.1, 0.0);
    for seed in 0..50 {
        let state = Episode::new(&narrow, seed).env.robot().state();
        assert!(state.yaw().abs() <= 0.1 && state.tilt() < 1e-12);
    }
}

#[test]
fn observation_rows_equal_the_state() {
    let (yaw, setpoint) = (2.0, Vector2::new(0.5, 0.25));
    let state = lively(yaw);
    for model in [ModelKind::Spatial, ModelKind::Rigid] {
        let mut config = config(model);
        config.task.setpoint = setpoint.into();
        let mut episode = Episode::from(&config, &state);
        let heading = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
        let tilt = heading * Vector3::new(0.12, -0.2, 0.0);
        let down = (Rotation3::from_scaled_axis(tilt) * heading).transpose() * Vector3::new(0.0, 0.0, -1.0);
        let position = heading.transpose() * (state.ball_position - setpoint.push(0.0));
        let velocity = heading.transpose() * state.ball_velocity;
        assert!((velocity - Vector3::new(0.3, -0.4, 0.0)).norm() < 1e-12);
        let mut expected = vec![down.x, down.y, down.z, 0.4, -0.3, 0.8];
        expected.extend(state.wheel_speeds);
        expected.extend([position.x, position.y, velocity.x, velocity.y, 0.0, 0.0, 0.0]);
        assert_seen(&episode.seen, &expected, 2e-6);
        episode.step([0.25, -0.5, 0.125]);
        assert_eq!(episode.seen[13..], [0.25, -0.5, 0.125]);
    }
}

#[test]
fn observation_saturates_at_its_bounds() {
    let body = attitude(Vector2::zeros(), 0.0);
    let rate = Vector3::new(50.0, -60.0, 70.0);
    let mut state = State::rolling(&Params::paper(), Vector2::new(-40.0, 45.0), -1500.0, body, rate);
    state.ball_position += Vector3::new(30.0, -40.0, 0.0);
    state.body_position = state.ball_position;
    let seen = Episode::from(&config(ModelKind::Spatial), &state).seen;
    let rows = rows();
    for (i, sign) in [(3, 1.0), (4, -1.0), (5, 1.0), (9, 1.0), (10, -1.0), (11, -1.0), (12, 1.0)] {
        assert_eq!(seen[i], sign * rows[i].bound, "{}", rows[i].name);
    }
    assert!(state.wheel_speeds.iter().all(|speed| *speed < -200.0), "{:?}", state.wheel_speeds);
    assert_eq!(seen[6..9], [-200.0; 3]);
    let bounds: Vec<f32> = rows.iter().map(|row| row.bound).collect();
    assert_eq!(bounds[..9], [1.0, 1.0, 1.0, 20.0, 20.0, 20.0, 200.0, 200.0, 200.0]);
    assert_eq!(bounds[9..], [10.0, 10.0, 10.0, 10.0, 1.0, 1.0, 1.0]);
}

#[test]
fn observations_and_rewards_are_invariant_under_setpoint_and_heading() {
    for (model, tolerance) in [(ModelKind::Spatial, 1e-5), (ModelKind::Rigid, 1e-4)] {
        let mut episode = Episode::from(&config(model), &lively(0.0));
        for (yaw, setpoint) in [(2.0, [3.0, -1.0]), (-2.7, [-0.5, 8.0])] {
            let mut state = lively(yaw);
            state.ball_position += Vector3::new(setpoint[0], setpoint[1], 0.0);
            state.body_position = state.ball_position;
            let mut config = config(model);
            config.task.setpoint = setpoint;
            let mut moved = Episode::from(&config, &state);
            episode.env.reset_to(&lively(0.0), &mut episode.seen).unwrap();
            assert_seen(&moved.seen, &episode.seen.map(f64::from), 2e-6);
            for k in 0..15_u8 {
                let action = [0.1, -0.05, 0.02].map(|a| a * f32::from(k % 3));
                let (found, expected) = (moved.step(action).reward, episode.step(action).reward);
                assert!((found - expected).abs() < tolerance, "{model}: reward {found}, expected {expected}");
                assert_seen(&moved.seen, &episode.seen.map(f64::from), tolerance);
            }
        }
    }
}

#[test]
fn actions_beyond_their_bounds_are_clipped() {
    for model in ModelKind::ALL {
        let run = |action| {
            let mut episode = Episode::from(&config(model), &State::upright(&Params::paper()));
            let outcomes = [episode.step(action), episode.step(action)];
            (episode.seen, outcomes)
        };
        assert_eq!(run([2.0, -30.0, 0.5]), run([1.0, -1.0, 0.5]), "{model}");
        assert_ne!(run([0.9, -1.0, 0.5]), run([1.0, -1.0, 0.5]), "{model}");
    }
}

#[test]
fn torque_is_the_action_times_the_action_torque() {
    let config = BalanceConfig { max_wheel_torque: Some(0.8), ..config(ModelKind::Spatial) };
    let mut episode = Episode::from(&config, &lively(0.3));
    episode.step([0.5, -0.25, 0.125]);
    let mut robot = ballbot_core::Ballbot::new(&config.params, config.model, config.sim_dt).unwrap();
    robot.reset(&lively(0.3)).unwrap();
    robot.step([0.4, -0.2, 0.1], 5).unwrap();
    assert_eq!(episode.env.robot().state(), robot.state());
}

#[test]
fn reward_is_the_sum_of_its_terms() {
    let mut config = config(ModelKind::Spatial);
    config.task.setpoint = [0.1, 0.05];
    let scales = [
        ("alive", 2.0),
        ("tilt", 3.0),
        ("position", 5.0),
        ("velocity", 7.0),
        ("yaw_rate", 19.0),
        ("rate", 0.11),
        ("action", 13.0),
        ("action_change", 17.0),
    ];
    for (name, scale) in scales {
        config.reward.set(name, scale).unwrap();
    }
    let mut episode = Episode::from(&config, &lively(0.0));
    episode.step([0.5, 0.0, -0.5]);
    let outcome = episode.step([0.25, 1.0, -0.5]);
    let state = episode.env.robot().state();
    let distance = (state.ball_position.xy() - Vector2::new(0.1, 0.05)).norm_squared();
    let yaw_rate = state.body_angular_velocity.z.powi(2);
    let expected = [
        2.0,
        -3.0 * (state.tilt() / config.task.fall_tilt).powi(2),
        -5.0 * distance / (distance + 0.01),
        -7.0 * state.ball_velocity.xy().norm_squared(),
        -19.0 * yaw_rate / (yaw_rate + 4e-4),
        -0.11 * state.body_angular_velocity.norm_squared(),
        -13.0 * (0.0625 + 1.0 + 0.25) / 3.0,
        -17.0 * (0.0625 + 1.0) / 3.0,
    ];
    let terms = episode.env.reward_terms();
    assert_eq!(terms.iter().map(|(name, _)| *name).collect::<Vec<_>>(), scales.map(|(name, _)| name));
    for ((name, found), expected) in terms.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12 && expected.abs() > 0.01, "{name}: {found}, expected {expected}");
    }
    assert_eq!(outcome.reward, terms.iter().map(|(_, value)| value).sum::<f64>());
    // A first action changes from rest.
    let mut episode = Episode::from(&config, &lively(0.0));
    episode.step([0.5, 0.0, -0.5]);
    assert!((episode.env.reward_terms()[7].1 + 17.0 * 0.5 / 3.0).abs() < 1e-12);
}

/// Asserts that a changed configuration is rejected with a message that names the value.
#[track_caller]
fn assert_rejected(words: &str, change: impl FnOnce(&mut BalanceConfig)) {
    let mut config = config(ModelKind::Rigid);
    change(&mut config);
    let error = Environment::new(&config, 0).err().expect(words);
    assert!(matches!(error, Error::OutOfRange { .. } | Error::Inconsistent(_)), "{error:?}");
    assert!(error.to_string().contains(words), "'{error}' does not contain '{words}'");
}

#[test]
fn invalid_configurations_are_rejected() {
    assert_rejected("control_dt / sim_dt = 2.5 is out of range: it must be a whole number", |c| c.control_dt = 0.005);
    assert_rejected("(control_dt = 0.001, sim_dt = 0.002)", |c| c.control_dt = 0.001);
    assert_rejected("control_dt / sim_dt = 20000 ", |c| c.control_dt = 40.0);
    assert_rejected("control_dt = NaN ", |c| c.control_dt = f64::NAN);
    assert_rejected("sim_dt = 0 ", |c| c.sim_dt = 0.0);
    assert_rejected("sim_dt = 0.025 ", |c| (c.sim_dt, c.control_dt) = (0.025, 0.05));
    assert_rejected("max_episode_steps = 0", |c| c.max_episode_steps = 0);
    assert_rejected("max_wheel_torque = 0 ", |c| c.max_wheel_torque = Some(0.0));
    assert_rejected("max_wheel_torque = 6 ", |c| c.max_wheel_torque = Some(6.0));
    assert_rejected("params.max_wheel_torque = 0.5 N·m", |c| c.params.max_wheel_torque = 0.5);
    assert_rejected("setpoint[1] = inf ", |c| c.task.setpoint[1] = f64::INFINITY);
    assert_rejected("fall_tilt = 0 ", |c| c.task.fall_tilt = 0.0);
    assert_rejected("fall_tilt = 3.2 ", |c| c.task.fall_tilt = 3.2);
    assert_rejected("reset_tilt = 0.4 ", |c| c.task.reset_tilt = 0.4);
    assert_rejected("reset_tilt = -0.1 ", |c| c.task.reset_tilt = -0.1);
    assert_rejected("reset_yaw = 3.2 ", |c| c.task.reset_yaw = 3.2);
    assert_rejected("reset_ball_speed = 11 ", |c| c.task.reset_ball_speed = 11.0);
    assert_rejected("reset_tilt_rate = NaN ", |c| c.task.reset_tilt_rate = f64::NAN);
    assert_rejected("reset_yaw_rate = 11 ", |c| c.task.reset_yaw_rate = 11.0);
    assert_rejected("success_window = -1 ", |c| c.task.success_window = -1.0);
    assert_rejected("success_tilt = 0 ", |c| c.task.success_tilt = 0.0);
    assert_rejected("success_radius = -0.1 ", |c| c.task.success_radius = -0.1);
    assert_rejected("reward.action_change = NaN ", |c| {
        c.reward.set("action_change", f64::NAN).unwrap();
    });
    assert_rejected("gravity = 0 ", |c| c.params.gravity = 0.0);
    // Ratios that are whole except for rounding.
    for (sim_dt, control_dt, expected) in [(0.01, 0.07, 7), (0.001, 0.043, 43), (0.02, 0.02, 1)] {
        assert_eq!(BalanceConfig { sim_dt, control_dt, ..config(ModelKind::Rigid) }.substeps().unwrap(), expected);
    }
}

#[test]
fn tasks_whose_starts_reach_into_the_floor_are_rejected() {
    // The first wheel meets the floor where r_k + (r_k + r_w) cos(tilt + zenith) = r_w: 67.5 deg for the paper's robot.
    let params = Params::paper();
    let arm = params.ball_radius + params.wheel_radius;
    let first = ((params.wheel_radius - params.ball_radius) / arm).acos() - params.wheel_zenith;
    let task = |reset_tilt: f64| {
        let mut config = config(ModelKind::Rigid);
        (config.task.reset_tilt, config.task.fall_tilt) = (reset_tilt, 3.0);
        config
    };
    let message = Environment::new(&task(first + 0.02), 0).err().expect("accepted").to_string();
    let words = "the robot cannot start where the task may place it: height of the lowest point of the wheels = -0.0";
    assert!(message.starts_with(words), "{message}");
    assert!(Environment::new(&task(2.0), 0).is_err());
    let allowed = task(first - 0.02);
    let mut observation = [0.0; OBSERVATION_LEN];
    for seed in 0..200 {
        Environment::new(&allowed, seed).unwrap().reset(&mut observation);
    }
}
