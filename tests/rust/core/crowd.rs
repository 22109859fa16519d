//! Several robots in one world: one is a robot, those apart are single robots, impacts in closed form, conserved quantities.

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::sim::Between;
use ballbot_core::terrain::{Obstacle, Terrain};
use ballbot_core::{Ballbot, Crowd, Deflection, Error, Force, ModelKind, Params, State, Wheels};
use nalgebra::Vector3;
use std::sync::Arc;

const SMOOTH: Between = Between { friction: 0.0, restitution: 0.0 };

fn crowd(robots: &[Params], positions: &[[f64; 2]], between: Between) -> Crowd {
    Crowd::new(robots, positions, None, between, 1e-3).unwrap()
}

fn single(params: &Params, terrain: Option<&Arc<Terrain>>, state: &State) -> Ballbot {
    let mut robot = Ballbot::new(params, ModelKind::Rigid, 1e-3).unwrap();
    robot.set_terrain(terrain).unwrap();
    robot.reset(state).unwrap();
    robot
}

/// A robot whose ball is its widest part.
fn wide() -> Params {
    Params { wheel_zenith: 20_f64.to_radians(), ..Params::paper() }
}

/// A state that translates at `velocity` m/s, its ball not turning.
fn sliding(state: &State, velocity: Vector3<f64>) -> State {
    State { ball_velocity: velocity, body_velocity: velocity, ..state.clone() }
}

/// Momentum of ball and body, N·s.
fn momentum(params: &Params, state: &State) -> Vector3<f64> {
    let turning = state.body_quaternion * state.body_angular_velocity.cross(&params.body_com());
    state.ball_velocity * params.ball_mass + (state.body_velocity + turning) * params.body_mass
}

fn assert_same(crowd: &Crowd, singles: &[Ballbot], what: &str) {
    for (i, robot) in singles.iter().enumerate() {
        assert_eq!(crowd.state(i), robot.state(), "state of robot {i} {what}");
        assert_eq!(crowd.contacts(i), robot.contacts(), "contacts of robot {i} {what}");
    }
}

#[test]
fn one_robot_is_a_single_robot() {
    let loaded = Params::paper().with_payload(0, 0.5, [0.0, 0.0, 0.6]);
    let params = Params { payload_stiffness: [80.0; 3], payload_damping: [1.0; 3], ..loaded };
    let posts = Terrain::plane(0.0, 0.0)
        .unwrap()
        .with_obstacles(&[Obstacle::named("post", &[("x", 0.4), ("radius", 0.1), ("height", 1.0)]).unwrap()])
        .unwrap();
    let [level, slope] = [0.0, 0.1].map(|slope| Some(Arc::new(Terrain::plane(slope, 0.0).unwrap())));
    for (terrain, sideways) in [(None, 0.1), (Some(Arc::new(posts)), 0.1), (level, 2.0), (slope, 2.0)] {
        let robots = std::slice::from_ref(&params);
        let mut crowd = Crowd::new(robots, &[[0.0, 0.0]], terrain.as_ref(), SMOOTH, 1e-3).unwrap();
        let mut robot = single(&params, terrain.as_ref(), &crowd.start()[0]);
        let impulse = Vector3::new(2.0, sideways, 0.0);
        crowd.push(0, &impulse, None).unwrap();
        robot.push(&impulse, None).unwrap();
        let swaying = Deflection::from_array([0.01, -0.02, 0.0, 0.1, 0.0, 0.0]);
        crowd.set_payloads(&[[swaying, Deflection::default()]]).unwrap();
        robot.set_payloads(&[swaying, Deflection::default()]).unwrap();
        crowd.move_payload(0, 0, [0.02, 0.0, 0.0]).unwrap();
        robot.move_payload(0, [0.02, 0.0, 0.0]).unwrap();
        // A fall onto the floor, on the post where there is one.
        for _ in 0..150 {
            crowd.step(&[Wheels([0.1, -0.1, 0.05])], 10).unwrap();
            robot.step([0.1, -0.1, 0.05], 10).unwrap();
            assert_same(&crowd, std::slice::from_ref(&robot), "alone");
            assert_eq!(crowd.payloads(0), robot.payloads());
            assert_eq!(crowd.energy(0), robot.energy());
        }
        assert!(robot.bot_on_floor());
    }
}

