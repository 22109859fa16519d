//! Without motors a robot only loses energy.

use super::{robot, same_cases};
use crate::support::general::any_general_robot;
use crate::support::{
    Start, any_losses, any_ripple, any_robot, any_start, largest, natural_rate, vector, without_losses,
};
use ballbot_core::{ModelKind, Params, State};
use nalgebra::Vector3;
use proptest::prelude::*;

/// Deviation of a state from rolling without slip, in the robot's own units.
#[derive(Clone, Debug)]
struct Slip {
    /// Rates of the wheels and the ball.
    wheels: Vector3<f64>,
    ball: Vector3<f64>,
    /// Height of the ball over the floor and of the body over the ball.
    lift: [f64; 2],
}

fn any_slip() -> impl Strategy<Value = Slip> {
    let lift = || prop_oneof![Just(0.0), 0.0..0.2];
    (vector(2.0), vector(1.0), [lift(), lift()]).prop_map(|(wheels, ball, lift)| Slip { wheels, ball, lift })
}

impl Slip {
    fn of(&self, params: &Params, start: &Start) -> State {
        let mut state = start.of(params);
        let rate = natural_rate(params);
        for (speed, slip) in state.wheel_speeds.iter_mut().zip(&self.wheels) {
            *speed += slip * rate * params.gear_ratio();
        }
        state.ball_angular_velocity += self.ball * rate;
        let [ball, body] = self.lift.map(|lift| lift * params.body_com_height);
        state.ball_position.z += ball;
        state.body_position.z += ball + body;
        state
    }
}

/// Largest rise of the energy above its minimum so far within three times the fall time of a robot, as a fraction of
/// its swing; `None` if the floor is in the way of the start. A step lasts `step` of that time.
fn rise(kind: ModelKind, params: &Params, start: &State, step: f64) -> Option<f64> {
    rises(kind, params, start, step).map(|[_, rise]| rise)
}

/// The same before the bot touches the floor, and overall.
fn rises(kind: ModelKind, params: &Params, start: &State, step: f64) -> Option<[f64; 2]> {
    let rate = natural_rate(params);
    let mut robot = robot(kind, params, start, step / rate)?;
    let mut lowest = robot.energy();
    let scale = params.body_mass * params.gravity * params.body_com_height + lowest.abs();
    let (mut fallen, mut worst) = (false, [0.0; 2]);
    for _ in 0..(3.0 / step) as usize {
        robot.step([0.0; 3], 1).expect("nothing drives it apart");
        let energy = robot.energy();
        lowest = lowest.min(energy);
        fallen |= robot.bot_on_floor();
        let rise = (energy - lowest) / scale;
        worst = [if fallen { worst[0] } else { largest([worst[0], rise]) }, largest([worst[1], rise])];
    }
    Some(worst)
}

/// Largest rise in `rigid` once the bot touches the floor. Rapier's contacts are springs, and what light wheels store in them
/// comes back: up to 0.28 for 15 000 random robots. The limit bounds an explosion, not an error.
const RIGID_FALL: f64 = 0.5;

/// Limits of the rise before the bot touches the floor, and overall. The largest rise of 15 000 random robots in `contact`
/// was 3.5e-4, because sweeps over the floor end before they are exact.
fn check_rises(params: &Params, start: &State) -> Result<(), TestCaseError> {
    check_rises_below(params, start, 1e-4)
}

