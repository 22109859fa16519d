//! The planar model of the paper, eqs. (1)-(7): one vertical plane of the robot.
//!
//! Signs: in the yz-plane a positive θ_x of the paper leans towards +y and is left-handed about x. In the xz-plane a
//! positive θ_y leans towards +x and is right-handed about y. Both planes therefore have the same equations in
//! (position, tilt towards positive position). A positive virtual torque drives the ball towards positive position and
//! the mast away from it.

use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

/// Wheel inertia in place of J_w in eq. (2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WheelInertia {
    /// J_w of a single wheel, as the paper prints it.
    #[default]
    AsPrinted,
    /// Effective inertia (3/2) cos²α J_w of three wheels. With it the planar model equals the spatial model in a plane.
    ThreeWheels,
}

/// A vertical plane in which the robot moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Plane {
    /// The yz-plane, with y and θ_x.
    #[default]
    Yz,
    /// The xz-plane, with x and θ_y.
    Xz,
}

/// The equations of motion in one vertical plane, and the yaw equation (7).
#[derive(Clone, Debug)]
pub struct PlanarModel {
    params: Params,
    plane_inertia: f64,
    wheel_inertia: f64,
}

impl PlanarModel {
    /// Model of the yz-plane.
    ///
    /// # Errors
    /// As [`PlanarModel::in_plane`].
    pub fn new(params: &Params, wheel_inertia: WheelInertia) -> Result<Self> {
        Self::in_plane(params, wheel_inertia, Plane::Yz)
    }

    /// Model of either vertical plane.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] unless the robot is symmetric about its mast ([`Params::is_symmetric`]): otherwise its
    /// planes are coupled; if it has rolling, spinning or roller friction ([`Params::has_losses`]); or if the floor is
    /// tilted.
    pub fn in_plane(params: &Params, wheel_inertia: WheelInertia, plane: Plane) -> Result<Self> {
        params.require_symmetric(
            "the planar model is of robots that are symmetric about their mast; 'spatial', 'contact' and 'rigid' take any",
        )?;
        params.require_lossless(
            "the planar model has no friction of floor and rollers; 'spatial', 'contact' and 'rigid' do",
        )?;
        params.require_level("the planar model is of a level floor; 'spatial', 'contact' and 'rigid' take any")?;
        let plane_inertia = match plane {
            Plane::Yz => params.body_inertia[0],
            Plane::Xz => params.body_inertia[1],
        };
        let factor = match wheel_inertia {
            WheelInertia::AsPrinted => 1.0,
            WheelInertia::ThreeWheels => 1.5 * params.wheel_zenith.cos().powi(2),
        };
        Ok(Self { plane_inertia, wheel_inertia: factor * params.wheel_inertia, params: params.clone() })
    }

    /// Mass matrix M(q), eq. (2), with q = (position, tilt).
    pub fn mass_matrix(&self, tilt: f64) -> Matrix2<f64> {
        let p = &self.params;
        let k = p.gear_ratio();
        let arm = p.body_mass * p.body_com_height;
        let coupling = arm * tilt.cos() - self.wheel_inertia * k / p.wheel_radius;
        Matrix2::new(
            p.ball_inertia / p.ball_radius.powi(2)
                + self.wheel_inertia / p.wheel_radius.powi(2)
                + p.ball_mass
                + p.body_mass,
            coupling,
            coupling,
            self.plane_inertia + arm * p.body_com_height + self.wheel_inertia * k * k,
        )
    }

    /// Input map Q, eq. (6): rate of the virtual wheel as a function of q̇, and generalized force of its torque.
    pub fn input_map(&self) -> Vector2<f64> {
        Vector2::new(1.0 / self.params.wheel_radius, -self.params.gear_ratio())
    }

    /// Accelerations q̈ of eq. (1) under a virtual torque (N·m).
    pub fn accelerations(&self, q: &Vector2<f64>, q_dot: &Vector2<f64>, virtual_torque: f64) -> Vector2<f64> {
        let p = &self.params;
        let arm = p.body_mass * p.body_com_height;
        let sin = q[1].sin();
        let force =
            Vector2::new(arm * sin * q_dot[1].powi(2) - p.ball_viscous_friction * q_dot[0], arm * p.gravity * sin)
                + self.input_map() * virtual_torque;
        let mass = self.mass_matrix(q[1]);
        Vector2::new(
            mass[(1, 1)] * force[0] - mass[(0, 1)] * force[1],
            mass[(0, 0)] * force[1] - mass[(1, 0)] * force[0],
        ) / mass.determinant()
    }

    /// Kinetic energy plus M_b g l cos θ, J.
    pub fn energy(&self, q: &Vector2<f64>, q_dot: &Vector2<f64>) -> f64 {
        let p = &self.params;
        0.5 * q_dot.dot(&(self.mass_matrix(q[1]) * q_dot)) + p.body_mass * p.gravity * p.body_com_height * q[1].cos()
    }

    /// Yaw acceleration θ̈_z per virtual torque, eq. (7), rad/s² per N·m; the ball is free to spin about the vertical.
    pub fn yaw_gain(&self) -> f64 {
        let p = &self.params;
        let sin = p.wheel_zenith.sin();
        p.ball_inertia * p.ball_radius * p.wheel_radius
            / (p.ball_inertia * p.body_inertia[2] * p.wheel_radius.powi(2)
                + 3.0 * (p.ball_inertia + p.body_inertia[2]) * p.wheel_inertia * p.ball_radius.powi(2) * sin * sin)
    }

    /// Yaw acceleration θ̈_z under a virtual torque (N·m), eq. (7), rad/s².
    pub fn yaw_acceleration(&self, virtual_torque: f64) -> f64 {
        self.yaw_gain() * virtual_torque
    }

    /// Matrices of ẋ = A x + B τ with x = (position, tilt, their rates) about rest upright.
    pub fn linearize(&self) -> (Matrix4<f64>, Vector4<f64>) {
        let p = &self.params;
        let mass = self.mass_matrix(0.0);
        let inverse = Matrix2::new(mass[(1, 1)], -mass[(0, 1)], -mass[(1, 0)], mass[(0, 0)]) / mass.determinant();
        let stiffness = Matrix2::new(0.0, 0.0, 0.0, p.body_mass * p.gravity * p.body_com_height);
        let damping = Matrix2::new(p.ball_viscous_friction, 0.0, 0.0, 0.0);
        let mut a = Matrix4::zeros();
        a.fixed_view_mut::<2, 2>(0, 2).copy_from(&Matrix2::identity());
        a.fixed_view_mut::<2, 2>(2, 0).copy_from(&(inverse * stiffness));
        a.fixed_view_mut::<2, 2>(2, 2).copy_from(&(inverse * -damping));
        let input = inverse * self.input_map();
        (a, Vector4::new(0.0, 0.0, input[0], input[1]))
    }
}

impl std::str::FromStr for WheelInertia {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "as_printed" => Ok(Self::AsPrinted),
            "three_wheels" => Ok(Self::ThreeWheels),
            _ => Err(Error::unknown("wheel inertia", name, &["as_printed", "three_wheels"])),
        }
    }
}

impl std::str::FromStr for Plane {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "yz" => Ok(Self::Yz),
            "xz" => Ok(Self::Xz),
            _ => Err(Error::unknown("plane", name, &["yz", "xz"])),
        }
    }
}
