//! Robots, states and torques that tests are sampled from, the same for all tests.

// Every test uses some of these.
#![allow(dead_code)]

pub mod general;

use ballbot_core::{Params, State};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use proptest::array::uniform3;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

/// Each component within ± `largest`.
pub fn vector(largest: f64) -> impl Strategy<Value = Vector3<f64>> {
    uniform3(-largest..largest).prop_map(Vector3::from)
}

/// Any attitude, including upside down.
pub fn any_attitude() -> impl Strategy<Value = UnitQuaternion<f64>> {
    vector(3.0).prop_map(UnitQuaternion::from_scaled_axis)
}

/// Any plausible ballbot: built from a ball, a body link and three wheels, and therefore physically possible.
pub fn any_robot() -> impl Strategy<Value = Params> {
    let parts = (any_frame(), any_joint_friction(), any_contact_friction(), 0.02..0.2);
    parts.prop_map(|(frame, [drag, viscous, dry], [wheel, floor], critical_velocity)| {
        let params = Params {
            // Maximum lost in a second of rolling.
            ball_viscous_friction: drag * (frame.ball_mass + frame.body_mass),
            wheel_viscous_friction: viscous * frame.wheel_inertia,
            // As a fraction of the torque that makes the wheel slip.
            wheel_coulomb_friction: 0.2 * dry * frame.static_wheel_load() * frame.wheel_radius,
            wheel_dynamic_friction: wheel.0,
            wheel_static_friction: wheel.0 + wheel.1,
            floor_dynamic_friction: floor.0,
            floor_static_friction: floor.0 + floor.1,
            friction_critical_velocity: critical_velocity,
            ..frame
        };
        params.validate().expect("built of parts");
        params
    })
}

/// [`any_robot`] with equal moments of inertia across the mast; otherwise it would look different from each wheel.
pub fn any_round_robot() -> impl Strategy<Value = Params> {
    any_robot().prop_map(|params| {
        let [x, y, z] = params.body_inertia;
        let params = Params { body_inertia: [0.5 * (x + y), 0.5 * (x + y), z], ..params };
        params.validate().expect("the mean of two moments is between them");
        params
    })
}

/// [`any_robot`] or a published robot.
pub fn any_or_published_robot() -> impl Strategy<Value = Params> {
    let preset = |name: &&str| Params::preset(name).expect("a preset loads");
    let published: Vec<_> = Params::preset_names().iter().map(preset).collect();
    prop_oneof![any_robot(), proptest::sample::select(published)]
}

/// Without friction except at the contacts.
pub fn without_losses(params: &Params) -> Params {
    Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, wheel_coulomb_friction: 0.0, ..params.clone() }
}

/// Rolling, spinning and roller friction, independent of a robot's size.
#[derive(Clone, Debug)]
pub struct Losses {
    /// Levers in ball radii.
    levers: [f64; 2],
    rollers: f64,
    /// Friction of the rollers, relative to the speed of a fall.
    slope: f64,
}

/// From a hard floor to a soft carpet; each absent in half of the robots.
pub fn any_losses() -> impl Strategy<Value = Losses> {
    let some = |most: f64| prop_oneof![Just(0.0), 0.0..most];
    ([some(0.1), some(0.1)], some(0.1), some(0.3)).prop_map(|(levers, rollers, slope)| Losses {
        levers,
        rollers,
        slope,
    })
}

impl Losses {
    pub fn of(&self, params: &Params) -> Params {
        let [rolling, spinning] = self.levers.map(|lever| lever * params.ball_radius);
        Params {
            floor_rolling_friction: rolling,
            floor_spinning_friction: spinning,
            roller_friction: self.rollers,
            roller_friction_slope: self.slope / (params.body_com_height * natural_rate(params)),
            ..params.clone()
        }
    }
}

/// Ripple of the wheels' rims, independent of a robot's size.
#[derive(Clone, Debug)]
pub struct Ripple {
    /// As a fraction of the ripple of straight rollers.
    share: f64,
    count: u8,
    phases: [f64; 3],
}

/// From barrels without gaps up to a fraction of the ripple of straight rollers.
pub fn any_ripple(most: f64) -> impl Strategy<Value = Ripple> {
    (0.0..most, 6..25_u8, uniform3(-PI..PI)).prop_map(|(share, count, phases)| Ripple { share, count, phases })
}

impl Ripple {
    pub fn of(&self, params: &Params) -> Params {
        let count = f64::from(self.count);
        let params = Params {
            roller_ripple: self.share * params.wheel_radius * (1.0 - (PI / count).cos()),
            roller_count: count,
            roller_phases: self.phases,
            ..params.clone()
        };
        params.validate().expect("at most the ripple of straight rollers");
        params
    }
}

/// A tilt of the floor by up to `steepest`, rad, in any direction.
pub fn any_floor_tilt(steepest: f64) -> impl Strategy<Value = [f64; 2]> {
    (0.0..steepest, -PI..PI).prop_map(|(slope, azimuth)| [slope * azimuth.cos(), slope * azimuth.sin()])
}

