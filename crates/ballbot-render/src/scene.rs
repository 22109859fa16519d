//! Parts of a scene and their poses in a state.

use super::color::Paint;
use super::shape::{Hit, Shape};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::terrain::Terrain;
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, UnitQuaternion, UnitVector3, Vector3};
use std::sync::Arc;

/// The link that a part is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// The ball; parts are placed in its frame.
    Ball,
    /// The body; parts are placed in the body frame.
    Body,
    /// A wheel; parts are placed in the body frame at wheel angle zero, and turn about its axle.
    Wheel(usize),
    /// No link: parts are placed in the inertial frame.
    Inertial,
}

/// Labels of a segmentation image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Label {
    /// The sky.
    Sky = 0,
    /// The floor.
    Floor = 1,
    /// The ball.
    Ball = 2,
    /// The body.
    Body = 3,
    /// Wheel 0; wheels 1 and 2 follow.
    Wheel0 = 4,
    /// Wheel 1.
    Wheel1 = 5,
    /// Wheel 2.
    Wheel2 = 6,
    /// An arrow.
    Arrow = 7,
    /// An obstacle.
    Obstacle = 8,
}

impl Label {
    /// Names of the labels, indexed by label.
    pub const NAMES: [&'static str; 9] =
        ["sky", "floor", "ball", "body", "wheel_0", "wheel_1", "wheel_2", "arrow", "obstacle"];
}

impl Link {
    fn label(self) -> Label {
        match self {
            Self::Ball => Label::Ball,
            Self::Body => Label::Body,
            Self::Wheel(0) => Label::Wheel0,
            Self::Wheel(1) => Label::Wheel1,
            Self::Wheel(_) => Label::Wheel2,
            Self::Inertial => Label::Arrow,
        }
    }
}

/// A painted shape that moves with a link.
#[derive(Clone, Debug)]
pub struct Part {
    /// Link that the part is fixed to.
    pub link: Link,
    /// Origin of the shape, m.
    pub position: Vector3<f64>,
    /// Attitude of the shape.
    pub attitude: UnitQuaternion<f64>,
    /// Geometry.
    pub shape: Shape,
    /// Color pattern.
    pub paint: Paint,
}

/// The parts of a robot and the geometry that places them.
#[derive(Clone, Debug)]
pub struct Scene {
    pub(super) parts: Vec<Part>,
    /// The ground; `None` for the plane z = 0.
    pub(super) terrain: Option<Arc<Terrain>>,
    ball_radius: f64,
    wheel_centers: Wheels<Vector3<f64>>,
    axles: Wheels<UnitVector3<f64>>,
}

impl Scene {
    /// A scene of parts fixed to the ball, the body and the wheels of a robot.
    pub fn new(params: &Params, parts: Vec<Part>) -> Self {
        let wheels = Omniwheels::new(params);
        let axle = |i: usize| UnitVector3::new_normalize(-wheels.axles.row(i).transpose());
        Self {
            parts,
            terrain: None,
            ball_radius: params.ball_radius,
            wheel_centers: wheels.contact_directions.map(|p| p * (params.ball_radius + params.wheel_radius)),
            axles: Wheels::from_fn(axle),
        }
    }

    /// The same scene on different ground; `None` is level.
    #[must_use]
    pub fn on(self, terrain: Option<Arc<Terrain>>) -> Self {
        Self { terrain, ..self }
    }

    /// Height of the upright robot, m.
    pub fn height(&self) -> f64 {
        let top = |part: &Part| {
            let (center, radius) = part.shape.bounding_sphere();
            let reach = match &part.shape {
                // The bounding sphere of a flat upright shape is far higher than the shape.
                Shape::Cylinder { half_length, .. } if part.attitude.angle() < 1e-6 => *half_length,
                Shape::Cuboid { half_extents } if part.attitude.angle() < 1e-6 => half_extents.z,
                _ => radius,
            };
            (part.position + part.attitude * center).z + reach
        };
        self.parts.iter().map(top).fold(self.ball_radius, f64::max) + self.ball_radius
    }

