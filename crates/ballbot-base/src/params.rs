//! Physical parameters of a ballbot, their validation and the published presets.

mod floor;
mod geometry;
mod losses;
mod payload;
mod perturbed_floor;
mod preload;
mod presets;
pub mod robot_file;
mod rollers;

use crate::error::{Error, Result, check, positive};
use crate::fields;
use crate::fields::{Field, Fields, Limit};
use nalgebra::{Matrix3, SymmetricEigen};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt;

/// Mass, kg.
const MASS: Limit = Limit::from(1e-6).to(1e6);
/// Moment of inertia, kg·m².
const INERTIA: Limit = Limit::from(1e-18).to(1e9);
/// Length, m.
const LENGTH: Limit = Limit::from(1e-6).to(1e3);
/// Zenith angle, rad.
const ZENITH: Limit = Limit::from(1e-3).to(FRAC_PI_2 - 1e-3);
/// Viscous friction, N/(m/s) or N·m/(rad/s).
const VISCOUS: Limit = Limit::from(0.0).to(1e6);
/// Lever arm of a friction torque, m.
const LEVER: Limit = Limit::from(0.0).to(1e3);
/// Friction coefficient.
const FRICTION: Limit = Limit::from(0.0).to(1e3);

/// Least volume spanned by the unit vectors along the wheel axles; 0.92 for the wheels of the paper.
const LEAST_DRIVE_VOLUME: f64 = 1e-6;

/// Least load of a wheel in equilibrium, as a fraction of the body's weight.
const LEAST_LOAD_SHARE: f64 = 1e-3;

/// Largest number of steps of the search for the principal moments of inertia; it needs about six.
const MAX_EIGENVALUE_STEPS: usize = 1000;

/// Largest ratio of the wheels' inertia, as a mass at their rims, to the mass of the robot.
const MAX_RIM_RATIO: f64 = 1e9;

