//! Loads and tractions of the wheels near equilibrium, as linear maps of tilt and torques.

use super::{BallSpin, SpatialModel, WheelSpin};
use ballbot_base::params::Params;
use ballbot_base::state::Contacts;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{UnitQuaternion, Vector3, Vector6};

/// Step of the differences with respect to the tilt, rad. Loads at rest are trigonometric functions of the tilt: the
/// error is 1e-8.
const TILT_STEP: f64 = 1e-4;

/// Load N and traction f of a wheel without slip: constants and derivatives at rest in equilibrium, and the part
/// quadratic in the tilt rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelLoad {
    /// In equilibrium without torque, N; of a load with the preload.
    pub at_rest: f64,
    /// Per tilt about the x and y axes of the heading frame, N/rad.
    pub per_tilt: [f64; 2],
    /// Per torque of each wheel, N/(N·m).
    pub per_torque: Wheels<f64>,
    /// Per square of the tilt rate, mean of rates about x and y, N/(rad/s)²: the body rotates about the ball's center.
    pub per_rate_squared: f64,
}

/// Loads N_i and tractions f_i of the three wheels for motion without slip, linear in tilt and torques.
///
/// N = N⁰ + N_ϑ ϑ + N_τ τ + N_Ω |Ω|², and f likewise. The maps linearize [`SpatialModel::contacts`] without joint
/// friction and losses: exact in the torques, first order in the tilt from equilibrium. At a tilt of 25 deg of the
/// paper's robot, the torque at which a wheel slips is accurate within 3 %.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadMap {
    /// N_i, N.
    pub loads: Wheels<WheelLoad>,
    /// f_i on the ball along the drive direction, N.
    pub tractions: Wheels<WheelLoad>,
}

impl LoadMap {
    /// The maps of the robot of `params`.
    pub fn new(params: &Params) -> Self {
        let smooth = Params {
            wheel_coulomb_friction: 0.0,
            wheel_viscous_friction: 0.0,
            ..params.on_level_floor().without_losses()
        };
        let model = SpatialModel::new(&smooth, WheelSpin::Absolute, BallSpin::Free);
        let equilibrium = params.to_balance_frame();
        let contacts = |tilt: [f64; 2], rate: [f64; 2], torques: Wheels<f64>| {
            let attitude = UnitQuaternion::from_scaled_axis(Vector3::new(tilt[0], tilt[1], 0.0)) * equilibrium;
            let rate = equilibrium.inverse_transform_vector(&Vector3::new(rate[0], rate[1], 0.0));
            // The ball is at rest.
            model.contacts(&attitude, &Vector6::new(0.0, 0.0, rate.x, rate.y, rate.z, 0.0), torques)
        };
        let at_rest = contacts([0.0; 2], [0.0; 2], Wheels::default());
        let mut map = Self::default();
        map.fill(&at_rest, |wheel, value, _| wheel.at_rest = value);
        for axis in 0..2 {
            let unit = |size: f64| [if axis == 0 { size } else { 0.0 }, if axis == 1 { size } else { 0.0 }];
            let [ahead, behind] = [1.0, -1.0].map(|sign| contacts(unit(sign * TILT_STEP), [0.0; 2], Wheels::default()));
            map.fill(&ahead, |wheel, value, _| wheel.per_tilt[axis] += value / (2.0 * TILT_STEP));
            map.fill(&behind, |wheel, value, _| wheel.per_tilt[axis] -= value / (2.0 * TILT_STEP));
            // Even function of the rate.
            let turning = contacts([0.0; 2], unit(1.0), Wheels::default());
            map.fill(&turning, |wheel, value, at_rest| wheel.per_rate_squared += 0.5 * (value - at_rest));
        }
        for driven in 0..WHEELS {
            let torques = Wheels::from_fn(|i| f64::from(i == driven));
            let found = contacts([0.0; 2], [0.0; 2], torques);
            map.fill(&found, |wheel, value, at_rest| wheel.per_torque[driven] = value - at_rest);
        }
        map
    }

    fn fill(&mut self, contacts: &Contacts, set: impl Fn(&mut WheelLoad, f64, f64)) {
        for (wheels, values) in
            [(&mut self.loads, contacts.wheel_normal_forces), (&mut self.tractions, contacts.wheel_tractions)]
        {
            for (wheel, value) in wheels.iter_mut().zip(values) {
                let at_rest = wheel.at_rest;
                set(wheel, value, at_rest);
            }
        }
    }
}