#[test]
fn robots_apart_are_single_robots() {
    let names = ["paper", "rezero", "asroballet"];
    let robots: Vec<_> = names.iter().map(|name| Params::preset(name).unwrap()).collect();
    let hills = Terrain::generate("wave", 0, &[]).unwrap();
    for terrain in [None, Some(Arc::new(hills))] {
        let positions = [[0.0, 0.0], [1.5, 0.3], [-1.0, -1.2]];
        let mut crowd = Crowd::new(&robots, &positions, terrain.as_ref(), SMOOTH, 1e-3).unwrap();
        let mut singles: Vec<_> =
            robots.iter().zip(crowd.start()).map(|(params, state)| single(params, terrain.as_ref(), state)).collect();
        let mut laws: Vec<_> = robots.iter().map(|params| Lqr::new(params, 0.01).unwrap()).collect();
        for (i, robot) in singles.iter_mut().enumerate() {
            let impulse = Vector3::new(0.02, -0.03, 0.0) * robots[i].body_mass;
            crowd.push(i, &impulse, None).unwrap();
            robot.push(&impulse, None).unwrap();
        }
        for _ in 0..100 {
            let torques: Vec<_> = laws
                .iter_mut()
                .zip(crowd.states())
                .zip(crowd.start())
                .map(|((law, state), start)| {
                    let [x, y, _] = start.ball_position.into();
                    law.wheel_torques(&state, &Setpoint { position: [x, y].into(), ..Setpoint::default() })
                })
                .collect();
            crowd.step(&torques, 10).unwrap();
            for (robot, torques) in singles.iter_mut().zip(&torques) {
                robot.step(*torques, 10).unwrap();
            }
            if terrain.is_none() {
                assert_same(&crowd, &singles, "apart");
            } else {
                // Rapier solves contacts with slopes in groups, which changes their rounding.
                for (i, robot) in singles.iter().enumerate() {
                    let [ours, theirs] = [crowd.state(i), robot.state()];
                    assert!((ours.ball_position - theirs.ball_position).norm() < 1e-10, "robot {i}");
                    assert!(ours.body_quaternion.angle_to(&theirs.body_quaternion) < 1e-7, "robot {i}");
                    assert!((ours.body_velocity - theirs.body_velocity).norm() < 1e-9, "robot {i}");
                }
            }
        }
    }
}

#[test]
fn balls_rebound_by_their_restitution() {
    // Else floor and wheels would drive the balls during the impact.
    let params = Params {
        wheel_static_friction: 0.0,
        wheel_dynamic_friction: 0.0,
        floor_static_friction: 0.0,
        floor_dynamic_friction: 0.0,
        ..wide()
    };
    let (radius, speed) = (params.ball_radius, 0.5);
    for restitution in [0.0, 0.25, 0.5] {
        let between = Between { friction: 0.0, restitution };
        let robots = [params.clone(), params.clone()];
        let mut crowd = crowd(&robots, &[[0.0, 0.0], [2.0 * radius + 1e-3, 0.0]], between);
        let [left, right]: [State; 2] = crowd.states().try_into().unwrap();
        let toward = Vector3::x() * (0.5 * speed);
        crowd.reset(&[sliding(&left, toward), sliding(&right, -toward)]).unwrap();
        let mut rebound = f64::NEG_INFINITY;
        for _ in 0..6 {
            crowd.step(&[Wheels([0.0; 3]); 2], 1).unwrap();
            let [a, b]: [State; 2] = crowd.states().try_into().unwrap();
            rebound = rebound.max(b.ball_velocity.x - a.ball_velocity.x);
            assert!(crowd.force_between(0, 1).x >= 0.0, "the left robot pulls the right one");
        }
        let expected = restitution * speed;
        assert!((rebound - expected).abs() < 1e-6, "{rebound} m/s at {restitution}, expected {expected} m/s");
    }
}

#[test]
fn forces_between_robots_are_opposite_and_change_their_momentum() {
    let robots = [Params::paper(), Params::preset("rezero").unwrap()];
    let between = Between { friction: 0.4, restitution: 0.1 };
    let mut crowd = crowd(&robots, &[[0.0, 0.0], [0.6, 0.05]], between);
    let [left, right]: [State; 2] = crowd.states().try_into().unwrap();
    crowd.reset(&[sliding(&left, Vector3::new(1.0, 0.1, 0.0)), sliding(&right, Vector3::new(-0.6, 0.0, 0.0))]).unwrap();
    let mut exchanged = Vector3::zeros();
    for _ in 0..600 {
        let before: Vec<_> = (0..2).map(|i| momentum(&robots[i], &crowd.state(i))).collect();
        crowd.step(&[Wheels([0.0; 3]); 2], 1).unwrap();
        let [on_right, on_left] = [crowd.force_between(0, 1), crowd.force_between(1, 0)];
        assert!((on_right + on_left).norm() <= 1e-9 * on_right.norm(), "{on_right} and {on_left}");
        exchanged += on_right * 1e-3;
        for (i, from_other) in [on_left, on_right].into_iter().enumerate() {
            let contacts = crowd.contacts(i);
            let weight = Vector3::z() * (-robots[i].gravity * (robots[i].ball_mass + robots[i].body_mass));
            let force = contacts.floor_force + contacts.bot_floor_force + from_other + weight;
            let change = momentum(&robots[i], &crowd.state(i)) - before[i];
            let scale = 1e-3 * (weight.norm() + force.norm() + from_other.norm());
            assert!((change - force * 1e-3).norm() < 0.02 * scale, "robot {i}: {change} against {}", force * 1e-3);
        }
    }
    assert!(exchanged.x > 1.0, "the robots exchanged only {exchanged} N·s");
}