fields! {
    /// Physical parameters of one robot on one floor. SI units and radians.
    ///
    /// `body_*` describe everything above the ball as one rigid body. They include the **mass** of the wheels and
    /// exclude the inertia of the wheels about their axles, which eq. (2) of the paper adds separately. The body
    /// frame has its origin at the ball center and z along the mast. The defaults of the optional parameters define
    /// a symmetric robot: the center of mass (CoM) of the body on the mast, the body axes its principal axes, equal
    /// wheels 120 deg apart.
    ///
    /// Limits are far beyond any robot, and far from values at which sums and products lose accuracy.
    pub struct Params {
        required {
            /// Mass M_k of the ball.
            pub ball_mass: f64, "kg", MASS;
            /// Moment of inertia J_k of the ball about any diameter.
            pub ball_inertia: f64, "kg·m²", INERTIA;
            /// Radius r_k of the ball.
            pub ball_radius: f64, "m", LENGTH;
            /// Mass M_b of body and wheels.
            pub body_mass: f64, "kg", MASS;
            /// Moments of inertia (J_xx, J_yy, J_zz) of the body about its CoM along the body axes.
            pub body_inertia: [f64; 3], "kg·m²", INERTIA;
            /// Height l of the CoM of the body above the ball center.
            pub body_com_height: f64, "m", LENGTH;
            /// Mass of one omniwheel, part of `body_mass`.
            pub wheel_mass: f64, "kg", MASS;
            /// Moment of inertia J_w of one omniwheel about its axle.
            pub wheel_inertia: f64, "kg·m²", INERTIA;
            /// Radius r_w of a wheel.
            pub wheel_radius: f64, "m", LENGTH;
            /// Zenith angle α at the ball center between the mast and a wheel contact; nominal with `wheel_zenith_offsets`.
            pub wheel_zenith: f64, "rad", ZENITH;
        }
        /// Azimuth β_i of each wheel contact about the mast.
        pub wheel_azimuths: [f64; 3] = [0.0, TAU / 3.0, 2.0 * TAU / 3.0], "rad", Limit::from(-1e3).to(1e3);
        /// Zenith of each wheel contact minus `wheel_zenith`.
        pub wheel_zenith_offsets: [f64; 3] = [0.0; 3], "rad", Limit::from(-1.5).to(1.5);
        /// Offset (x, y) of the CoM of the body from the mast, body axes.
        pub body_com_offset: [f64; 2] = [0.0; 2], "m", Limit::from(-1e3).to(1e3);
        /// Entries (J_xy, J_xz, J_yz) of the inertia matrix of the body about its CoM, with the signs of a URDF's `ixy`,
        /// `ixz`, `iyz`.
        pub body_products_of_inertia: [f64; 3] = [0.0; 3], "kg·m²", Limit::from(-1e9).to(1e9);
        /// Largest torque of one motor; by default the value at which the torques in the paper's Fig. 6c settle.
        pub max_wheel_torque: f64 = 5.0, "N·m", Limit::from(1e-9).to(1e9);
        /// Gravitational acceleration g.
        pub gravity: f64 = 9.81, "m/s²", Limit::from(1e-6).to(1e6);
        /// Viscous friction B_vk of the ball on the floor.
        pub ball_viscous_friction: f64 = 0.0, "N/(m/s)", VISCOUS;
        /// Viscous friction B_vm of a wheel joint.
        pub wheel_viscous_friction: f64 = 0.0, "N·m/(rad/s)", VISCOUS;
        /// Dry friction of a wheel joint.
        pub wheel_coulomb_friction: f64 = 0.0, "N·m", Limit::from(0.0).to(1e6);
        /// Static friction coefficient of wheel on ball, along the drive direction; Table III.
        pub wheel_static_friction: f64 = 1.1, "", FRICTION;
        /// Dynamic friction coefficient of wheel on ball, along the drive direction; Table III.
        pub wheel_dynamic_friction: f64 = 1.0, "", FRICTION;
        /// Static friction coefficient of the floor; Table III, other pairs.
        pub floor_static_friction: f64 = 1.1, "", FRICTION;
        /// Dynamic friction coefficient of the floor; Table III, other pairs.
        pub floor_dynamic_friction: f64 = 1.05, "", FRICTION;
        /// Critical slip speed of the Stribeck law, between static and dynamic friction; Table III.
        pub friction_critical_velocity: f64 = 0.1, "m/s", Limit::from(1e-9).to(1e3);
        /// Rolling friction of the ball on the floor: largest resisting torque per unit of normal force.
        pub floor_rolling_friction: f64 = 0.0, "m", LEVER;
        /// Spinning friction of the ball on the floor: largest torque about the vertical per load.
        pub floor_spinning_friction: f64 = 0.0, "m", LEVER;
        /// Friction coefficient of the rollers of a wheel, along its free direction.
        pub roller_friction: f64 = 0.0, "", FRICTION;
        /// Growth of that coefficient with the speed of the ball along the free direction.
        pub roller_friction_slope: f64 = 0.0, "s/m", FRICTION;
        /// Ripple A of a wheel's rim: how much smaller its radius is between two rollers than at the middle of a roller;
        /// 0: round wheels. Of `contact` and `rigid` only.
        pub roller_ripple: f64 = 0.0, "m", LEVER;
        /// Rollers n of a wheel, in all its rows, that pass the ball per turn; a whole number.
        pub roller_count: f64 = 12.0, "", Limit::from(3.0).to(1e3);
        /// Phase φ_i of the ripple of each wheel: with its angle ψ_i the rim is A (1 - cos(n ψ_i + φ_i)) / 2 below
        /// `wheel_radius`.
        pub roller_phases: [f64; 3] = [0.0; 3], "rad", Limit::from(-1e3).to(1e3);
        /// Angle γ by which the axes of the rollers are turned from the rim's direction: 0 for omniwheels, ±π/4 for mecanum
        /// wheels. At the contact, seen from the wheel's center, a positive angle turns them counterclockwise.
        pub roller_angle: f64 = 0.0, "rad", Limit::from(-1.2).to(1.2);
        /// Preload P: constant force with which body and ball pull each other along the mast through the ball's center, as
        /// springs, magnets or a keeper below the ball's equator do. It adds to the wheel loads, and to no other.
        pub wheel_preload: f64 = 0.0, "N", Limit::from(0.0).to(1e6);
        /// Mass of a payload that moves on the body, as a point; 0: none. It is part of `body_mass`: `body_*` describe the body
        /// with its payload at its place. Of `spatial`, `contact` and `rigid`.
        pub payload_mass: f64 = 0.0, "kg", Limit::from(0.0).to(1e6);
        /// Place of the payload, body frame, while the robot is at rest in equilibrium on a level floor.
        pub payload_position: [f64; 3] = [0.0; 3], "m", Limit::from(-1e3).to(1e3);
        /// Stiffness of the springs between body and payload along the body axes.
        pub payload_stiffness: [f64; 3] = [0.0; 3], "N/m", Limit::from(0.0).to(1e12);
        /// Viscous damping between body and payload along the body axes.
        pub payload_damping: [f64; 3] = [0.0; 3], "N/(m/s)", Limit::from(0.0).to(1e9);
        /// Amplitude of a sinusoidal motion of the springs' rest position along the body axes, like a loaded arm's.
        pub payload_amplitude: [f64; 3] = [0.0; 3], "m", Limit::from(-1e3).to(1e3);
        /// Period of `payload_amplitude`.
        pub payload_period: f64 = 1.0, "s", Limit::from(0.01).to(1e9);
        /// Phases of `payload_amplitude` at the start of an episode; 0: the rest passes the payload's place.
        pub payload_phases: [f64; 3] = [0.0; 3], "rad", Limit::from(-1e3).to(1e3);
        /// Mass of a second payload, as `payload_mass`, for a robot that has a first.
        pub second_payload_mass: f64 = 0.0, "kg", Limit::from(0.0).to(1e6);
        /// As `payload_position`.
        pub second_payload_position: [f64; 3] = [0.0; 3], "m", Limit::from(-1e3).to(1e3);
        /// As `payload_stiffness`.
        pub second_payload_stiffness: [f64; 3] = [0.0; 3], "N/m", Limit::from(0.0).to(1e12);
        /// As `payload_damping`.
        pub second_payload_damping: [f64; 3] = [0.0; 3], "N/(m/s)", Limit::from(0.0).to(1e9);
        /// As `payload_amplitude`.
        pub second_payload_amplitude: [f64; 3] = [0.0; 3], "m", Limit::from(-1e3).to(1e3);
        /// As `payload_period`.
        pub second_payload_period: f64 = 1.0, "s", Limit::from(0.01).to(1e9);
        /// As `payload_phases`.
        pub second_payload_phases: [f64; 3] = [0.0; 3], "rad", Limit::from(-1e3).to(1e3);
        /// Rotation vector (x, y), in the frame of the floor, that rotates a level floor into this floor; its length, the
        /// slope, is at most 0.5. Gravity is `gravity_vector`.
        pub floor_tilt: [f64; 2] = [0.0; 2], "rad", Limit::from(-0.5).to(0.5);
        /// Gradient (x, y) of floor friction: at a place its coefficients are multiplied by 1 at the origin plus the gradient
        /// times the place, within 0 and 2. Of `contact` and `rigid` only.
        pub floor_friction_gradient: [f64; 2] = [0.0; 2], "1/m", Limit::from(-1e6).to(1e6);
        /// Side of the square patches in which floor friction differs, one of them around the origin; 0: none. Of `contact` and `rigid` only.
        pub floor_patch_size: f64 = 0.0, "m", Limit::from(0.0).to(1e6);
        /// Limits of the factor of floor friction of a patch, which is uniform between them.
        pub floor_patch_friction: [f64; 2] = [1.0; 2], "", Limit::from(0.0).to(1e3);
        /// Seed of the factors of the patches; only its integer part is used.
        pub floor_patch_seed: f64 = 0.0, "", Limit::from(0.0).to(4_294_967_295.0);
        /// Amplitude (x, y) of a sinusoidal floor tilt, like a ship's, added to `floor_tilt`; the sum is at most 0.5.
        pub floor_tilt_amplitude: [f64; 2] = [0.0; 2], "rad", Limit::from(-0.5).to(0.5);
        /// Period of `floor_tilt_amplitude`.
        pub floor_tilt_period: f64 = 10.0, "s", Limit::from(0.1).to(1e9);
        /// Phases (x, y) of `floor_tilt_amplitude` at the start of an episode; 0: the floor passes its mean tilt.
        pub floor_tilt_phases: [f64; 2] = [0.0; 2], "rad", Limit::from(-1e3).to(1e3);
        /// Amplitude (x, y) of a periodic acceleration of the floor in its plane, like a tram's.
        pub floor_acceleration: [f64; 2] = [0.0; 2], "m/s²", Limit::from(-1e3).to(1e3);
        /// Period of `floor_acceleration`.
        pub floor_acceleration_period: f64 = 10.0, "s", Limit::from(0.1).to(1e9);
        /// Phase of `floor_acceleration` at the start of an episode; 0: from zero.
        pub floor_acceleration_phase: f64 = 0.0, "rad", Limit::from(-1e3).to(1e3);
        /// Fraction of a quarter period in which a trapezoidal acceleration rises to its amplitude; 0: it is sinusoidal.
        pub floor_acceleration_rise: f64 = 0.0, "", Limit::from(0.0).to(1.0);
    }
}

