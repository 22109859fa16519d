//! Dimensional analysis: a robot in other units of length, mass and time is another robot, whose motion is the same in
//! those units. Constants of a simulation in meters, kilograms or seconds show here, and are tested separately.

use super::{Drive, Run, any_drive, cases, most_apart, robot, run, run_upright, run_with_grip, same_cases};
use crate::support::{Start, any_losses, any_ripple, any_robot, any_start};
use ballbot_core::{ModelKind, Params, State};
use proptest::prelude::*;

/// Ratios of the old to the new units of length, mass and time.
#[derive(Clone, Copy, Debug)]
struct Units {
    length: f64,
    mass: f64,
    time: f64,
}

impl Units {
    fn speed(self) -> f64 {
        self.length / self.time
    }

    fn inertia(self) -> f64 {
        self.mass * self.length * self.length
    }

    fn torque(self) -> f64 {
        self.inertia() / (self.time * self.time)
    }

    fn params(self, p: &Params) -> Params {
        Params {
            ball_mass: p.ball_mass * self.mass,
            ball_inertia: p.ball_inertia * self.inertia(),
            ball_radius: p.ball_radius * self.length,
            body_mass: p.body_mass * self.mass,
            body_inertia: p.body_inertia.map(|j| j * self.inertia()),
            body_com_height: p.body_com_height * self.length,
            wheel_mass: p.wheel_mass * self.mass,
            wheel_inertia: p.wheel_inertia * self.inertia(),
            wheel_radius: p.wheel_radius * self.length,
            max_wheel_torque: p.max_wheel_torque * self.torque(),
            gravity: p.gravity * self.speed() / self.time,
            ball_viscous_friction: p.ball_viscous_friction * self.mass / self.time,
            wheel_viscous_friction: p.wheel_viscous_friction * self.inertia() / self.time,
            wheel_coulomb_friction: p.wheel_coulomb_friction * self.torque(),
            friction_critical_velocity: p.friction_critical_velocity * self.speed(),
            floor_rolling_friction: p.floor_rolling_friction * self.length,
            floor_spinning_friction: p.floor_spinning_friction * self.length,
            roller_friction_slope: p.roller_friction_slope / self.speed(),
            roller_ripple: p.roller_ripple * self.length,
            wheel_preload: p.wheel_preload * self.torque() / self.length,
            ..p.clone()
        }
    }

    fn state(self, s: &State) -> State {
        State {
            ball_position: s.ball_position * self.length,
            ball_velocity: s.ball_velocity * self.speed(),
            ball_angular_velocity: s.ball_angular_velocity / self.time,
            body_position: s.body_position * self.length,
            body_velocity: s.body_velocity * self.speed(),
            body_angular_velocity: s.body_angular_velocity / self.time,
            wheel_speeds: s.wheel_speeds.map(|speed| speed / self.time),
            ..s.clone()
        }
    }
}

/// Powers of two, which keep the digits of every number.
fn any_units(time: impl Strategy<Value = i32>) -> impl Strategy<Value = Units> {
    (-2..=2, -3..=3, time).prop_map(|(length, mass, time)| Units {
        length: 2.0_f64.powi(length),
        mass: 2.0_f64.powi(mass),
        time: 2.0_f64.powi(time),
    })
}

/// A step at which `contact` removes fractions of an overlap, and a step at which it uses a rate, which is in seconds.
const COARSE: f64 = 1.0 / 256.0;
const FINE: f64 = 1.0 / 1024.0;

/// A run without units: a robot, its start, and how it is driven.
type Motion = (Params, Start, Drive);

fn any_motion(tilt: f64, speed: f64, most: f64) -> impl Strategy<Value = Motion> {
    // In the closed-form models dry friction builds up over a wheel speed in rad/s, whatever the robot.
    let params = any_robot().prop_map(|params| Params { wheel_coulomb_friction: 0.0, ..params });
    (params, any_start(tilt, speed), any_drive(most, 20, 3))
}

