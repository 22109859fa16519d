//! The attitude error relative to the position loop and the setpoint, and the torques that correct it.

use super::lean_planes::Leaning;
use super::position_loop::{PositionLoop, SecondOrder};
use super::tracking::{Deviation, Tracking};
use crate::{Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::lanes::{Heading, Lane, Quat, Vec3};
use ballbot_base::wheels::Wheels;
use ballbot_models::{BodyMotion, InverseDynamics, LinearModel};

/// Largest heading error that is brought to zero, rad: with a larger error the attitudes would be so far apart that
/// heading and tilt do not separate.
const MAX_YAW: f64 = 1.0;

/// Least scalar part of the error quaternion. At zero the error is half a turn, and no angular acceleration has the
/// desired effect.
const LEAST_SCALAR: f64 = 1e-3;

/// Computed torque on the attitude below a PD of the position: the common part of the inverse dynamics controllers.
#[derive(Clone, Debug)]
pub(crate) struct AttitudeLoop {
    tracking: Tracking,
    position: PositionLoop,
    dynamics: InverseDynamics,
}

/// The attitude error v = vec(q_e), q_e = q_ref* ∘ q, in the balance frame.
pub(crate) struct AttitudeError<L> {
    /// v: half the angle for small errors.
    pub(crate) error: Vec3<L>,
    /// v̇, 1/s.
    pub(crate) rate: Vec3<L>,
    scalar: L,
    /// Ω_e, the angular velocity relative to the reference.
    relative: Vec3<L>,
    /// Feedforward of the reference's motion to the angular acceleration.
    forward: Vec3<L>,
    motion: BodyMotion<L>,
}

impl AttitudeLoop {
    /// The outer loop for an error with v̈ = −δ v̇ − σ v, with dynamics `lean` about the horizontal axes and `yaw`
    /// about the vertical; `poles` and `largest` as in [`PositionLoop::new`].
    ///
    /// # Errors
    /// [`ballbot_base::Error::Inconsistent`] if the sampled loop of the linear model is not stable.
    pub(crate) fn new(
        plant: &Plant<'_>,
        tracking: Tracking,
        [lean, yaw]: [SecondOrder; 2],
        poles: [f64; 2],
        largest: [f64; 2],
    ) -> Result<Self> {
        let params = &plant.params.on_level_floor();
        let position = PositionLoop::new(&tracking.planes, lean, poles, largest);
        let of_plane = |axis: usize| {
            let [y, theta, moving, turning] = position.feedback(axis).map(|k| k * lean.stiffness);
            [y, theta + lean.stiffness, moving, turning + lean.damping]
        };
        let driven = tracking.planes.gain([of_plane(0), of_plane(1)], yaw.gains());
        Plant { params, ..*plant }.require_stable(&(driven + tracking.planes.cancelling(&LinearModel::new(params))))?;
        Ok(Self { tracking, position, dynamics: InverseDynamics::new(params) })
    }

    /// The attitude error relative to the reference.
    #[inline(always)]
    pub(crate) fn error<L: Lane>(&self, &Sample { state, setpoint, .. }: &Sample<'_, L>) -> AttitudeError<L> {
        let Deviation { x, .. } = self.tracking.deviation(state, setpoint);
        let commanded = self.position.lean(&Leaning::new(&x));
        let attitude = self.tracking.frame.attitude(state.body_quaternion);
        let forward = self.tracking.lean(&Heading::new(attitude), setpoint);
        let (zero, one) = (x[0].zero(), x[0].splat(1.0));

        // Both attitudes relative to the robot's heading; leaning towards y turns about −x.
        let half = Vec3::new((commanded[1] + forward.lean[1]) * -0.5, (commanded[0] + forward.lean[0]) * 0.5, zero);
        let yaw = x[4];
        let bound = L::select(yaw.lt(zero), one * -MAX_YAW, one * MAX_YAW);
        let yaw = L::select(yaw.abs().lt(one * MAX_YAW), yaw, bound);
        let upright = Quat { w: one, v: Vec3::zero(zero) };
        let turn = upright.turned_in_own_frame(Vec3::new(zero, zero, yaw * -0.5));
        let reference = upright.turned_in_own_frame(half).times(turn);
        let error = reference.conjugated().times(without_heading(attitude));
        let flipped = error.w.lt(zero);
        let error = Quat::select(flipped, Quat { w: -error.w, v: -error.v }, error);

        // The reference's motion in its own frame.
        let turn =
            Heading { cos: turn.w.mul_add(turn.w, -turn.v.z.squared()), sin: turn.w * turn.v.z + turn.w * turn.v.z };
        let [rate_x, rate_y] = turn.of(-forward.rate[1], forward.rate[0]);
        let [change_x, change_y] = turn.of(-forward.acceleration[1], forward.acceleration[0]);
        let spin = setpoint.yaw_rate;
        let change = Vec3::new(spin.mul_add(rate_y, change_x), spin.neg_mul_add(rate_x, change_y), zero);
        let to_body = error.rotation();
        let reference_rate = to_body.apply_transposed(Vec3::new(rate_x, rate_y, spin));

        let body_rate = self.tracking.frame.of_body(state.body_angular_velocity);
        let relative = body_rate - reference_rate;
        let rate = (error.v.cross(relative).plus(relative, error.w)) * (one * 0.5);
        AttitudeError {
            error: error.v,
            rate,
            scalar: error.w,
            relative,
            forward: to_body.apply_transposed(change) - relative.cross(reference_rate),
            motion: BodyMotion {
                rotation: attitude.rotation(),
                body_rate,
                ball_rate: state.ball_angular_velocity,
                wheel_speeds: state.wheel_speeds,
            },
        }
    }

    /// Motor torques that produce v̈ = `desired`, N·m.
    #[inline(always)]
    pub(crate) fn torques<L: Lane>(&self, error: &AttitudeError<L>, desired: Vec3<L>) -> Wheels<L> {
        let AttitudeError { error: v, scalar, relative, forward, ref motion, .. } = *error;
        // w Ω̇_e + v × Ω̇_e = 2 v̈ + ½ |Ω_e|² v
        let half = relative.norm_squared() * 0.5;
        let driven = (desired + desired).plus(v, half);
        let along = v.dot(driven) / scalar.max(scalar.splat(LEAST_SCALAR));
        let acceleration = (driven * scalar - v.cross(driven)).plus(v, along);
        self.dynamics.torques(motion, acceleration + forward)
    }
}

/// The attitude of a body with heading zero and the same tilt.
#[inline(always)]
fn without_heading<L: Lane>(attitude: Quat<L>) -> Quat<L> {
    let Quat { w, v } = attitude;
    let length = w.mul_add(w, v.z.squared()).sqrt();
    // The heading is undefined upside down.
    let turned = length.zero().lt(length);
    let (one, zero) = (length.splat(1.0), length.zero());
    let inverse = one / L::select(turned, length, one);
    let (cos, sin) = (L::select(turned, w * inverse, one), v.z * inverse);
    Quat { w: length, v: Vec3::new(cos.mul_add(v.x, sin * v.y), cos.mul_add(v.y, -(sin * v.x)), zero) }
}
