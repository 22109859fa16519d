//! A PD controller of the tilt; the tilt setpoint follows from a low-passed velocity error.

use ballbot_core::control::{Law, LimitOptions, NamedLaw, Plant, Sample};
use ballbot_core::fields::Limit;
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::lanes::{Heading, Lane};
use ballbot_core::{Result, Wheels};
use nalgebra::Vector3;

ballbot_core::fields! {
    /// Gains of the feedback.
    pub struct Gains {
        /// Torque for a tilt error.
        pub tilt: f64 = 20.0, "N·m/rad", Limit::NOT_NEGATIVE;
        /// Torque for a tilt rate.
        pub rate: f64 = 1.3, "N·m·s/rad", Limit::NOT_NEGATIVE;
        /// Tilt for a velocity error.
        pub velocity: f64 = 0.03, "rad·s/m", Limit::NOT_NEGATIVE;
        /// Time constant of the low-pass of the velocity error.
        pub filter: f64 = 0.05, "s", Limit::POSITIVE;
    }
}

#[derive(Clone)]
pub struct Feedback {
    gains: Gains,
    /// Wheel torques per virtual torque about x and y.
    map: Wheels<[f64; 2]>,
    /// Fraction of the distance to the error that the low-pass covers in a sample.
    share: f64,
}

impl NamedLaw for Feedback {
    const NAME: &'static str = "feedback";
    const SUMMARY: &'static str = "PD of the tilt with velocity feedback.";
    const LABEL: &'static str = "PD";
    const LIMITS: LimitOptions = LimitOptions::CAP;
    type Options = Gains;

    fn design(plant: &Plant<'_>, gains: &Gains) -> Result<Self> {
        let wheels = Omniwheels::new(plant.params);
        let column = |axis: Vector3<f64>| wheels.wheel_torques(&axis, TorqueMap::Consistent);
        let (about_x, about_y) = (column(Vector3::x()), column(Vector3::y()));
        Ok(Self {
            map: Wheels::from_fn(|i| [about_x[i], about_y[i]]),
            share: 1.0 - (-plant.control_dt / gains.filter).exp(),
            gains: gains.clone(),
        })
    }
}

impl Law for Feedback {
    /// The low-passed velocity error in the heading frame.
    const MEMORY: usize = 2;
    const PARTS: &'static [&'static str] = &["velocity"];

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Sample { state, setpoint, .. } = *sample;
        let heading = Heading::new(state.body_quaternion);
        let [tilt_x, tilt_y] = state.body_quaternion.tilt_components();
        let [tilt_x, tilt_y] = heading.of(tilt_x, tilt_y);
        let (v, desired) = (state.ball_velocity, setpoint.velocity);
        let errors = heading.of(desired[0] - v.x, desired[1] - v.y);
        for (i, error) in errors.into_iter().enumerate() {
            let old = sample.memory.get(i);
            sample.memory.set(i, (error - old).mul_add_all(self.share, old));
        }
        // Leaning towards +x is a positive tilt about y, towards +y a negative one about x.
        let lean_x = sample.memory.get(1) * -self.gains.velocity - tilt_x;
        let lean_y = sample.memory.get(0) * self.gains.velocity - tilt_y;
        let rate = state.body_angular_velocity;
        let x = lean_x * self.gains.tilt - rate.x * self.gains.rate;
        let y = lean_y * self.gains.tilt - rate.y * self.gains.rate;
        sample.limited(self.map.map(|[of_x, of_y]| x * of_x + y * of_y)).torques
    }
}
