//! Robots without symmetry: a body link and three wheels, put together by hand.

use super::{any_robot, vector};
use ballbot_core::Params;
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use proptest::array::{uniform2, uniform3};
use proptest::prelude::*;

/// Inertia of a point mass.
pub fn steiner(mass: f64, arm: Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * mass
}

/// Directions from the ball's center to each wheel contact, and of each axle.
pub fn contacts_and_axles(params: &Params) -> [(Vector3<f64>, Vector3<f64>); 3] {
    [0, 1, 2].map(|i| {
        let (sin, cos) = (params.wheel_zenith + params.wheel_zenith_offsets[i]).sin_cos();
        let (sin_azimuth, cos_azimuth) = params.wheel_azimuths[i].sin_cos();
        let contact = Vector3::new(sin * cos_azimuth, sin * sin_azimuth, cos);
        (contact, Vector3::new(-sin_azimuth, cos_azimuth, 0.0).cross(&contact))
    })
}

/// Body inertia of a robot whose link, without the wheels, has the inertia `link` about its CoM; a wheel's inertia
/// across its axle is half the inertia about the axle.
fn assembled(params: &Params, link: &Matrix3<f64>) -> Matrix3<f64> {
    let link_mass = params.body_mass - 3.0 * params.wheel_mass;
    let com = Vector3::new(params.body_com_offset[0], params.body_com_offset[1], params.body_com_height);
    let reach = params.ball_radius + params.wheel_radius;
    let wheels = contacts_and_axles(params);
    let wheels_first_moment: Vector3<f64> = wheels.iter().map(|(p, _)| p * (reach * params.wheel_mass)).sum();
    let link_com = (com * params.body_mass - wheels_first_moment) / link_mass;
    let mut whole = link + steiner(link_mass, link_com - com);
    for (contact, axle) in wheels {
        whole += steiner(params.wheel_mass, contact * reach - com);
        whole += (Matrix3::identity() - axle * axle.transpose()) * (0.5 * params.wheel_inertia);
    }
    whole
}

/// Any physically possible ballbot: its CoM up to a third of its height off the mast, any inertia of the body link,
/// wheels up to 0.35 rad from 120 deg and up to 0.2 rad from a common zenith.
pub fn any_general_robot() -> impl Strategy<Value = Params> {
    let place = (0.0..1.0 / 3.0, -3.2..3.2);
    let wheels = (uniform3(-0.35..0.35), uniform3(-0.2..0.2));
    let spread = (uniform3(0.3..1.5), vector(3.0));
    (any_robot(), place, wheels, spread).prop_filter_map(
        "no wheel carries the body",
        |(params, (off, direction), (turns, offsets), (spread, axes))| {
            let [a, b, c] = params.wheel_azimuths;
            let off: f64 = off * params.body_com_height;
            let (sin, cos) = f64::sin_cos(direction);
            let mut params = Params {
                wheel_azimuths: [a + turns[0], b + turns[1], c + turns[2]],
                wheel_zenith_offsets: offsets,
                body_com_offset: [off * cos, off * sin],
                ..params
            };
            let mass = params.body_mass - 3.0 * params.wheel_mass;
            let [x, y, z] = spread.map(|s: f64| mass * (s * params.ball_radius).powi(2));
            let axes = Rotation3::from_scaled_axis(axes).into_inner();
            let moments = Matrix3::from_diagonal(&Vector3::new(y + z, x + z, x + y));
            let inertia = assembled(&params, &(axes * moments * axes.transpose()));
            params.body_inertia = inertia.diagonal().into();
            params.body_products_of_inertia = [inertia[(0, 1)], inertia[(0, 2)], inertia[(1, 2)]];
            params.validate().is_ok().then_some(params)
        },
    )
}

/// Robots of [`any_general_robot`], half of them with inclined rollers.
pub fn any_robot_on_rollers() -> impl Strategy<Value = Params> {
    prop_oneof![any_general_robot(), inclined(any_general_robot())]
}

/// Robots with rollers at any angle.
pub fn inclined(robots: impl Strategy<Value = Params>) -> impl Strategy<Value = Params> {
    (robots, -1.2..1.2).prop_filter_map("three wheels drive the ball about two axes", |(params, roller_angle)| {
        let params = Params { roller_angle, ..params };
        params.validate().is_ok().then_some(params)
    })
}

/// The paper's robot with realistic build errors everywhere.
pub fn crooked() -> Params {
    let [a, b, c] = Params::paper().wheel_azimuths;
    let params = Params {
        body_com_offset: [5e-3, -3e-3],
        body_products_of_inertia: [4e-4, -6e-4, 3e-4],
        wheel_azimuths: [a + 0.02, b - 0.03, c + 0.01],
        wheel_zenith_offsets: [0.02, -0.01, 0.015],
        ..Params::paper()
    };
    params.validate().expect("a robot that can be");
    params
}

/// A tilt, a fraction of `largest` in each direction.
pub fn any_small_tilt(largest: f64) -> impl Strategy<Value = Vector2<f64>> {
    uniform2(-largest..largest).prop_map(Vector2::from)
}
