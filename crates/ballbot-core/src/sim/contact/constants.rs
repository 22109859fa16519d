//! What the solver needs of a robot, its floor and a time step: derived once, the same for all lanes.

use crate::kinematics::Omniwheels;
use crate::params::Params;
use crate::sim::outline::{BodyShape, wheel_centers};

/// Rate at which overlap is removed, 1/s, and the largest share of it in one step.
const RECOVERY_RATE: f64 = 100.0;
const LARGEST_RECOVERY: f64 = 0.2;

/// Numbers in SI units, vectors in the body frame.
#[derive(Clone, Debug)]
pub struct Constants {
    pub sim_dt: f64,
    pub gravity: f64,
    pub ball_radius: f64,
    pub ball_mass_inverse: f64,
    pub ball_viscous_friction: f64,
    pub body_mass_inverse: f64,
    pub body_inertia: [f64; 3],
    pub body_inertia_inverse: [f64; 3],
    /// From the body frame's origin up to the CoM.
    pub com_height: f64,
    pub wheel_radius: f64,
    pub wheel_inertia: f64,
    /// From the CoM.
    pub wheel_centers: [[f64; 3]; 3],
    /// u_i; the axle of wheel i is −u_i.
    pub u: [[f64; 3]; 3],
    pub wheel_static_friction: f64,
    pub wheel_dynamic_friction: f64,
    pub floor_static_friction: f64,
    pub floor_dynamic_friction: f64,
    pub critical_velocity_inverse: f64,
    /// Share of an overlap that a step removes, over its time.
    pub recovery: f64,
    /// The cylinder that stands for the body: radius, and its ends from the CoM.
    pub body_radius: f64,
    pub body_bottom: f64,
    pub body_top: f64,
    /// Distance from the CoM within which all of the bot is.
    pub reach: f64,
    /// r_k² / J_k and r_w² / J_w.
    pub ball_turning: f64,
    pub wheel_turning: f64,
    /// Load of a wheel at rest upright, and of the floor.
    pub static_wheel_load: f64,
    pub static_floor_load: f64,
}

impl Constants {
    /// Of `params` (valid ones) in steps of `sim_dt`.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        let wheels = Omniwheels::new(params);
        let shape = BodyShape::new(params);
        let com = params.body_com_height;
        let centers = wheel_centers(params, &wheels).map(|c| [c.x, c.y, c.z - com]);
        let row = |i: usize| [wheels.u[(i, 0)], wheels.u[(i, 1)], wheels.u[(i, 2)]];
        let (bottom, top) = (shape.bottom - com, shape.top - com);
        let wheel_reach = centers[0].iter().map(|x| x * x).sum::<f64>().sqrt() + params.wheel_radius;
        Self {
            sim_dt,
            gravity: params.gravity,
            ball_radius: params.ball_radius,
            ball_mass_inverse: params.ball_mass.recip(),
            ball_viscous_friction: params.ball_viscous_friction,
            body_mass_inverse: params.body_mass.recip(),
            body_inertia: params.body_inertia,
            body_inertia_inverse: params.body_inertia.map(f64::recip),
            com_height: com,
            wheel_radius: params.wheel_radius,
            wheel_inertia: params.wheel_inertia,
            wheel_centers: centers,
            u: [row(0), row(1), row(2)],
            wheel_static_friction: params.wheel_static_friction,
            wheel_dynamic_friction: params.wheel_dynamic_friction,
            floor_static_friction: params.floor_static_friction,
            floor_dynamic_friction: params.floor_dynamic_friction,
            critical_velocity_inverse: params.friction_critical_velocity.recip(),
            recovery: (LARGEST_RECOVERY / sim_dt).min(RECOVERY_RATE),
            body_radius: shape.radius,
            body_bottom: bottom,
            body_top: top,
            reach: shape.radius.hypot(bottom.abs().max(top.abs())).max(wheel_reach),
            static_wheel_load: params.static_wheel_load(),
            static_floor_load: (params.body_mass + params.ball_mass) * params.gravity,
            ball_turning: params.ball_radius * params.ball_radius / params.ball_inertia,
            wheel_turning: params.wheel_radius * params.wheel_radius / params.wheel_inertia,
        }
    }
}
