//! The ripple of the wheels' rims, against closed forms.

use super::{Motion, Simulation, close, for_both, run};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use std::f64::consts::TAU;

/// A twentieth of a millimeter either way, twelve times per turn.
fn rippled() -> Params {
    Params { roller_ripple: 1e-4, ..Params::paper() }
}

/// How far the rim of each wheel is below its nominal radius, m.
fn depths(params: &Params, state: &State) -> [f64; 3] {
    let phase = |i: usize| params.roller_count * state.wheel_angles[i] + params.roller_phases[i];
    [0, 1, 2].map(|i| 0.5 * params.roller_ripple * (1.0 - phase(i).cos()))
}

/// Distance of each wheel from the ball, m.
fn gaps(params: &Params, wheels: &Omniwheels, state: &State) -> [f64; 3] {
    let (reach, depths) = (params.ball_radius + params.wheel_radius, depths(params, state));
    [0, 1, 2].map(|i| {
        let center = state.body_position + state.body_quaternion * (wheels.contact_directions[i] * reach);
        (center - state.ball_position).norm() - reach + depths[i]
    })
}

/// The ball spins below an upright body, so that all wheels turn at this rate, rad/s.
fn spinning(params: &Params, wheel_rate: f64) -> State {
    let spin = wheel_rate / (params.gear_ratio() * params.wheel_zenith.sin());
    State::rolling(params, Vector2::zeros(), spin, UnitQuaternion::identity(), Vector3::zeros())
}

/// With wheels in phase the body goes up and down by A / cos α, n times per turn, under a load of its weight and
/// inertia.
fn the_body_bobs_as_in_closed_form(simulation: Simulation) {
    let params = rippled();
    let (count, cos) = (params.roller_count, params.wheel_zenith.cos());
    let (rate, dt) = (7.0, 5e-4);
    let mut robot = simulation.robot(&params, dt);
    robot.reset(&spinning(&params, rate)).unwrap();
    run(robot.as_mut(), [0.0; 3], 200);
    let mut turned = robot.state().wheel_angles[0];
    let [mut off, mut lowest, mut highest] = [0.0_f64; 3];
    let (mut load, mut downs, mut was) = (0.0_f64, 0_u32, 0.0);
    let steps = 2000;
    for _ in 0..steps {
        robot.step([0.0; 3]);
        let state = robot.state();
        let height = state.body_position.z - params.ball_radius;
        off = off.max((height + depths(&params, &state)[0] / cos).abs());
        (lowest, highest) = (lowest.min(height), highest.max(height));
        downs += u32::from(was >= 0.0 && state.body_velocity.z < 0.0);
        was = state.body_velocity.z;
        // The load of a step belongs to the phase at its start.
        let phase = count * (state.wheel_angles[0] - state.wheel_speeds[0] * dt);
        let bob = -0.5 * params.roller_ripple * (count * state.wheel_speeds[0]).powi(2) * phase.cos() / cos;
        let expected = params.body_mass * (params.gravity + bob) / (3.0 * cos);
        let loads = robot.contacts().wheel_normal_forces;
        load = loads.iter().fold(load, |worst, load| worst.max((load - expected).abs()));
    }
    turned = robot.state().wheel_angles[0] - turned;
    let amplitude = params.roller_ripple / cos;
    close("off the ripple", off, 0.0, 2e-7);
    close("bob", highest - lowest, amplitude, 2e-7);
    close("times down", f64::from(downs), turned * count / TAU, 1.0);
    let ripple = 0.5 * params.roller_ripple * (count * rate).powi(2) / cos * params.body_mass / (3.0 * cos);
    close("load", load, 0.0, 0.05 * ripple);
}

/// Energy at the middle of the last step, where its velocities are; positions are at its end.
fn energy(robot: &dyn Model, dt: f64) -> f64 {
    let (params, state) = (robot.params(), robot.state());
    let com_velocity =
        state.body_velocity + state.body_quaternion * state.body_angular_velocity.cross(&params.body_com());
    let rise = params.body_mass * com_velocity.z + params.ball_mass * state.ball_velocity.z;
    robot.energy() - 0.5 * dt * params.gravity * rise
}

/// The energy of the vertical motion comes from the wheels: the ripple does no work. Later the robot falls.
fn ripple_does_no_work(simulation: Simulation) {
    let params = rippled();
    let dt = 1e-3;
    let swing = params.body_mass * params.gravity * params.roller_ripple / params.wheel_zenith.cos();
    for (name, start, steps) in [("spinning", spinning(&params, 7.0), 1000), ("rolling", rolling(&params), 300)] {
        let mut robot = simulation.robot(&params, dt);
        robot.reset(&start).unwrap();
        robot.step([0.0; 3]);
        let first = energy(robot.as_ref(), dt);
        let (mut off, mut bob) = (0.0_f64, 0.0_f64);
        for _ in 0..steps {
            robot.step([0.0; 3]);
            off = off.max((energy(robot.as_ref(), dt) - first).abs());
            bob = bob.max((robot.state().body_position - robot.state().ball_position).norm());
        }
        assert!(bob > 0.5 * params.roller_ripple, "{name}: no bob");
        close(name, off, 0.0, 0.01 * swing);
    }
}

