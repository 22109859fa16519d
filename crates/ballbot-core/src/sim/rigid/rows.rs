//! The two constraint rows of an ideal omniwheel on the ball: normal force and friction along the drive direction.
//!
//! They are the rows of one joint, along z and x of a frame at the contact. A rapier contact would have more rows, for
//! friction that an omniwheel does not have. Joint rows have no warm start in rapier and would need many sweeps. The
//! force of the last step is therefore applied to both bodies as an external force (`WarmStart`), and the rows compute
//! the difference.

use super::convert::to_rapier;
use super::wheel_contact::Contact;
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// Damping of a motor row, N/(m/s). The slip under 10 N is 1e-7 m/s.
const MOTOR_DAMPING: f64 = 1e8;

/// Largest gap at which the normal row is active, m.
const CONTACT_PREDICTION: f64 = 0.002;

/// Margin that keeps the joint limit active in spite of rounding, m.
const LIMIT_MARGIN: f64 = 1e-9;

/// Gain per step of the low-pass filter from load to friction bound. Friction of slipping wheels changes the loads of
/// the other wheels; with the unfiltered load as bound the forces oscillate with growing amplitude. Chosen by
/// experiment.
const LOAD_FILTER: f64 = 0.5;

/// Force between a wheel and the ball in the last step.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
pub struct WheelForce {
    /// Normal force, N.
    pub load: f64,
    /// Filtered normal force that bounds the friction of the next step ([`LOAD_FILTER`]), N.
    pub normal_estimate: f64,
    /// Friction on the ball along the drive direction, N.
    pub traction: f64,
    /// Whether the load is steady enough for a warm start of the next step.
    pub steady: bool,
}

/// External force at the start of a step; zero unless the last force was steady.
#[derive(Clone, Copy, Default)]
pub struct WarmStart {
    /// Normal force, N.
    pub load: f64,
    /// Friction on the ball along the drive direction, N.
    pub traction: f64,
}

/// A joint between a wheel and the ball, without force until [`anchor`] is called.
pub fn joint() -> GenericJoint {
    let mut joint = GenericJoint::new(JointAxesMask::empty());
    for axis in [JointAxis::LinX, JointAxis::LinZ] {
        joint.set_motor_model(axis, MotorModel::ForceBased);
        joint.set_motor_velocity(axis, 0.0, MOTOR_DAMPING);
        joint.set_motor_max_force(axis, 0.0);
    }
    // The row along z replaces the contact of the colliders.
    joint.set_contacts_enabled(false);
    joint
}

/// Recovery from overlap: a spring of 200 Hz natural frequency and damping ratio 5, chosen by experiment.
pub fn softness() -> SpringCoefficients<Real> {
    SpringCoefficients::new(200.0, 5.0)
}

/// Places the rows at the contact of a wheel and the ball at the given poses, with a friction limit of `grip` (N).
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
        // At most half the grip, so that friction can reverse to the full grip within two steps.
        start = WarmStart { load: last.load, traction: last.traction.clamp(-0.5 * grip, 0.5 * grip) };
        // A motor limit equal to the warm start allows the load to vanish or double, but not to pull.
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

/// Softness with which a gap may close within the step but no further: the rule for overlaps at the rate −1/dt.
fn closing(dt: f64) -> SpringCoefficients<Real> {
    SpringCoefficients::new((std::f64::consts::TAU * dt).recip(), -1.0)
}

/// Mean force over a step of `dt` with the warm start `start`, after a step with the force `last`; `usual` is the
/// static load of a wheel (N).
pub fn wheel_force(joint: &GenericJoint, start: &WarmStart, last: &WheelForce, usual: f64, dt: f64) -> WheelForce {
    let load = start.load + (joint.motors[2].impulse + joint.limits[2].impulse) / dt;
    // The rows act on the wheel, their first body; the force on the ball is the opposite.
    let traction = start.traction - joint.motors[0].impulse / dt;
    // The row along z is limited to twice the warm start, so a load that halved or nearly doubled is not steady.
    let lasting = load > 0.5 * last.load && load < 1.9 * last.load;
    let normal_estimate =
        if last.steady { last.normal_estimate + LOAD_FILTER * (load - last.normal_estimate) } else { load };
    WheelForce { load, normal_estimate, traction, steady: load > 0.01 * usual && load < 10.0 * usual && lasting }
}