    /// Poses of all parts in `state`.
    pub(super) fn placed<'a>(&'a self, state: &State, arrows: &'a [Part]) -> Vec<Placed<'a>> {
        let place = |part: &'a Part| {
            let (origin, attitude) = match part.link {
                Link::Ball => (state.ball_position, state.ball_quaternion),
                Link::Body => (state.body_position, state.body_quaternion),
                Link::Wheel(i) => {
                    let turn = UnitQuaternion::from_axis_angle(&self.axles[i], state.wheel_angles[i]);
                    let center = self.wheel_centers[i];
                    let origin = state.body_position + state.body_quaternion * (center - turn * center);
                    (origin, state.body_quaternion * turn)
                }
                Link::Inertial => (Vector3::zeros(), UnitQuaternion::identity()),
            };
            Placed::new(part, origin + attitude * part.position, attitude * part.attitude)
        };
        self.parts.iter().chain(arrows).map(place).collect()
    }
}

/// A part with its pose in the inertial frame.
pub(super) struct Placed<'a> {
    pub part: &'a Part,
    pub label: Label,
    position: Vector3<f64>,
    /// Rotation from part to inertial frame.
    rotation: Matrix3<f64>,
    /// Rotation from inertial to part frame.
    inverse: Matrix3<f64>,
    /// Center of the bounding sphere, inertial frame, m.
    pub center: Vector3<f64>,
    /// Radius of the bounding sphere, m.
    pub radius: f64,
    /// Center and half extents of the bounding box, part frame, m.
    bounding_box: (Vector3<f64>, Vector3<f64>),
}

impl<'a> Placed<'a> {
    fn new(part: &'a Part, position: Vector3<f64>, attitude: UnitQuaternion<f64>) -> Self {
        let rotation = attitude.to_rotation_matrix().into_inner();
        let (center, radius) = part.shape.bounding_sphere();
        Self {
            part,
            label: part.link.label(),
            position,
            rotation,
            inverse: rotation.transpose(),
            center: position + rotation * center,
            radius,
            bounding_box: part.shape.bounding_box(),
        }
    }

    /// Whether a ray comes within `margin` of the bounding box along the axes of the part, ahead of its origin.
    #[inline]
    pub fn near_box(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, margin: f64) -> bool {
        let (center, half) = &self.bounding_box;
        let (origin, direction) = (self.inverse * (origin - self.position) - center, self.inverse * direction);
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for i in 0..3 {
            let half = half[i] + margin;
            let inverse = 1.0 / direction[i];
            let (middle, reach) = (-origin[i] * inverse, half * inverse.abs());
            // NaN, from a ray within a face, bounds nothing.
            enter = if middle - reach > enter { middle - reach } else { enter };
            leave = if middle + reach < leave { middle + reach } else { leave };
        }
        enter <= leave
    }

    /// Whether a ray intersects the bounding sphere ahead of its origin.
    #[inline]
    pub fn near(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, length_squared: f64) -> bool {
        let to = self.center - origin;
        let along = to.dot(direction);
        let miss = to.norm_squared() * length_squared - along * along;
        miss <= self.radius * self.radius * length_squared && along + self.radius * length_squared.sqrt() > 0.0
    }

    /// First hit within `limit`, with the normal in the inertial frame.
    pub fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<Hit> {
        let (origin, direction) = (self.inverse * (origin - self.position), self.inverse * direction);
        let hit = self.part.shape.cast(&origin, &direction, limit)?;
        Some(Hit { normal: self.rotation * hit.normal, ..hit })
    }

    /// Whether a ray hits the part.
    pub fn hides(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> bool {
        self.part.shape.hides(&(self.inverse * (origin - self.position)), &(self.inverse * direction))
    }

    /// Color at a point of the inertial frame.
    pub fn color(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.part.paint.at(&(self.inverse * (point - self.position)))
    }
}
