//! Closed-form models without slip of wheels and ball, and without a contact solver.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod capture;
mod flat_move;
mod friction_limit;
mod inverse_dynamics;
mod leaning_plane;
pub mod linear;
mod load_map;
mod losses;
pub mod planar;
mod planar_motion;
mod rk4;
mod scale;
mod slope;
pub mod spatial;
mod spatial_motion;

pub use capture::capture_impulse;
pub use flat_move::fastest_move;
pub use friction_limit::traction_torque;
pub use inverse_dynamics::{BodyMotion, InverseDynamics};
pub use leaning_plane::LeaningPlane;
pub use linear::LinearModel;
pub use load_map::{LoadMap, WheelLoad};
pub use planar::{PlanarModel, WheelInertia};
pub use planar_motion::PlanarMotion;
pub use scale::Scale;
pub use spatial::{BallSpin, PointForce, SpatialModel, WheelSpin};
pub use spatial_motion::SpatialMotion;

use ballbot_base::error::{Error, Result};
use ballbot_base::force::HeldForce;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::payload::{PAYLOADS, PayloadMotion};
use ballbot_base::state::{Contacts, State, rolling_rate};
use ballbot_base::wheels::Wheels;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Width of the tanh that regularizes dry friction in the closed-form models, rad/s. Chosen by
/// experiment.
const DRY_FRICTION_WIDTH: f64 = 0.05;

/// Largest deviation from rolling without slip of an accepted state, m, m/s and rad/s.
const NO_SLIP_TOLERANCE: f64 = 1e-6;

/// Largest coordinate of a model that has not diverged. Its square does not overflow.
const MAX_COORDINATE: f64 = 1e100;

/// Whether all coordinates are finite and below [`MAX_COORDINATE`].
fn are_bounded(coordinates: &[f64]) -> bool {
    coordinates.iter().all(|v| v.abs() < MAX_COORDINATE)
}

/// Motor torques minus the friction of the wheel joints, N·m.
fn shaft_torques(params: &Params, torques: Wheels<f64>, wheel_speeds: Wheels<f64>) -> Wheels<f64> {
    torques.zip(wheel_speeds).map(|(torque, speed)| {
        torque
            - params.wheel_viscous_friction * speed
            - params.wheel_coulomb_friction * (speed / DRY_FRICTION_WIDTH).tanh()
    })
}

/// Motion of a robot without slip, from which the contact forces are computed.
struct Motion {
    body_quaternion: UnitQuaternion<f64>,
    ball_velocity: Vector3<f64>,
    ball_acceleration: Vector3<f64>,
    com_acceleration: Vector3<f64>,
    /// Traction f_i of each wheel on the ball along d_i, N.
    tractions: Wheels<f64>,
    /// Friction of the rollers of each wheel on the bot along p_i × d_i, N.
    rollers: Wheels<f64>,
    /// External force on the body, N.
    load: Vector3<f64>,
}

/// Contact forces: wheel loads from Rᵀ (M_b (a_b − g) − F) = Σ N_i p_i − P e_z − Σ f_i d_i + Σ h_i p_i × d_i with the force F from outside
/// and the preload P, floor force from the momentum of ball and body. `weight` is the force of the floor per mass at rest, −g,
/// m/s².
fn contact_loads(params: &Params, wheels: &Omniwheels, weight: &Vector3<f64>, motion: &Motion) -> Contacts {
    let mut balance = motion
        .body_quaternion
        .inverse_transform_vector(&((motion.com_acceleration + weight) * params.body_mass - motion.load));
    for (direction, traction) in wheels.drive_directions.iter().zip(motion.tractions) {
        balance += direction * traction;
    }
    balance.z += params.wheel_preload;
    if motion.rollers != Wheels::default() {
        balance -= wheels.u.transpose() * (motion.rollers * params.roller_angle.cos()).column();
    }
    let loads = Matrix3::from_columns(&wheels.contact_directions.0)
        .lu()
        .solve(&balance)
        .expect("contact directions of a validated robot span space");
    let floor_force = (motion.ball_acceleration + weight) * params.ball_mass
        + (motion.com_acceleration + weight) * params.body_mass
        + motion.ball_velocity * params.ball_viscous_friction
        - motion.load;
    Contacts {
        wheel_normal_forces: Wheels::of_column(loads),
        wheel_tractions: motion.tractions,
        floor_force,
        ..Contacts::default()
    }
}

/// Rejects a state that slips or is off the floor; the error names the first wrong quantity. The wheels turn as in 3D
/// motion.
fn require_rolling(params: &Params, wheels: &Omniwheels, state: &State) -> Result<()> {
    let in_space =
        wheels.wheel_speeds(&state.body_quaternion, &state.ball_angular_velocity, &state.body_angular_velocity);
    require_rolling_with(params, state, in_space)
}

/// [`require_rolling`] with wheels that turn at `wheel_speeds`.
fn require_rolling_with(params: &Params, state: &State, wheel_speeds: Wheels<f64>) -> Result<()> {
    state.validate()?;
    let rolling = rolling_rate(params, &state.ball_velocity);
    let (ball, body) = (&state.ball_velocity, &state.body_velocity);
    let required = [
        ("ball_position", 2, state.ball_position.z, params.ball_radius),
        ("ball_velocity", 2, ball.z, 0.0),
        ("ball_angular_velocity", 0, state.ball_angular_velocity.x, rolling.x),
        ("ball_angular_velocity", 1, state.ball_angular_velocity.y, rolling.y),
        ("body_position", 0, state.body_position.x, state.ball_position.x),
        ("body_position", 1, state.body_position.y, state.ball_position.y),
        ("body_position", 2, state.body_position.z, state.ball_position.z),
        ("body_velocity", 0, body.x, ball.x),
        ("body_velocity", 1, body.y, ball.y),
        ("body_velocity", 2, body.z, ball.z),
        ("wheel_speeds", 0, state.wheel_speeds[0], wheel_speeds[0]),
        ("wheel_speeds", 1, state.wheel_speeds[1], wheel_speeds[1]),
        ("wheel_speeds", 2, state.wheel_speeds[2], wheel_speeds[2]),
    ];
    match required.iter().find(|(_, _, value, needed)| (value - needed).abs() > NO_SLIP_TOLERANCE) {
        None => Ok(()),
        Some((name, i, value, needed)) => Err(Error::Inconsistent(format!(
            "{name}[{i}] = {value}, but a model without slip needs {needed} within {NO_SLIP_TOLERANCE}"
        ))),
    }
}

/// Snapshot of a closed-form model: everything that changes during simulation.
#[derive(Serialize, Deserialize)]
struct Saved {
    steps: u64,
    is_finite: bool,
    coordinates: [f64; 19],
    wheel_torques: Wheels<f64>,
    force: HeldForce<f64>,
    load: [f64; 6],
    payloads: [PayloadMotion<f64>; PAYLOADS],
}