#[test]
fn collisions_make_no_energy() {
    for (seed, restitution) in [(0_u32, 0.0), (1, 0.3), (2, 0.5), (3, 0.5)] {
        let between = Between { friction: 0.3 * f64::from(seed), restitution };
        let robots = [Params::paper(), Params::paper(), wide()];
        let mut crowd = crowd(&robots, &[[0.0, 0.0], [0.5, 0.1], [0.2, 0.5]], between);
        let states: Vec<_> = crowd
            .states()
            .iter()
            .enumerate()
            .map(|(i, state)| {
                let to_center = Vector3::new(0.25, 0.2, 0.0) - state.ball_position;
                let turn = f64::from(seed) + i as f64;
                State {
                    body_angular_velocity: Vector3::new(turn.sin(), turn.cos(), 0.5),
                    ..sliding(state, Vector3::new(to_center.x, to_center.y, 0.0) * 3.0)
                }
            })
            .collect();
        crowd.reset(&states).unwrap();
        let energy = |crowd: &Crowd| (0..3).map(|i| crowd.energy(i)).sum::<f64>();
        let (mut least, mut touched) = (energy(&crowd), false);
        for _ in 0..1000 {
            crowd.step(&[Wheels([0.0; 3]); 3], 1).unwrap();
            touched |= crowd.force_between(0, 1).norm() > 0.0 || crowd.force_between(0, 2).norm() > 0.0;
            let now = energy(&crowd);
            assert!(now < least + 0.01 * least.abs(), "{now} J after {least} J");
            least = least.min(now);
        }
        assert!(touched, "no robots touched");
    }
}

/// Two robots that want to stand at one point lean on each other.
#[test]
fn robots_that_push_each_other_stay_outside() {
    let params = wide();
    let mut crowd = crowd(&[params.clone(), params.clone()], &[[-0.15, 0.0], [0.15, 0.0]], SMOOTH);
    let mut laws = [Lqr::new(&params, 0.01).unwrap(), Lqr::new(&params, 0.01).unwrap()];
    let setpoint = Setpoint::default();
    let mut least = f64::INFINITY;
    for _ in 0..400 {
        let torques: Vec<_> =
            laws.iter_mut().zip(crowd.states()).map(|(law, state)| law.wheel_torques(&state, &setpoint)).collect();
        crowd.step(&torques, 10).unwrap();
        let [a, b]: [State; 2] = crowd.states().try_into().unwrap();
        least = least.min((a.ball_position - b.ball_position).norm() - 2.0 * params.ball_radius);
    }
    let [on_right, on_left] = [crowd.force_between(0, 1), crowd.force_between(1, 0)];
    assert!(on_right.x > 0.1 && (on_right + on_left).norm() < 1e-9, "{on_right} N");
    assert!(least > -1e-3, "the balls overlap by {least} m");
    assert!(crowd.states().iter().all(|state| state.tilt() < 0.2));
}