/// How far the motion in other units is from the motion, in other units.
fn off(kind: ModelKind, run: Run, (params, start, drive): &Motion, units: Units, sim_dt: f64) -> f64 {
    let (start, scaled) = (start.of(params), units.params(params));
    let one = robot(kind, params, &start, sim_dt);
    let Some((mut one, mut other)) = one.zip(robot(kind, &scaled, &units.state(&start), sim_dt * units.time)) else {
        return 0.0;
    };
    let torques = drive.torques(params);
    let scaled_torques: Vec<_> = torques.iter().map(|t| t.map(|t| t * units.torque())).collect();
    let expected = run(&mut one, &torques, drive.hold);
    let found = run(&mut other, &scaled_torques, drive.hold);
    most_apart(&scaled, &expected, &found, |state| units.state(state))
}

proptest! {
    #![proptest_config(cases(80))]

    #[test]
    fn exact_models_are_scale_invariant(motion in any_motion(0.3, 0.5, 0.5), units in any_units(0..=2)) {
        for kind in [ModelKind::Planar, ModelKind::Spatial] {
            let off = off(kind, run, &motion, units, COARSE);
            prop_assert!(off <= 1e-11, "{kind}: off by {off:e}");
        }
    }

    /// With slip and lift-off, but away from the floor, which it checks for within 2 mm.
    #[test]
    fn contact_is_scale_invariant_at_long_steps(motion in any_motion(0.1, 0.3, 1.5), units in any_units(0..=2)) {
        let off = off(ModelKind::Contact, run_upright, &motion, units, COARSE);
        prop_assert!(off <= 1e-11, "off by {off:e}");
    }

    /// And with losses, whose solver ends at a tolerance, and a preload.
    #[test]
    fn contact_with_losses_is_scale_invariant(
        motion in any_motion(0.1, 0.3, 1.5), losses in any_losses(), weights in 0.0..2.0_f64, units in any_units(0..=2),
    ) {
        let (params, start, drive) = motion;
        let params = Params { wheel_preload: weights * params.body_mass * params.gravity, ..params };
        let off = off(ModelKind::Contact, run_upright, &(losses.of(&params), start, drive), units, COARSE);
        prop_assert!(off <= 1e-8, "off by {off:e}");
    }

    /// Ripple so small that no overlap is removed at the largest speed of recovery, which is in m/s.
    #[test]
    fn contact_with_ripple_is_scale_invariant(
        motion in any_motion(0.1, 0.3, 1.5), ripple in any_ripple(0.1), units in any_units(0..=2),
    ) {
        let (params, start, drive) = motion;
        let off = off(ModelKind::Contact, run_upright, &(ripple.of(&params), start, drive), units, COARSE);
        prop_assert!(off <= 1e-8, "off by {off:e}");
    }

    #[test]
    fn contact_is_invariant_under_scaling_of_length_and_mass(motion in any_motion(0.1, 0.3, 1.5), units in any_units(Just(0))) {
        let off = off(ModelKind::Contact, run_upright, &motion, units, FINE);
        prop_assert!(off <= 1e-11, "off by {off:e}");
    }
}

proptest! {
    #![proptest_config(same_cases(60))]

    /// At short steps it removes overlap at 100 1/s.
    #[test]
    fn contact_is_nearly_scale_invariant_at_short_steps(motion in any_motion(0.1, 0.2, 0.1), units in any_units(0..=2)) {
        let off = off(ModelKind::Contact, run_with_grip, &motion, units, FINE);
        prop_assert!(off <= 5e-3, "off by {off:e}");
    }

    /// The rows of its wheels hold by a viscosity in N/(m/s), and its contacts are as soft as 200 Hz.
    #[test]
    fn rigid_is_nearly_invariant_under_scaling_of_mass_and_time(motion in any_motion(0.1, 0.2, 0.1), units in any_units(0..=2)) {
        let off = off(ModelKind::Rigid, run_with_grip, &motion, units, FINE);
        let limit = if units.time == 1.0 { 1e-4 } else { 2e-2 };
        prop_assert!(off <= limit, "off by {off:e}");
    }

    #[test]
    fn rigid_is_scale_invariant_without_slip(motion in any_motion(0.1, 0.2, 0.1), length in -2..=2) {
        let units = Units { length: 2.0_f64.powi(length), mass: 1.0, time: 1.0 };
        let off = off(ModelKind::Rigid, run_with_grip, &motion, units, FINE);
        prop_assert!(off <= 1e-5, "off by {off:e}");
    }
}
