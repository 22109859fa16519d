//! Controllers that are designed for each robot as events have sampled it.

use crate::actuator::MotorOptions;
use crate::control::Controller;
use ballbot_base::error::{Error, Result};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Quat, Vec3};
use ballbot_base::params::Params;
use ballbot_base::setpoint::LaneSetpoint;
use ballbot_base::wheels::Wheels;
use nalgebra::{Quaternion, UnitQuaternion};

/// Designs a controller for a robot; its motors act after a time (s), a multiple of the controller's sampling time.
pub type Design = dyn Fn(&Params, f64) -> Result<Box<dyn Controller>> + Send + Sync;

/// A controller for one robot: designed for its parameters and the delay of its motors, about its equilibrium on its
/// floor.
struct DrawnLaw {
    params: Params,
    delay: f64,
    law: Box<dyn Controller>,
    memory: Vec<f64>,
    /// Rotation from the equilibrium on a level floor to the equilibrium on the robot's floor, if that has a slope.
    lean: Option<UnitQuaternion<f64>>,
}

impl DrawnLaw {
    fn new(design: &Design, params: &Params, delay: f64) -> Result<Self> {
        let failed = |error| Error::Inconsistent(format!("the controller has no design for a sampled robot: {error}"));
        let law = design(&params.on_level_floor(), delay).map_err(failed)?;
        let lean = params.slope_lean().map_err(failed)?;
        Ok(Self {
            params: params.clone(),
            delay,
            memory: vec![0.0; law.memory_len()],
            law,
            lean: (params.slope() > 0.0).then(|| UnitQuaternion::from_scaled_axis(lean.push(0.0))),
        })
    }

    /// Motor torques, at most `largest`, N·m.
    fn torques(
        &mut self,
        state: &LaneState<f64>,
        setpoint: &LaneSetpoint<f64>,
        strength: Wheels<f64>,
        largest: f64,
    ) -> Result<Wheels<f64>> {
        let Self { params, law, memory, lean, .. } = self;
        let mut seen = *state;
        let mut held = Wheels::default();
        if let Some(lean) = lean {
            let Quat { w, v } = state.body_quaternion;
            let attitude = lean.inverse() * UnitQuaternion::new_normalize(Quaternion::new(w, v.x, v.y, v.z));
            seen.body_quaternion = Quat { w: attitude.w, v: Vec3::new(attitude.i, attitude.j, attitude.k) };
            held = params.holding_torques(attitude.euler_angles().2)?;
        }
        let torques = law.torques_one(&seen, setpoint, largest, memory);
        Ok(Wheels::from_fn(|wheel| {
            let torque = torques[wheel] + held[wheel];
            let commanded = if strength[wheel] > 0.0 { torque / strength[wheel] } else { torque };
            commanded.clamp(-largest, largest)
        }))
    }
}

/// A robot as events have sampled it.
pub struct Drawn<'a> {
    pub params: &'a Params,
    pub motors: &'a MotorOptions,
    pub control_dt: f64,
}

/// The controllers of the robots of a chunk.
#[derive(Default)]
pub struct DrawnLaws {
    /// [`Controller::id`] of the controller that is designed again for each robot.
    owner: u64,
    laws: Vec<Option<DrawnLaw>>,
}

impl DrawnLaws {
    /// Prepares the laws of `robots` robots for a controller.
    pub fn own(&mut self, owner: u64, robots: usize) {
        if self.owner != owner || self.laws.len() != robots {
            self.owner = owner;
            self.laws.clear();
            self.laws.resize_with(robots, || None);
        }
    }

    /// Clears the memory of robot `i`.
    pub fn reset(&mut self, i: usize) {
        if let Some(Some(law)) = self.laws.get_mut(i) {
            law.memory.fill(0.0);
        }
    }

    /// Motor torques of robot `i`, at most `largest`, N·m; the controller is designed again if the robot has changed.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if there is no design for the robot.
    pub fn torques(
        &mut self,
        i: usize,
        design: &Design,
        &Drawn { params, motors, control_dt }: &Drawn<'_>,
        state: &LaneState<f64>,
        setpoint: &LaneSetpoint<f64>,
        largest: f64,
    ) -> Result<Wheels<f64>> {
        // On average, commands wait half of the jitter.
        let delay = ((motors.delay + 0.5 * motors.delay_jitter) / control_dt).round() * control_dt;
        let law = match &mut self.laws[i] {
            Some(law) if law.params == *params && law.delay == delay => law,
            changed => changed.insert(DrawnLaw::new(design, params, delay)?),
        };
        law.torques(state, setpoint, Wheels(motors.strength), largest)
    }
}
