//! Collision shapes of the bot, common to `contact` and `rigid`: wheels, and a cylinder for the body.

use crate::error::{Result, check};
use crate::kinematics::Omniwheels;
use crate::params::Params;
use crate::state::State;
use crate::terrain::Ground;
use crate::wheels::Wheels;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Largest overlap of the bot with the floor, and of the robot with obstacles, in an accepted state, m.
const MAX_OVERLAP: f64 = 1e-3;

/// Points around a rim that are compared with uneven ground.
const RIM_POINTS: usize = 16;

/// Wheel centers in the body frame, m.
pub fn wheel_centers(params: &Params, wheels: &Omniwheels) -> Wheels<Vector3<f64>> {
    wheels.contact_directions.map(|p| p * (params.ball_radius + params.wheel_radius))
}

/// Collision cylinder of the body, about the mast.
pub struct BodyShape {
    /// Radius, m.
    pub radius: f64,
    /// z of the lower end in the body frame, m.
    pub bottom: f64,
    /// z of the upper end in the body frame, m.
    pub top: f64,
}

impl BodyShape {
    /// Cylinder from the mass properties, because the parameters contain no outline. Its radius reaches the outermost
    /// wheel center. It extends from just above the ball to the top of a slender mast with the inertia of the body.
    pub fn new(params: &Params) -> Self {
        let bottom = 1.05 * params.ball_radius;
        let outermost = params.wheel_zeniths().into_iter().fold(0.0, f64::max);
        Self {
            radius: (params.ball_radius + params.wheel_radius) * outermost.sin(),
            bottom,
            top: (params.body_com_height + params.slender_half_length()).max(bottom + params.wheel_radius),
        }
    }
}

/// Collision shapes of the bot.
pub struct CollisionShape {
    /// Shape of the body.
    pub body: BodyShape,
    /// Centers of the wheels, body frame, m.
    pub wheel_centers: Wheels<Vector3<f64>>,
    wheel_radius: f64,
    ball_radius: f64,
}

impl CollisionShape {
    /// Shapes of a robot.
    pub fn new(params: &Params, wheels: &Omniwheels) -> Self {
        Self {
            body: BodyShape::new(params),
            wheel_centers: wheel_centers(params, wheels),
            wheel_radius: params.wheel_radius,
            ball_radius: params.ball_radius,
        }
    }

    /// Lowest part of the bot, and the height of its lowest point, m.
    fn lowest_point(&self, position: &Vector3<f64>, attitude: &UnitQuaternion<f64>) -> (&'static str, f64) {
        let height = |point: Vector3<f64>| (position + attitude * point).z;
        let wheel = self.wheel_centers.map(height).into_iter().fold(f64::INFINITY, f64::min) - self.wheel_radius;
        let mast = attitude * Vector3::z();
        let rim = self.body.radius * mast.xy().norm();
        let body = height(Vector3::z() * self.body.bottom).min(height(Vector3::z() * self.body.top)) - rim;
        if wheel < body { ("wheels", wheel) } else { ("body", body) }
    }

    /// Lowest part of the bot and its height above uneven ground: the least distance of wheels and of points around
    /// both ends of the body from the tangent plane below each.
    fn lowest_above(
        &self,
        ground: &Ground,
        position: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
    ) -> (&'static str, f64) {
        let distance = |point: Vector3<f64>| {
            let place = position + attitude * point;
            let terrain = ground.terrain();
            (place.z - terrain.height(place.x, place.y)) * terrain.normal(place.x, place.y).z
        };
        let wheel = self.wheel_centers.map(distance).into_iter().fold(f64::INFINITY, f64::min) - self.wheel_radius;
        let rim = (0..RIM_POINTS).flat_map(|i| {
            let (sin, cos) = (TAU * i as f64 / RIM_POINTS as f64).sin_cos();
            [self.body.bottom, self.body.top].map(|z| Vector3::new(cos * self.body.radius, sin * self.body.radius, z))
        });
        let body = rim.map(distance).fold(f64::INFINITY, f64::min);
        if wheel < body { ("wheels", wheel) } else { ("body", body) }
    }

    /// Lowest part of the bot, and its distance from the ground (a level floor if `None`), m.
    pub fn lowest(
        &self,
        ground: Option<&Ground>,
        position: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
    ) -> (&'static str, f64) {
        match ground {
            Some(ground) => self.lowest_above(ground, position, attitude),
            None => self.lowest_point(position, attitude),
        }
    }

    /// Rejects a state in which the bot overlaps the ground (a level floor if `None`), or the robot overlaps an obstacle.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the part and its distance.
    pub fn require_above(&self, ground: Option<&Ground>, state: &State) -> Result<()> {
        let (part, height) = self.lowest(ground, &state.body_position, &state.body_quaternion);
        check(
            format_args!("height of the lowest point of the {part}"),
            height,
            "at least 0 m, the floor, within 1 mm",
            |h| h >= -MAX_OVERLAP,
        )?;
        let Some(obstacles) = ground.map(|ground| ground.terrain().obstacles()).filter(|all| !all.is_empty()) else {
            return Ok(());
        };
        let place =
            |height: f64| <[f64; 3]>::from(state.body_position + state.body_quaternion * (Vector3::z() * height));
        let of_body = obstacles.distance_of_segment([place(self.body.bottom), place(self.body.top)], self.body.radius);
        let of_ball = obstacles.distance(state.ball_position.into()) - self.ball_radius;
        let of_wheel = |center: &Vector3<f64>| {
            obstacles.distance((state.body_position + state.body_quaternion * center).into()) - self.wheel_radius
        };
        let of_wheels = self.wheel_centers.iter().map(of_wheel).fold(f64::INFINITY, f64::min);
        for (part, distance) in [("ball", of_ball), ("body", of_body), ("wheels", of_wheels)] {
            let name = format_args!("distance of the {part} from the nearest obstacle");
            check(name, distance, "at least 0 m within 1 mm", |d| d >= -MAX_OVERLAP)?;
        }
        Ok(())
    }
}