/// The same with another limit of `contact` before the bot touches the floor.
fn check_rises_below(params: &Params, start: &State, upright: f64) -> Result<(), TestCaseError> {
    for (kind, limits) in [(ModelKind::Contact, [upright, 1e-3]), (ModelKind::Rigid, [1e-2, RIGID_FALL])] {
        // The floor is in the way of some starts.
        if let Some(rises) = rises(kind, params, start, 0.005) {
            prop_assert!(rises[0] <= limits[0] && rises[1] <= limits[1], "{kind}: rises by {rises:?}");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(same_cases(150))]

    /// Except for the error of RK4, which is of fourth order.
    #[test]
    fn exact_models_never_gain_energy(params in any_robot(), start in any_start(0.5, 1.0)) {
        let params = Params { wheel_coulomb_friction: 0.0, ..params };
        let state = start.of(&params);
        for kind in [ModelKind::Planar, ModelKind::Spatial] {
            let [coarse, fine] = [0.02, 0.01].map(|step| rise(kind, &params, &state, step).expect("they have no floor"));
            prop_assert!(coarse <= 1e-3, "{kind}: rises by {coarse:e}");
            prop_assert!(fine <= 0.12 * coarse + 1e-12, "{kind}: rises by {fine:e}, by {coarse:e} in steps twice as long");
        }
    }

    /// And lose none without friction: what the error of a step may add or remove.
    #[test]
    fn exact_models_conserve_energy(params in any_robot(), start in any_start(0.5, 1.0)) {
        let params = without_losses(&params);
        let state = start.of(&params);
        for kind in [ModelKind::Planar, ModelKind::Spatial] {
            let mut robot = robot(kind, &params, &state, 0.005 / natural_rate(&params)).expect("they have no floor");
            let first = robot.energy();
            let scale = params.body_mass * params.gravity * params.body_com_height + first.abs();
            robot.step([0.0; 3], 600).expect("nothing drives it apart");
            let change = (robot.energy() - first).abs() / scale;
            prop_assert!(change <= 1e-5, "{kind}: changes by {change:e}");
        }
    }

    /// Rolling, slipping and falling over. Rapier's contacts yield before they hold, and return that energy.
    #[test]
    fn contacts_add_no_energy(params in any_robot(), start in any_start(0.3, 0.5), slip in any_slip()) {
        let slip = Slip { lift: [0.0; 2], ..slip };
        for state in [start.of(&params), slip.of(&params, &start)] {
            check_rises(&params, &state)?;
        }
    }

    /// The same with rolling, spinning and roller friction.
    #[test]
    fn losses_add_no_energy(
        params in any_robot(), losses in any_losses(), start in any_start(0.3, 0.5), slip in any_slip(),
    ) {
        let params = losses.of(&params);
        let slip = Slip { lift: [0.0; 2], ..slip };
        for state in [start.of(&params), slip.of(&params, &start)] {
            check_rises(&params, &state)?;
        }
        let rolls = rise(ModelKind::Spatial, &params, &start.of(&params), 0.005).expect("it has no floor");
        prop_assert!(rolls <= 1e-4, "spatial: rises by {rolls:e}");
    }

    /// The same on wheels with a ripple, whose slope changes within a step: an error of first order in the step. The largest
    /// rise of 2000 random robots was 2.2e-4, on wheels of six nearly straight rollers.
    #[test]
    fn ripple_adds_no_energy(
        params in any_robot(), ripple in any_ripple(1.0), start in any_start(0.3, 0.5), slip in any_slip(),
    ) {
        let params = ripple.of(&params);
        let slip = Slip { lift: [0.0; 2], ..slip };
        for state in [start.of(&params), slip.of(&params, &start)] {
            check_rises_below(&params, &state, 1e-3)?;
        }
    }

    /// The same without symmetry, before a fall; in a fall, of `contact`.
    #[test]
    fn contacts_of_general_robots_add_no_energy(
        params in any_general_robot(), start in any_start(0.3, 0.5), slip in any_slip(),
    ) {
        let slip = Slip { lift: [0.0; 2], ..slip };
        for state in [start.of(&params), slip.of(&params, &start)] {
            for (kind, limits) in [(ModelKind::Contact, [1e-4, 1e-3]), (ModelKind::Rigid, [1e-2, RIGID_FALL])] {
                // The floor is in the way of some starts.
                if let Some(rises) = rises(kind, &params, &state, 0.005) {
                    prop_assert!(rises[0] <= limits[0] && rises[1] <= limits[1], "{kind}: rises by {rises:?}");
                }
            }
        }
    }

    /// A heavy bot that lands on a light ball takes more sweeps than there are: it sinks in, and removing the overlap
    /// is work.
    #[test]
    fn landings_add_little_energy(params in any_robot(), start in any_start(0.3, 0.5), slip in any_slip()) {
        let state = slip.of(&params, &start);
        for (kind, limit) in [(ModelKind::Contact, 0.01), (ModelKind::Rigid, RIGID_FALL)] {
            let rise = rise(kind, &params, &state, 0.005).unwrap_or(0.0);
            prop_assert!(rise <= limit, "{kind}: rises by {rise:e}");
        }
    }
}