/// Masses, inertias and geometry.
fn any_frame() -> impl Strategy<Value = Params> {
    let ball = (0.05..0.3, 100.0..1000.0, 0.4..0.66);
    let body = (0.3_f64.ln()..50.0_f64.ln(), 1.2..5.0, uniform3(0.3..1.5));
    let wheels = (0.2..0.6, 0.01..0.06, 0.4..0.9, 25.0_f64..65.0, 0.0..TAU, any::<bool>());
    (ball, body, wheels).prop_map(|(ball, body, wheels)| {
        let (ball_radius, density, ball_gyration) = ball;
        let ball_mass: f64 = density * 4.0 / 3.0 * PI * ball_radius * ball_radius * ball_radius;
        let ball_mass = ball_mass.clamp(0.3, 20.0);
        let (body_mass, height, spread) = body;
        let (wheel_ratio, wheel_share, wheel_gyration, zenith, start, clockwise) = wheels;
        let (body_mass, com_height) = (body_mass.exp(), height * ball_radius);
        let gap = if clockwise { -TAU / 3.0 } else { TAU / 3.0 };
        let (wheel_radius, wheel_mass) = (wheel_ratio * ball_radius, wheel_share * body_mass);
        let wheel_inertia = wheel_gyration * wheel_mass * wheel_radius * wheel_radius;
        let mut params = Params {
            ball_mass,
            ball_inertia: ball_gyration * ball_mass * ball_radius * ball_radius,
            ball_radius,
            body_mass,
            body_com_height: com_height,
            wheel_mass,
            wheel_inertia,
            wheel_radius,
            wheel_zenith: zenith.to_radians(),
            wheel_azimuths: [start, start + gap, start + 2.0 * gap],
            max_wheel_torque: 0.5 * body_mass * 9.81 * ball_radius,
            ..Params::paper()
        };
        params.body_inertia = body_inertia(&params, spread.map(|s| s * ball_radius));
        params
    })
}

/// Moments of a body whose link, without the wheels, has its mass spread by `spread` (standard deviation along each axis).
fn body_inertia(params: &Params, spread: [f64; 3]) -> [f64; 3] {
    let link = params.body_mass - 3.0 * params.wheel_mass;
    let (sin, cos) = params.wheel_zenith.sin_cos();
    let reach = params.ball_radius + params.wheel_radius;
    // Seen along the mast, the three wheels together look the same from all sides: centers, and inertia other than
    // about axles.
    let wheels_up = reach * cos - params.body_com_height;
    let wheels_out = reach * sin;
    let around = 3.0 * params.wheel_mass * 0.5 * wheels_out * wheels_out;
    let transverse = 0.5 * params.wheel_inertia;
    let link_down = 3.0 * params.wheel_mass * wheels_up / link;
    let along = 3.0 * params.wheel_mass * wheels_up * wheels_up + link * link_down * link_down;
    let [x, y, z] = spread.map(|s| link * s * s);
    let across = around + along + transverse * 3.0 * (1.0 - 0.5 * cos * cos);
    [y + z + across, x + z + across, x + y + 2.0 * around + transverse * 3.0 * (1.0 - sin * sin)]
}

/// Drag of the ball and of the wheel joints, 1/s, and dry friction; each absent in half of the robots.
fn any_joint_friction() -> impl Strategy<Value = [f64; 3]> {
    let some = || prop_oneof![Just(0.0), 0.01..1.0];
    [some(), some(), some()]
}

/// Wheel and floor: dynamic coefficient, and the excess of static friction over it.
fn any_contact_friction() -> impl Strategy<Value = [(f64, f64); 2]> {
    let pair = || (0.3..1.2, prop_oneof![Just(0.0), 0.0..0.3]);
    [pair(), pair()]
}

/// Natural rate of a robot of this size, rad/s: the rate at which it falls.
pub fn natural_rate(params: &Params) -> f64 {
    (params.gravity / params.body_com_height).sqrt()
}

/// Start of a robot that rolls without slip, independent of its size.
#[derive(Clone, Debug)]
pub struct Start {
    pub tilt: Vector2<f64>,
    pub yaw: f64,
    /// Velocity of the ball, in body heights times the natural rate.
    pub velocity: Vector2<f64>,
    /// Spin of the ball about the vertical, relative to the natural rate.
    pub spin: f64,
    /// Angular velocity of the body, relative to the natural rate.
    pub rate: Vector3<f64>,
}

impl Start {
    pub fn of(&self, params: &Params) -> State {
        let rate = natural_rate(params);
        State::rolling(
            params,
            self.velocity * (params.body_com_height * rate),
            self.spin * rate,
            ballbot_core::attitude(self.tilt, self.yaw),
            self.rate * rate,
        )
    }
}

/// Leaning by up to `tilt` (rad) in each direction, with all velocities up to `speed` times the natural velocities.
pub fn any_start(tilt: f64, speed: f64) -> impl Strategy<Value = Start> {
    (vector(tilt), -PI..PI, vector(speed), -speed..speed, vector(speed)).prop_map(
        |(tilt, yaw, velocity, spin, rate)| Start { tilt: tilt.xy(), yaw, velocity: velocity.xy(), spin, rate },
    )
}

/// The largest of nonnegative numbers; NaN if any is NaN, which a plain maximum would ignore.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |most, value| if value > most || value.is_nan() { value } else { most })
}

/// Torques of the motors as fractions of the torque that makes a wheel of the robot at rest slip at a friction
/// coefficient of 1.
pub fn torques(params: &Params, shares: &Vector3<f64>) -> [f64; 3] {
    (shares * (params.static_wheel_load() * params.wheel_radius))
        .map(|t| t.clamp(-params.max_wheel_torque, params.max_wheel_torque))
        .into()
}