/// Upright at 0.5 m/s in a direction in which all wheels turn, their rims out of phase.
fn rolling(params: &Params) -> State {
    let velocity = Vector2::new(0.4, 0.3);
    State::rolling(params, velocity, 0.3, attitude(Vector2::zeros(), 0.2), Vector3::zeros())
}

/// The relative displacement x of body and ball at which each wheel touches: p_i · x is the depth of its rim.
fn the_body_is_where_three_rims_touch_the_ball(simulation: Simulation) {
    let params = Params { roller_phases: [0.4, 2.0, -2.5], ..rippled() };
    let wheels = Omniwheels::new(&params);
    let directions = Matrix3::from_columns(&wheels.contact_directions.0).transpose();
    let mut robot = simulation.robot(&params, 1e-3);
    robot.reset(&rolling(&params)).unwrap();
    // The start assumes round rims; the body then settles on them.
    run(robot.as_mut(), [0.0; 3], 100);
    let (mut worst, mut apart) = (0.0_f64, 0.0_f64);
    for _ in 0..300 {
        robot.step([0.0; 3]);
        let state = robot.state();
        let offset = state.body_quaternion.inverse_transform_vector(&(state.body_position - state.ball_position));
        let expected = directions.lu().solve(&-Vector3::from(depths(&params, &state))).unwrap();
        worst = worst.max((offset - expected).norm());
        apart = gaps(&params, &wheels, &state).iter().fold(apart, |worst, gap| worst.max(gap.abs()));
        assert!(robot.contacts().wheel_normal_forces.iter().all(|load| *load > 0.0));
    }
    close("displacement", worst, 0.0, 2e-7);
    close("gaps", apart, 0.0, 1e-7);
}

/// Beyond A n² ψ̇² = 2 g cos α the wheels lift off at the top of each roller.
fn wheels_lift_off_where_the_closed_form_predicts(simulation: Simulation) {
    for (share, lifts) in [(0.97, false), (1.05, true)] {
        let params = Params { roller_ripple: 2e-4, ..rippled() };
        let top = 2.0 * share * params.gravity * params.wheel_zenith.cos() / params.roller_ripple;
        let mut robot = simulation.robot(&params, 2e-4);
        robot.reset(&spinning(&params, top.sqrt() / params.roller_count)).unwrap();
        let mut lifted = 0;
        for _ in 0..2000 {
            robot.step([0.0; 3]);
            lifted += usize::from(robot.contacts().wheel_normal_forces == Wheels::default());
        }
        assert_eq!(lifted > 0, lifts, "{share}: {lifted} steps in the air");
    }
}

/// Wheels that slip so fast that rollers pass within a step: rims with a ripple of 0.5 mm reached 6 mm into the ball,
/// and the robot was thrown off.
fn fast_rims_do_not_reach_deep_into_the_ball(simulation: Simulation) {
    for (count, case) in [6.0, 12.0].into_iter().flat_map(|count| (0..10).map(move |case| (count, f64::from(case)))) {
        let angle = 0.62 * case;
        let params = Params {
            roller_ripple: 5e-4,
            roller_count: count,
            roller_phases: [angle, 2.0 * angle, -angle],
            wheel_static_friction: 0.1,
            wheel_dynamic_friction: 0.1,
            ..Params::paper()
        };
        let wheels = Omniwheels::new(&params);
        let mut robot = simulation.robot(&params, 1.0 / 256.0);
        let wheel_speeds = Wheels([330.0, -250.0, 290.0 + 10.0 * case]);
        robot.reset(&State { wheel_speeds, ..State::upright(&params) }).unwrap();
        for _ in 0..10 {
            robot.step([0.0; 3]);
            let deepest = gaps(&params, &wheels, &robot.state()).into_iter().fold(0.0, f64::min);
            // The rest is due to the change of the wheel's rate within the step.
            assert!(deepest > -2e-3, "{deepest:e} m into the ball, {count} rollers, case {case}");
        }
    }
}

/// The phase follows from the angle within a turn.
fn many_turns_change_nothing(simulation: Simulation) {
    let params = rippled();
    let [one, other] = [0.0, 1e4].map(|turns| {
        let mut robot = simulation.robot(&params, 1e-3);
        let start = State { wheel_angles: Wheels([turns * TAU, -turns * TAU, turns * TAU]), ..rolling(&params) };
        robot.reset(&start).unwrap();
        run(robot.as_mut(), [0.01, -0.02, 0.0], 200);
        robot.state()
    });
    let off = (one.body_position - other.body_position).norm() + one.body_quaternion.angle_to(&other.body_quaternion);
    close("apart", off, 0.0, 1e-9);
    assert!(off > 0.0, "the start has no turns");
}

