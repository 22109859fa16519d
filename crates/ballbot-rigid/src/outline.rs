//! The outline of a robot: a lower bound of its distance from others.

use super::bot::split;
use super::convert::{from_rapier, rotation_from_rapier, to_rapier};
use super::robot::Robot;
use super::rows::Velocities;
use super::stepping::CLEARANCE;
use super::world::World;
use ballbot_base::state::State;
use nalgebra::Vector3;
use rapier3d_f64::math::Vector;
use rapier3d_f64::parry::query::details::closest_points_segment_segment_with_locations_nD as closest_points;

/// Room for what forces change in a step, as a factor of the motion at the present velocities.
const ROOM: f64 = 2.0;

/// Distance up to which parts may touch in a step in which they move by `moved` m at their present velocities.
pub fn reach_of_step(moved: f64) -> f64 {
    CLEARANCE + ROOM * moved
}

/// A sphere around the ball, a capsule around body and wheels, and how far they move in a step.
pub struct Outline {
    pub ball: Vector3<f64>,
    pub ball_radius: f64,
    /// Ends of the body's axis.
    pub axis: [Vector3<f64>; 2],
    pub body_radius: f64,
    /// Motion of the fastest point in a step, m.
    pub moved: f64,
}

impl Outline {
    /// Whether the robots may touch each other within the step.
    pub fn may_touch(&self, other: &Self) -> bool {
        self.distance(other) <= reach_of_step(self.moved + other.moved)
    }

    fn distance(&self, other: &Self) -> f64 {
        let parts = |outline: &Self| [([outline.ball; 2], outline.ball_radius), (outline.axis, outline.body_radius)];
        let distances = parts(self).into_iter().flat_map(|(segment, radius)| {
            parts(other).map(|(theirs, their_radius)| between_segments(&segment, &theirs) - radius - their_radius)
        });
        distances.fold(f64::INFINITY, f64::min)
    }
}

fn between_segments(a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 2]) -> f64 {
    let [a, b] = [a, b].map(|segment| [0, 1].map(|end| to_rapier(&segment[end])));
    let (on_a, on_b) = closest_points((&a[0], &a[1]), (&b[0], &b[1]));
    let point = |segment: &[Vector; 2], [first, second]: [f64; 2]| segment[0] * first + segment[1] * second;
    (point(&a, on_a.barycentric_coordinates()) - point(&b, on_b.barycentric_coordinates())).length()
}

impl Robot {
    /// The outline at the start of a step in which points move by at most `moved` m.
    pub fn outline(&self, world: &World, moved: f64) -> Outline {
        let shape = &self.collision_shape;
        let pose = world.bodies[self.handles.body].position();
        let (position, attitude) = (from_rapier(pose.translation), rotation_from_rapier(pose.rotation));
        let place = |height: f64| position + attitude * (Vector3::z() * height - self.root);
        Outline {
            ball: from_rapier(world.bodies[self.handles.ball].translation()),
            ball_radius: self.params.ball_radius,
            axis: [place(shape.body.bottom), place(shape.body.top)],
            body_radius: self.body_radius(),
            moved,
        }
    }

    /// Radius of a sphere around the ball's center that contains the robot in a state, m.
    pub fn reach(&self, state: &State) -> f64 {
        let apart = (state.body_position - state.ball_position).norm();
        (apart + self.bot_reach()).max(self.params.ball_radius)
    }

    /// Radius of a capsule around body and wheels, m.
    pub fn body_radius(&self) -> f64 {
        self.collision_shape.body.radius + self.params.wheel_radius
    }

    /// Radius of a sphere around the body's origin that contains body and wheels, m.
    fn bot_reach(&self) -> f64 {
        self.collision_shape.body.top + self.body_radius()
    }

    /// Motion of the fastest point in a step at given velocities, m.
    pub fn largest_motion(&self, velocities: &Velocities) -> f64 {
        let [velocity, rate, _] = split(&velocities.bot);
        let of_bot = velocity.norm() + rate.norm() * (self.bot_reach() + self.root.norm());
        of_bot.max(velocities.ball[0].norm()) * self.dt
    }
}