/// Viscous friction B_vk in the paper's simulations, N/(m/s) (section III-A, "arbitrary"). It is not in Table II and
/// therefore not in the preset.
pub const PAPER_BALL_VISCOUS_FRICTION: f64 = 49.849;

impl Params {
    /// Names and values of all parameters; a scalar is a slice of one.
    pub fn fields(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        Self::FIELDS.iter().map(|field| field.name).zip(self.slices())
    }

    /// Parameters from named values; a scalar is a slice of one.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`] or [`Error::MissingParameters`]; errors of [`Params::validate`].
    pub fn from_fields<'n, 'v>(fields: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let mut given = Vec::new();
        let fields = fields.into_iter().inspect(|(name, _)| given.push(*name));
        let params = Self::defaults().assign(fields)?;
        let missing = |field: &&Field| field.required && !given.contains(&field.name);
        let names: Vec<_> = Self::FIELDS.iter().filter(missing).map(|field| field.name).collect();
        if !names.is_empty() {
            return Err(Error::MissingParameters { names });
        }
        params.validate()?;
        Ok(params)
    }

    /// Copy with some values changed.
    ///
    /// # Errors
    /// As [`Params::from_fields`], except for missing parameters.
    pub fn replace<'n, 'v>(&self, changes: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let params = self.clone().assign(changes)?;
        params.validate()?;
        Ok(params)
    }

