//! Default visuals of a robot without URDF: ball, wheels, plates, motors and a mast, sized by the parameters.

use super::color::{Color, Paint, srgb};
use super::scene::{Link, Part, Scene};
use super::shape::Shape;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use nalgebra::{UnitQuaternion, Vector3};

impl Scene {
    /// A scene of primitive shapes with the radii, wheels and center of mass of `params`.
    pub fn of(params: &Params) -> Self {
        let wheels = Omniwheels::new(params);
        let mut parts = vec![ball(params)];
        for i in 0..3 {
            wheel(params, &wheels, i, &mut parts);
        }
        body(params, &mut parts);
        Self::new(params, parts)
    }
}

fn ball(params: &Params) -> Part {
    Part {
        link: Link::Ball,
        position: Vector3::zeros(),
        attitude: UnitQuaternion::identity(),
        shape: Shape::Sphere { radius: params.ball_radius },
        paint: Paint::Octants(srgb(0xd9480f), srgb(0xf8f0e3)),
    }
}

fn wheel(params: &Params, wheels: &Omniwheels, i: usize, parts: &mut Vec<Part>) {
    let radius = params.wheel_radius;
    let direction = wheels.contact_directions[i];
    let axle = -wheels.axles.row(i).transpose();
    let center = direction * (params.ball_radius + radius);
    // At wheel angle zero the mark points away from the ball.
    let frame = [direction, axle.cross(&direction), axle];
    let attitude = UnitQuaternion::from_basis_unchecked(&frame);
    let mut part = |link: Link, along: f64, shape: Shape, paint: Paint| {
        parts.push(Part { link, position: center + axle * along, attitude, shape, paint });
    };
    let tread = Paint::Sectors { count: 12, first: srgb(0x343a40), second: srgb(0x868e96), mark: srgb(0xf2c037) };
    let half = 0.26 * radius;
    part(Link::Wheel(i), 0.0, Shape::Cylinder { radius, half_length: half }, tread);
    let hub = Shape::Cylinder { radius: 0.35 * radius, half_length: 1.25 * half };
    part(Link::Wheel(i), 0.0, hub, Paint::Plain(srgb(0xced4da)));
    // The axle points down and away from the mast.
    let motor = Shape::Cylinder { radius: 0.36 * radius, half_length: 0.7 * radius };
    part(Link::Body, -(1.3 * half + 0.7 * radius), motor, Paint::Plain(srgb(0x495057)));
}

fn body(params: &Params, parts: &mut Vec<Part>) {
    let (ball, wheel) = (params.ball_radius, params.wheel_radius);
    let reaches = params.wheel_zeniths().map(|zenith| (ball + wheel) * zenith.sin());
    let reach = reaches.into_iter().fold(0.0, f64::max);
    let highest = params.wheel_zeniths().into_iter().fold(f64::INFINITY, f64::min);
    let plate = (ball + wheel) * highest.cos() + 1.6 * wheel;
    let top = (params.body_com_height + params.slender_half_length()).max(plate + 3.0 * wheel);
    let deck = plate + 0.3 * (top - plate);
    let mut upright = |radius: f64, from: f64, to: f64, (x, y): (f64, f64), color: Color| {
        parts.push(Part {
            link: Link::Body,
            position: Vector3::new(x, y, 0.5 * (from + to)),
            attitude: UnitQuaternion::identity(),
            shape: Shape::Cylinder { radius, half_length: 0.5 * (to - from) },
            paint: Paint::Plain(color),
        });
    };
    let (teal, light, dark) = (srgb(0x0b7285), srgb(0xdee2e6), srgb(0x343a40));
    let thickness = 0.03 * ball.max(wheel);
    for (radius, height) in [(1.15 * reach, plate), (0.95 * reach, deck), (0.6 * reach, top)] {
        upright(radius, height - thickness, height + thickness, (0.0, 0.0), light);
    }
    for (azimuth, out) in params.wheel_azimuths.into_iter().zip(reaches) {
        let at = (azimuth + std::f64::consts::FRAC_PI_3).sin_cos();
        upright(0.05 * reach, plate, deck, (0.75 * reach * at.1, 0.75 * reach * at.0), dark);
        let at = azimuth.sin_cos();
        // The bracket of the wheel.
        upright(0.16 * reach, plate - 0.7 * wheel, plate, (0.8 * out * at.1, 0.8 * out * at.0), dark);
    }
    upright(0.5 * reach, plate + thickness, plate + 0.7 * (deck - plate), (0.0, 0.0), teal);
    upright(0.12 * reach, deck, top, (0.0, 0.0), light);
    upright(0.3 * reach, top, top + 0.4 * reach, (0.0, 0.0), teal);
    // The front: the side of wheel 0.
    let azimuth = params.wheel_azimuths[0];
    let eye = (0.26 * reach * azimuth.cos(), 0.26 * reach * azimuth.sin());
    upright(0.08 * reach, top + 0.12 * reach, top + 0.3 * reach, eye, srgb(0xf2c037));
}