/// Steep wheels with light rims and dry joints: where all three rims jam against the ball no impulses meet all conditions.
fn jammed_rims_add_no_energy(simulation: Simulation) {
    let params = Params {
        ball_mass: 1.9513229862035044,
        ball_inertia: 0.009134660416242063,
        ball_radius: 0.09940135592349908,
        body_mass: 2.9484753962091905,
        body_inertia: [0.06758944742341924, 0.048305774300245206, 0.05828989715177509],
        body_com_height: 0.38329273217428256,
        wheel_mass: 0.061419364232636935,
        wheel_inertia: 1.9017748961513327e-5,
        wheel_radius: 0.020795402257892687,
        wheel_zenith: 1.083367781528703,
        wheel_azimuths: [4.79522446620986, 2.700829363816665, 0.6064342614234697],
        wheel_viscous_friction: 7.241770500785882e-6,
        wheel_coulomb_friction: 0.08171500167602017,
        wheel_static_friction: 0.6644631733602596,
        wheel_dynamic_friction: 0.6644631733602596,
        floor_static_friction: 0.7568871912895957,
        floor_dynamic_friction: 0.7568871912895957,
        roller_ripple: 0.9816936079148993 * 0.020795402257892687 * (1.0 - (TAU / 16.0).cos()),
        roller_count: 8.0,
        roller_phases: [2.31817440062469, -0.45697304366127817, 1.9493355463656885],
        ..Params::paper()
    };
    let rate = (params.gravity / params.body_com_height).sqrt();
    let mut start = State::rolling(
        &params,
        Vector2::new(0.3134398427515051, -0.4646114882450189) * (params.body_com_height * rate),
        0.10959229010664324 * rate,
        attitude(Vector2::new(0.21652304215904852, -0.1356428714639396), 0.8575200761456232),
        Vector3::new(0.42504307972175687, 0.2697414387604021, -0.38302512072394174) * rate,
    );
    let slips = [-1.2265605740546628, -0.676135975344319, -0.7774403978919192];
    start.wheel_speeds.iter_mut().zip(slips).for_each(|(speed, slip)| *speed += slip * rate * params.gear_ratio());
    start.ball_angular_velocity += Vector3::new(0.09154751755750092, -0.21268536016062917, 0.8960216295770956) * rate;
    let mut robot = simulation.robot(&params, 0.005 / rate);
    robot.reset(&start).unwrap();
    let mut lowest = robot.energy();
    let scale = lowest + params.body_mass * params.gravity * params.body_com_height;
    let mut rise = 0.0_f64;
    while !robot.bot_on_floor() {
        robot.step([0.0; 3]);
        rise = rise.max((robot.energy() - lowest) / scale);
        lowest = lowest.min(robot.energy());
    }
    println!("rises by {rise:e}");
    assert!(rise < simulation.pick(1e-2, 1e-4), "rises by {rise:e} of its swing");
}

for_both!(
    the_body_bobs_as_in_closed_form,
    ripple_does_no_work,
    the_body_is_where_three_rims_touch_the_ball,
    wheels_lift_off_where_the_closed_form_predicts,
    many_turns_change_nothing,
    fast_rims_do_not_reach_deep_into_the_ball,
    jammed_rims_add_no_energy,
);

/// The ripple has the same effect on a driven robot in both simulations.
#[test]
fn both_simulations_agree_on_what_ripple_does() {
    let run = |simulation: Simulation, params: &Params| {
        let mut robot = simulation.robot(params, 2.5e-4);
        robot.reset(&rolling(params)).unwrap();
        run(robot.as_mut(), [0.02, -0.01, 0.03], 1200);
        let state = robot.state();
        [state.ball_position - Vector3::z() * params.ball_radius, state.body_quaternion.scaled_axis()]
    };
    let params = Params { roller_ripple: 1e-3, ..rippled() };
    let [contact, rigid] = [Simulation::Contact, Simulation::Rigid].map(|simulation| run(simulation, &params));
    let round = run(Simulation::Contact, &Params { roller_ripple: 0.0, ..params });
    for ((what, contact), (rigid, round)) in ["ball", "body"].iter().zip(contact).zip(rigid.into_iter().zip(round)) {
        let effect = (contact - round).norm();
        println!("{what}: ripple moves it by {effect:e}, simulations are {:e} apart", (contact - rigid).norm());
        assert!(effect > 1e-4 && (contact - rigid).norm() < 2e-3 * effect, "{what}");
    }
}