    fn assign<'n, 'v>(mut self, values: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        for (name, values) in values {
            self.set_of("parameter", name, values)?;
        }
        Ok(self)
    }

    /// Checks that the values are physically possible.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`], naming the value and the limit.
    pub fn validate(&self) -> Result<()> {
        self.check_limits()?;
        self.validate_rims()?;
        self.validate_masses()?;
        self.validate_geometry()?;
        self.validate_friction()?;
        self.validate_rollers()?;
        self.validate_preload()?;
        self.validate_payloads()?;
        self.validate_slope()?;
        self.validate_perturbed_floor()
    }

    /// Checks that a torque of a motor, called `name`, is within `max_wheel_torque`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the value and the limit.
    pub fn check_torque(&self, name: impl fmt::Display, torque: f64) -> Result<()> {
        let limit = self.max_wheel_torque;
        let words = format_args!("at most the motors' limit, params.max_wheel_torque = {limit} N·m");
        check(name, torque, words, |t| t <= limit)?;
        Ok(())
    }

    /// Checks that the rims of the wheels are not so heavy that the equations of motion lose all digits.
    fn validate_rims(&self) -> Result<()> {
        let most = MAX_RIM_RATIO * (self.ball_mass + self.body_mass);
        check(
            "wheel_inertia / wheel_radius^2",
            self.wheel_inertia / self.wheel_radius.powi(2),
            format_args!("at most {most:e} kg, {MAX_RIM_RATIO:e} times the mass of ball and body"),
            |mass| mass <= most,
        )?;
        Ok(())
    }

    fn validate_masses(&self) -> Result<()> {
        // Without products of inertia the principal moments have separate names.
        if self.body_products_of_inertia == [0.0; 3] {
            self.validate_moments(&self.body_inertia, "body_inertia")?;
        } else {
            let moments = self.principal_moments()?;
            self.validate_moments(&moments, "principal moments of body_inertia with body_products_of_inertia, ")?;
        }
        check(
            "wheel_mass",
            self.wheel_mass,
            format_args!("below a third of body_mass = {}, which contains the wheels", self.body_mass),
            |m| 3.0 * m < self.body_mass,
        )?;
        Ok(())
    }

