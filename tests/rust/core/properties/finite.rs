//! Whatever the input, a robot gives finite numbers or reports that it has diverged.

use super::{any_drive, any_shape, cases, models, robot};
use crate::support::{any_start, natural_rate, vector};
use ballbot_core::{Error, ModelKind};
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn numbers_are_finite_or_divergence_is_reported(
        params in any_shape(),
        start in any_start(1.0, 3.0),
        drive in any_drive(20.0, 6, 20),
        pushes in prop::collection::vec((vector(1.0), vector(2.0), -3.0..3.0), 6),
        sim_dt in prop_oneof![Just(1e-3), 1e-6..0.02],
    ) {
        let start = start.of(&params);
        // The momentum of a robot that has fallen over.
        let momentum = params.body_mass * params.body_com_height * natural_rate(&params);
        for kind in models(&params) {
            let Some(mut robot) = robot(kind, &params, &start, sim_dt) else { continue };
            for (torques, (impulse, point, magnitude)) in drive.torques(&params).iter().zip(&pushes) {
                let impulse = (impulse * momentum * 10.0_f64.powf(*magnitude)).map(|v| v.clamp(-1e4, 1e4));
                robot.push(&impulse, Some(&(point * params.body_com_height))).expect("within the limits of a push");
                let result = robot.step(*torques, drive.hold);
                let numbers = robot.state().to_array();
                // Rapier's multibody keeps the rates with which its step could not continue.
                let kept = kind == ModelKind::Rigid && result.is_err();
                prop_assert!(kept || numbers.iter().all(|v| v.is_finite()), "{kind}: {numbers:?}");
                match result {
                    Ok(()) => {
                        let contacts = robot.contacts();
                        let wheels = [contacts.wheel_normal_forces, contacts.wheel_tractions, contacts.wheel_slip_speeds];
                        let forces = wheels.iter().flatten().chain(&contacts.floor_force);
                        prop_assert!(forces.copied().all(f64::is_finite), "{kind}: {contacts:?}");
                        prop_assert!(robot.energy().is_finite() && robot.diverged().is_none(), "{kind}");
                    }
                    Err(Error::Diverged { reason, .. }) => {
                        prop_assert!(robot.diverged().as_ref() == Some(&reason), "{kind}: {reason}");
                        robot.reset(&start).expect("as at first");
                        prop_assert!(robot.diverged().is_none(), "{kind}: {:?}", robot.diverged());
                    }
                    Err(other) => prop_assert!(false, "{kind}: {other}"),
                }
            }
        }
    }
}