#[test]
fn crowds_repeat_and_continue_to_the_last_bit() {
    let robots = [Params::paper(), Params::preset("kugle").unwrap()];
    let between = Between { friction: 0.5, restitution: 0.2 };
    let build = || {
        let mut crowd = crowd(&robots, &[[0.0, 0.0], [0.8, 0.0]], between);
        crowd.push(0, &Vector3::new(8.0, 0.0, 0.0), None).unwrap();
        crowd.apply_force(1, &Force::constant(Vector3::new(-10.0, 1.0, 0.0), None)).unwrap();
        crowd
    };
    let [mut one, mut other] = [build(), build()];
    let mut continued = build();
    let torques = [Wheels([0.05, 0.0, -0.05]); 2];
    for round in 0..40 {
        one.step(&torques, 20).unwrap();
        other.step(&torques, 20).unwrap();
        if round == 20 {
            continued.load(&one.save()).unwrap();
        } else if round > 20 {
            continued.step(&torques, 20).unwrap();
            assert_eq!(one.states(), continued.states());
            assert_eq!(one.time(), continued.time());
        }
        assert_eq!(one.states(), other.states());
        assert_eq!(one.force_between(0, 1), other.force_between(0, 1));
    }
    // A reset leaves nothing behind.
    let start = one.start().to_vec();
    one.reset(&start).unwrap();
    let mut new = crowd(&robots, &[[0.0, 0.0], [0.8, 0.0]], between);
    one.step(&torques, 100).unwrap();
    new.step(&torques, 100).unwrap();
    assert_eq!(one.states(), new.states());
}

#[test]
fn invalid_crowds_are_rejected() {
    let paper = Params::paper();
    let two = [paper.clone(), paper.clone()];
    let apart = [[0.0, 0.0], [1.0, 0.0]];
    let error = |robots: &[Params], positions: &[[f64; 2]], between: Between, dt: f64| {
        Crowd::new(robots, positions, None, between, dt).err().expect("an error").to_string()
    };
    let moon = Params { gravity: 1.62, ..Params::paper() };
    for (found, expected) in [
        (error(&[], &[], SMOOTH, 1e-3), "number of robots = 0"),
        (error(&two, &apart[..1], SMOOTH, 1e-3), "positions"),
        (error(&two, &[[0.0, 0.0], [0.1, 0.0]], SMOOTH, 1e-3), "robots 0 and 1 overlap by"),
        (error(&two, &[[0.0, 0.0], [f64::NAN, 0.0]], SMOOTH, 1e-3), "robot 1: x = NaN"),
        (error(&two, &apart, Between { friction: -0.1, ..SMOOTH }, 1e-3), "friction = -0.1"),
        (error(&two, &apart, Between { restitution: 0.6, ..SMOOTH }, 1e-3), "restitution = 0.6"),
        (error(&two, &apart, SMOOTH, 0.1), "sim_dt = 0.1"),
        (error(&[paper, moon], &apart, SMOOTH, 1e-3), "robot 1 has gravity = [1.62]"),
    ] {
        assert!(found.contains(expected), "'{found}' lacks '{expected}'");
    }

    let mut crowd = crowd(&two, &apart, SMOOTH);
    let before = crowd.states();
    let mut below = before.clone();
    below[1].body_position.z -= 0.3;
    assert!(crowd.reset(&below).unwrap_err().to_string().contains("robot 1: "));
    assert!(matches!(crowd.reset(&before[..1]), Err(Error::Length { .. })));
    assert!(crowd.reset(&[before[0].clone(), before[0].clone()]).unwrap_err().to_string().contains("overlap"));
    assert!(matches!(crowd.step(&[Wheels([0.0; 3])], 1), Err(Error::Length { .. })));
    let strong = [Wheels([0.0; 3]), Wheels([0.0, 0.0, 1e3])];
    assert!(crowd.step(&strong, 1).unwrap_err().to_string().contains("wheel_torques[1][2] = 1000"));
    assert_eq!(crowd.states(), before);
    assert!(crowd.load(&self::crowd(&two, &[[0.0, 0.0], [1.1, 0.0]], SMOOTH).save()).is_ok());
    assert!(crowd.load(&self::crowd(&two[..1], &apart[..1], SMOOTH).save()).is_err());
}

#[test]
fn a_robot_that_leaves_the_bounds_is_named() {
    let params = Params::paper();
    let edge = Arc::new(Terrain::generate("wave", 0, &[("size_x", 4.0), ("size_y", 4.0)]).unwrap());
    let positions = [[0.0, 0.0], [1.0, 0.0]];
    let mut crowd = Crowd::new(&[params.clone(), params], &positions, Some(&edge), SMOOTH, 1e-3).unwrap();
    crowd.push(1, &Vector3::new(40.0, 0.0, 0.0), None).unwrap();
    let found = crowd.step(&[Wheels([0.0; 3]); 2], 3000).unwrap_err();
    assert!(matches!(found, Error::Diverged { .. }) && found.to_string().contains("robot 1: the ball left"), "{found}");
    assert!(crowd.step(&[Wheels([0.0; 3]); 2], 1).is_err());
    let start = crowd.start().to_vec();
    crowd.reset(&start).unwrap();
    crowd.step(&[Wheels([0.0; 3]); 2], 1).unwrap();
}