    /// Checks that principal moments of inertia are physically possible; `name` precedes their index.
    fn validate_moments(&self, moments: &[f64; 3], name: &str) -> Result<()> {
        for (i, &moment) in moments.iter().enumerate() {
            positive(format_args!("{name}[{i}]"), moment)?;
            let others = moments.iter().sum::<f64>() - moment;
            // A flat body meets the bound exactly; the margin is for rounding.
            check(
                format_args!("{name}[{i}]"),
                moment,
                format_args!("at most {others}, the sum of the other two (triangle inequality)"),
                |m| m <= others * (1.0 + 1e-9),
            )?;
        }
        Ok(())
    }

    /// Principal moments of inertia of the body about its CoM, ascending, kg·m².
    fn principal_moments(&self) -> Result<[f64; 3]> {
        let matrix = self.body_inertia_matrix();
        let largest = matrix.amax();
        let mut moments: [f64; 3] = SymmetricEigen::try_new(matrix / largest, f64::EPSILON, MAX_EIGENVALUE_STEPS)
            .ok_or_else(|| {
                Error::Inconsistent(
                    "the principal axes of body_inertia with body_products_of_inertia were not found".into(),
                )
            })?
            .eigenvalues
            .into();
        moments.sort_by(f64::total_cmp);
        Ok(moments.map(|moment| moment * largest))
    }

    fn validate_geometry(&self) -> Result<()> {
        // A thin shell is the upper bound. Published values are rounded, hence the margin of 1 %.
        let shell = 2.0 / 3.0 * self.ball_mass * self.ball_radius.powi(2);
        check(
            "ball_inertia",
            self.ball_inertia,
            format_args!("at most 2/3 ball_mass ball_radius^2 = {shell}, the inertia of a thin shell"),
            |j| j <= 1.01 * shell,
        )?;
        for (i, &zenith) in self.wheel_zeniths().iter().enumerate() {
            let name = format_args!("wheel_zenith + wheel_zenith_offsets[{i}]");
            check(name, zenith, ZENITH, |a| ZENITH.contains(a))?;
        }
        let drive = self.drive_matrix().determinant().abs();
        check(
            "the volume spanned by the axles of the wheels",
            drive,
            format_args!("at least {LEAST_DRIVE_VOLUME}: three wheels must turn the ball about every axis"),
            |volume| volume >= LEAST_DRIVE_VOLUME,
        )?;
        let weight = self.body_mass * self.gravity;
        let line = if self.has_preload() {
            "the sum of the body's weight, towards its CoM, and of wheel_preload, along the mast,"
        } else {
            "the line from the ball's center to the body's CoM"
        };
        for (i, &load) in self.equilibrium_wheel_loads().iter().enumerate() {
            check(
                format_args!("the load of wheel {i} in equilibrium"),
                load,
                format_args!(
                    "at least {} N, {LEAST_LOAD_SHARE} of the body's weight: {line} must pass between the wheels",
                    LEAST_LOAD_SHARE * weight
                ),
                |load| load >= LEAST_LOAD_SHARE * weight,
            )?;
        }
        Ok(())
    }

    fn validate_friction(&self) -> Result<()> {
        for (name, fixed, moving) in [
            ("wheel_static_friction", self.wheel_static_friction, self.wheel_dynamic_friction),
            ("floor_static_friction", self.floor_static_friction, self.floor_dynamic_friction),
        ] {
            check(name, fixed, format_args!("at least the dynamic coefficient, {moving}"), |v| v >= moving)?;
        }
        Ok(())
    }

    /// Body inertia about its CoM as a matrix in the body frame, kg·m².
    pub fn body_inertia_matrix(&self) -> Matrix3<f64> {
        let [xx, yy, zz] = self.body_inertia;
        let [xy, xz, yz] = self.body_products_of_inertia;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Gear ratio k = r_k / r_w: wheel turns per turn of the ball.
    pub fn gear_ratio(&self) -> f64 {
        self.ball_radius / self.wheel_radius
    }

    /// Load of one wheel of a symmetric robot upright at rest on a level floor, (M_b g + P) / (3 cos α) with the preload
    /// P, N.
    pub fn static_wheel_load(&self) -> f64 {
        (self.body_mass * self.gravity + self.wheel_preload) / (3.0 * self.wheel_zenith.cos())
    }
}
