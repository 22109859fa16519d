//! The two constraint rows of an ideal omniwheel on the ball: normal force and friction along the drive direction.
//!
//! They are the rows of one joint, along z and x of a frame at the contact. A rapier contact would take four, two of
//! them for friction that this wheel does not have. A joint's rows start each step from no force, which takes the
//! solver many sweeps to make up for; so the force of the last step acts on both bodies as a given one (`WarmStart`), and
//! the rows find what it lacks.

use super::convert::to_rapier;
use super::wheel_contact::Contact;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// Viscosity of a row that holds, N/(m/s): the slip under 10 N is 1e-7 m/s.
const MOTOR_DAMPING: f64 = 1e8;

/// How far apart wheel and ball may be for the row to look out for them to meet, m.
const CONTACT_PREDICTION: f64 = 0.002;

/// Keeps the limit on the side where it acts whatever the rounding, m.
const LIMIT_MARGIN: f64 = 1e-9;

/// How fast the load that bounds friction follows the load, in a step. Friction of slipping wheels pushes ball and body
/// sideways and so changes the loads of the others: bounded by the last load itself, it would swing from step to step, and
/// farther each time.
const LOAD_FILTER: f64 = 0.5;

/// What one step leaves to the next, N.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
pub struct WheelForce {
    pub load: f64,
    /// The load that bounds the next step's friction. It follows the load by a share a step ([`LOAD_FILTER`]).
    pub normal_estimate: f64,
    /// On the ball along the drive direction.
    pub traction: f64,
    /// Whether the load is steady enough to start the next step from.
    pub steady: bool,
}

/// The force that a step starts from, N; nothing unless it was steady.
#[derive(Clone, Copy, Default)]
pub struct WarmStart {
    pub load: f64,
    pub traction: f64,
}

/// A joint between a wheel and the ball that holds nothing until it is anchored.
pub fn joint() -> GenericJoint {
    let mut joint = GenericJoint::new(JointAxesMask::empty());
    for axis in [JointAxis::LinX, JointAxis::LinZ] {
        joint.set_motor_model(axis, MotorModel::ForceBased);
        joint.set_motor_velocity(axis, 0.0, MOTOR_DAMPING);
        joint.set_motor_max_force(axis, 0.0);
    }
    // The row along z stands for the contact of the colliders.
    joint.set_contacts_enabled(false);
    joint
}

/// How bodies that overlap move apart.
pub fn softness() -> SpringCoefficients<Real> {
    SpringCoefficients::new(200.0, 5.0)
}

/// Anchors the rows at the contact of a wheel and the ball at the given poses, with friction up to `grip` (N).
pub fn anchor(
    joint: &mut GenericJoint,
    contact: &Contact,
    poses: [&Pose; 2],
    last: &WheelForce,
    grip: f64,
    dt: f64,
) -> WarmStart {
    let frame = Pose::from_parts(
        to_rapier(&contact.point),
        Rotation::from_mat3(&Matrix::from_cols(
            to_rapier(&contact.drive),
            to_rapier(&contact.normal.cross(&contact.drive)),
            to_rapier(&contact.normal),
        )),
    );
    joint.local_frame1 = poses[0].inverse() * frame;
    joint.local_frame2 = poses[1].inverse() * frame;
    joint.motor_axes = JointAxesMask::LIN_X;
    joint.limit_axes = JointAxesMask::empty();
    joint.motors[0].impulse = 0.0;
    joint.motors[2].impulse = 0.0;
    joint.limits[2].impulse = 0.0;
    let mut start = WarmStart::default();
    if last.steady {
        // From half the grip at most, so that friction that turns round has all of it within two steps.
        start = WarmStart { load: last.load, traction: last.traction.clamp(-0.5 * grip, 0.5 * grip) };
        // With a motor as strong as the start, the load can vanish or double, but not pull.
        joint.motor_axes |= JointAxesMask::LIN_Z;
        joint.motors[2].max_force = start.load;
        joint.motors[2].target_vel = contact.gap * softness().erp_inv_dt(dt);
    } else if contact.gap < CONTACT_PREDICTION {
        joint.limit_axes = JointAxesMask::LIN_Z;
        joint.limits[2].min = -Real::MAX;
        joint.limits[2].max = -contact.gap.abs() - LIMIT_MARGIN;
        joint.softness = if contact.gap > 0.0 { closing(dt) } else { softness() };
    }
    joint.motors[0].max_force = grip - start.traction.abs();
    start
}

/// Lets a gap close within the step but no further: by the limit's rule for overlaps, at the rate −1/dt.
fn closing(dt: f64) -> SpringCoefficients<Real> {
    SpringCoefficients::new((std::f64::consts::TAU * dt).recip(), -1.0)
}

/// The force over the step of `dt` that began with `start`, after one with `last`; a wheel's usual load is `usual` (N).
pub fn wheel_force(joint: &GenericJoint, start: &WarmStart, last: &WheelForce, usual: f64, dt: f64) -> WheelForce {
    let load = start.load + (joint.motors[2].impulse + joint.limits[2].impulse) / dt;
    // The rows act on the wheel, their first body; the ball feels the opposite.
    let traction = start.traction - joint.motors[0].impulse / dt;
    // Twice the load at the start is all that the row along z can add up to, so a load that has just dropped or doubled
    // is no start.
    let lasting = load > 0.5 * last.load && load < 1.9 * last.load;
    let normal_estimate =
        if last.steady { last.normal_estimate + LOAD_FILTER * (load - last.normal_estimate) } else { load };
    WheelForce { load, normal_estimate, traction, steady: load > 0.01 * usual && load < 10.0 * usual && lasting }
}
