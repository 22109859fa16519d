//! Drive friction of an ideal omniwheel: one constraint row along the drive direction, bounded by μ N.

use super::convert::{from_rapier, to_rapier};
use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

/// Viscosity of a contact that sticks, N/(m/s): the slip under 10 N is 1e-7 m/s.
const STICKING: f64 = 1e8;

/// A joint that holds nothing but slip along x of its frame, with no force until it is anchored.
pub fn row() -> GenericJoint {
    let mut joint = GenericJoint::new(JointAxesMask::empty());
    joint.set_motor_model(JointAxis::LinX, MotorModel::ForceBased);
    joint.set_motor_velocity(JointAxis::LinX, 0.0, STICKING);
    joint.set_motor_max_force(JointAxis::LinX, 0.0);
    joint
}

/// Friction coefficient at a slip speed: from `fixed` at rest to `moving` well above the critical velocity
/// (Stribeck; Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30(7), 1994, eq. (4)).
pub fn stribeck(fixed: f64, moving: f64, critical_velocity: f64, slip: f64) -> f64 {
    moving + (fixed - moving) * (-(slip / critical_velocity).powi(2)).exp()
}

/// Where and along what a wheel drives the ball.
pub struct Contact {
    /// Contact point, inertial frame, m.
    pub point: Vector3<f64>,
    /// From the ball centre to the wheel centre.
    pub normal: Vector3<f64>,
    /// Drive direction in the plane of contact.
    pub drive: Vector3<f64>,
}

impl Contact {
    /// Of a ball and a wheel whose axle is `axle` (inertial frame).
    pub fn new(ball: Vector3<f64>, ball_radius: f64, wheel: Vector3<f64>, axle: &Vector3<f64>) -> Self {
        let normal = (wheel - ball).normalize();
        // u × p = d with the axle along −u.
        let drive = normal.cross(axle).normalize();
        Self { point: ball + normal * ball_radius, normal, drive }
    }

    /// Anchors a drive row here, between a wheel and the ball at the given poses, with friction up to `max_force` (N).
    pub fn anchor(&self, row: &mut GenericJoint, wheel: &Pose, ball: &Pose, max_force: f64) {
        let frame = Pose::from_parts(
            to_rapier(&self.point),
            Rotation::from_mat3(&Matrix::from_cols(
                to_rapier(&self.drive),
                to_rapier(&self.normal.cross(&self.drive)),
                to_rapier(&self.normal),
            )),
        );
        row.local_frame1 = wheel.inverse() * frame;
        row.local_frame2 = ball.inverse() * frame;
        row.set_motor_max_force(JointAxis::LinX, max_force);
    }
}

/// Force on the ball along the drive direction over the last step, N.
pub fn traction(row: &GenericJoint, sim_dt: f64) -> f64 {
    // The row acts on the wheel, its first body; the ball feels the opposite.
    row.motor(JointAxis::LinX).map_or(0.0, |motor| -motor.impulse) / sim_dt
}

/// Velocity of a body's material point, inertial frame, m/s.
pub fn point_velocity(body: &RigidBody, point: &Vector3<f64>) -> Vector3<f64> {
    let arm = point - from_rapier(body.center_of_mass());
    from_rapier(body.linvel()) + from_rapier(body.angvel()).cross(&arm)
}
