//! Posts, boxes and walls: distances, impacts in closed form, conserved quantities, agreement of the models, lanes.

use crate::run::Run;
use ballbot_core::batch::{Autoreset, ResetRequest, task_kind};
use ballbot_core::lanes::Vec3;
use ballbot_core::terrain::{Obstacle, Terrain, TerrainKind};
use ballbot_core::{Ballbot, Error, ModelKind, Params, State};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

const MODELS: [ModelKind; 2] = [ModelKind::Contact, ModelKind::Rigid];

fn obstacle(kind: &str, parameters: &[(&str, f64)]) -> Obstacle {
    Obstacle::named(kind, parameters).unwrap()
}

/// The plane z = 0 with obstacles.
fn level(obstacles: &[Obstacle]) -> Arc<Terrain> {
    Arc::new(Terrain::plane(0.0, 0.0).unwrap().with_obstacles(obstacles).unwrap())
}

/// A wall that looks towards −x, with its face at `x`.
fn wall(x: f64, friction: f64, restitution: f64) -> Arc<Terrain> {
    level(&[obstacle("wall", &[("x", x), ("yaw", PI), ("friction", friction), ("restitution", restitution)])])
}

fn robot(params: &Params, model: ModelKind, sim_dt: f64, terrain: &Arc<Terrain>, state: &State) -> Ballbot {
    let mut robot = Ballbot::new(params, model, sim_dt).unwrap();
    robot.set_terrain(Some(terrain)).unwrap();
    robot.reset(state).unwrap();
    robot
}

/// A ball in the air, with the body far above it.
fn flying(params: &Params) -> State {
    let mut state = State::upright(params);
    state.ball_position.z = 5.0;
    state.body_position.z = 8.0;
    state
}

#[test]
fn distances_follow_from_the_shapes() {
    let terrain = level(&[
        obstacle("post", &[("x", 1.0), ("y", 2.0), ("radius", 0.3), ("height", 1.0)]),
        obstacle("box", &[("x", -2.0), ("yaw", FRAC_PI_2), ("length", 2.0), ("width", 0.5), ("height", 0.4)]),
        obstacle("wall", &[("x", 5.0), ("yaw", PI)]),
    ]);
    let all = terrain.obstacles();
    for (point, expected) in [
        ([1.0, 2.7, 0.5], 0.4),      // next to the post
        ([1.0, 2.0, 1.6], 0.6),      // above it
        ([1.7, 2.0, 1.3], 0.5),      // outside of its rim: 3, 4, 5
        ([1.2, 2.0, 0.5], -0.1),     // in it
        ([-2.0, 1.5, 0.2], 0.5),     // beyond the end of the box, which is turned
        ([-1.45, 1.4, 0.2], 0.5),    // outside of its corner
        ([-2.05, 0.0, 0.7], 0.3),    // above it
        ([-2.05, 0.0, 0.2], -0.2),   // in it, nearest to a side and to the top
        ([4.75, -300.0, 9.0], 0.25), // before the wall
        ([5.5, 7.0, 0.0], -0.5),     // behind it
    ] {
        let found = all.distance(point);
        assert!((found - expected).abs() < 1e-10, "{point:?}: {found}, not {expected}");
    }
    // Gradients are normals: of length 1, and the slope of the distance.
    for prism in all.prisms() {
        for i in 0..200 {
            let angle = TAU * f64::from(i) / 200.0;
            let (x, y) = (prism.center.x + 2.3 * angle.cos(), prism.center.y + 1.7 * angle.sin());
            let at = Vec3 { x, y, z: 0.013 * f64::from(i) };
            let (distance, normal) = prism.distance(at);
            assert!((normal.norm_squared() - 1.0).abs() < 1e-12);
            let moved = Vec3 { x: at.x + 1e-6 * normal.x, y: at.y + 1e-6 * normal.y, z: at.z + 1e-6 * normal.z };
            assert!((prism.distance(moved).0 - distance - 1e-6).abs() < 1e-11, "at {angle} rad");
        }
    }
}

#[test]
fn rays_meet_obstacles_where_their_distance_is_zero() {
    let terrain = Terrain::generate("posts", 3, &[]).unwrap();
    let boxes = level(&[
        obstacle("box", &[("x", 1.0), ("yaw", 0.4), ("height", 0.5)]),
        obstacle("wall", &[("x", 3.0), ("y", 1.0), ("yaw", 2.6)]),
    ]);
    let mut met = 0;
    for all in [terrain.obstacles(), boxes.obstacles()] {
        for i in 0..400 {
            let (angle, rise) = (TAU * f64::from(i) / 400.0, 0.002 * f64::from(i % 11 - 5));
            let (origin, direction) = ([0.1, -0.2, 0.4], [angle.cos(), angle.sin(), rise]);
            let found = all.cast(origin, direction, 6.0);
            // Marching by the distance never passes a surface.
            let (mut share, mut steps) = (0.0, 0);
            let at = |share: f64| [0, 1, 2].map(|k| origin[k] + share * direction[k]);
            while all.distance(at(share)) > 1e-9 && share < 6.0 && steps < 100_000 {
                share += all.distance(at(share)) / (1.0 + rise * rise).sqrt();
                steps += 1;
            }
            match found {
                Some((distance, normal)) => {
                    met += 1;
                    assert!((distance - share).abs() < 1e-5, "ray {i}: {distance}, marched {share}");
                    assert!(normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * rise < 0.0);
                }
                None => assert!(share >= 6.0, "ray {i} marched to {share}"),
            }
        }
    }
    assert!(met > 200, "{met} rays met an obstacle");
}

/// A ball that spins about the vertical hits a wall: the impulse of friction is the smaller of what stops the slip and of
/// the friction of the normal impulse.
#[test]
fn a_ball_leaves_a_wall_as_in_the_closed_form() {
    // A ball that falls slips along z, too.
    let params = Params { gravity: 1e-6, ..Params::paper() };
    let r = params.ball_radius;
    for model in MODELS {
        for (friction, restitution, spin) in
            [(0.0, 0.0, 3.0), (0.0, 0.3, 0.0), (0.0, 0.5, 0.0), (0.1, 0.0, 40.0), (5.0, 0.0, 3.0), (0.2, 0.5, -50.0)]
        {
            // Rapier's friction does not count all of an impact.
            if model == ModelKind::Rigid && friction * spin != 0.0 && friction < 1.0 {
                continue;
            }
            let mut start = flying(&params);
            start.ball_position.x = 0.5 - r - 0.01;
            start.ball_velocity.x = 1.0;
            start.ball_angular_velocity.z = spin;
            let mut robot = robot(&params, model, 1e-3, &wall(0.5, friction, restitution), &start);
            let mut touched = false;
            for _ in 0..40 {
                robot.step([0.0; 3], 1).unwrap();
                touched |= robot.on_obstacle();
                let overlap = robot.state().ball_position.x + r - 0.5;
                assert!(overlap < 1e-3, "{model:?}: the ball is {overlap} m in the wall");
            }
            assert!(touched);
            let pressed = params.ball_mass * (1.0 + restitution);
            let compliance = 1.0 / params.ball_mass + r * r / params.ball_inertia;
            // The surface at the wall moves along y with the spin.
            let tangent = -(r * spin / compliance).clamp(-friction * pressed, friction * pressed);
            let state = robot.state();
            let expected = [-restitution, tangent / params.ball_mass, spin + r * tangent / params.ball_inertia];
            let found = [state.ball_velocity.x, state.ball_velocity.y, state.ball_angular_velocity.z];
            for (found, expected) in found.into_iter().zip(expected) {
                let tolerance = if model == ModelKind::Contact { 1e-9 } else { 3e-3 } * (1.0 + expected.abs());

                assert!(
                    (found - expected).abs() < tolerance,
                    "{model:?}, friction {friction}, restitution {restitution}: {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn a_ball_far_from_its_body_hits_a_post() {
    let params = Params::paper();
    let r = params.ball_radius;
    let terrain = level(&[obstacle("post", &[("x", 2.0), ("radius", 0.1)])]);
    for model in MODELS {
        let mut start = State::upright(&params);
        start.body_position += Vector3::new(-6.0, 0.0, 0.5);
        start.ball_velocity.x = 2.0;
        start.ball_angular_velocity.y = 2.0 / r;
        let mut robot = robot(&params, model, 1e-3, &terrain, &start);
        let (mut farthest, mut touched) = (0.0_f64, false);
        for _ in 0..2000 {
            robot.step([0.0; 3], 1).unwrap();
            farthest = farthest.max(robot.state().ball_position.x);
            touched |= robot.on_obstacle();
        }
        assert!(touched && farthest < 1.9 - r + 2e-3, "{model:?}: {touched}, {farthest} m");
    }
}

/// What obstacles and floor give is the change of the momentum.
#[test]
fn the_force_of_obstacles_is_the_change_of_momentum() {
    let params = Params::paper();
    let terrain = wall(0.3, 0.3, 0.0);
    for model in MODELS {
        let mut start = State::tilted(&params, Vector2::new(0.1, 0.3), 0.4);
        (start.ball_velocity.x, start.body_velocity.x) = (0.5, 0.5);
        start.ball_angular_velocity.y = 0.5 / params.ball_radius;
        let sim_dt = 1e-3;
        let mut robot = robot(&params, model, sim_dt, &terrain, &start);
        let momentum = |robot: &Ballbot| {
            let state = robot.state();
            let rate = state.body_quaternion * state.body_angular_velocity;
            let com = state.body_velocity + rate.cross(&(state.body_quaternion * params.body_com()));
            state.ball_velocity * params.ball_mass + com * params.body_mass
        };
        let (mut touched, mut last) = (0, momentum(&robot));
        for k in 0..600 {
            robot.step([0.02, -0.01, 0.0], 1).unwrap();
            let (now, contacts) = (momentum(&robot), robot.contacts());
            let weight = Vector3::z() * (-params.gravity * (params.body_mass + params.ball_mass));
            let force = contacts.floor_force + contacts.bot_floor_force + contacts.obstacle_force + weight;
            let missing = ((now - last) / sim_dt - force).norm();
            // Rapier's sweeps end before the last digits.
            let tolerance = if model == ModelKind::Contact { 1e-8 } else { 0.02 } * (1.0 + force.norm());
            assert!(missing < tolerance, "{model:?} at step {k}: {missing} N of {force:?}");
            touched += u32::from(contacts.on_obstacle && contacts.obstacle_force.norm() > 1.0);
            last = now;
        }
        assert!(touched > 5, "{model:?}: {touched} steps on the wall");
    }
}

fn tossed(params: &Params, i: usize) -> State {
    let angle = 2.4 * i as f64;
    let tilt = Vector2::new(angle.cos(), angle.sin()) * (0.2 + 0.1 * (i % 7) as f64);
    let mut state = State::tilted(params, tilt, angle);
    let velocity = Vector3::new((1.3 * angle).cos(), (1.3 * angle).sin(), 0.0) * 1.5;
    (state.ball_velocity, state.body_velocity) = (velocity, velocity);
    state
}

/// A box, a post and a corner around the origin, at distances in proportion to `size`.
fn cage(size: f64) -> Arc<Terrain> {
    level(&[
        obstacle("post", &[("x", 0.6 * size), ("y", 0.1), ("radius", 0.15), ("height", 0.35)]),
        obstacle("box", &[("y", -0.6 * size), ("yaw", 0.3), ("height", 0.1), ("width", 0.3)]),
        obstacle("wall", &[("x", -0.5 * size), ("yaw", 0.0)]),
        obstacle("wall", &[("y", 0.5 * size), ("yaw", -FRAC_PI_2), ("restitution", 0.5)]),
    ])
}

#[test]
fn robots_without_torque_gain_no_energy_and_enter_no_obstacle() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let terrain = cage(if *name == "paper" { 1.5 } else { 2.6 });
        let (mut touched, mut deepest) = (0, 0.0_f64);
        for i in 0..24 {
            let mut robot = robot(&params, ModelKind::Contact, 1e-3, &terrain, &tossed(&params, i));
            let (first, mut most) = (robot.energy(), f64::NEG_INFINITY);
            for _ in 0..1500 {
                robot.step([0.0; 3], 1).unwrap();
                most = most.max(robot.energy());
                let state = robot.state();
                deepest = deepest.max(params.ball_radius - terrain.obstacles().distance(state.ball_position.into()));
                touched += u32::from(robot.on_obstacle());
            }
            // Overlaps that are removed raise a robot.
            assert!(most < first + 0.02 * first.abs() + 0.02, "{name} {i}: {first} J, then {most} J");
        }
        assert!(touched > 200 && deepest < 1e-3, "{name}: {touched} steps on obstacles, {deepest} m deep");
    }
}

/// Rooms of which each wall is many boxes, a wall behind boxes on which the robot rolls, and a wall that is listed twice.
#[test]
fn no_obstacle_is_missing_among_many() {
    let params = Params::paper();
    let segment = |x: f64, y: f64, yaw: f64| {
        obstacle("box", &[("x", x), ("y", y), ("yaw", yaw), ("length", 0.2), ("width", 0.1)])
    };
    let along: Vec<_> = (0..10).map(|i| 0.5 - 0.2 * f64::from(i)).collect();
    let room: Vec<_> = along.iter().flat_map(|&at| [segment(0.6, at, FRAC_PI_2), segment(at, 0.6, 0.0)]).collect();
    let low = |length: f64, height: f64| {
        obstacle("box", &[("x", 3.0), ("length", length), ("width", length), ("height", height)])
    };
    let face = |x: f64, y: f64, yaw: f64| obstacle("wall", &[("x", x), ("y", y), ("yaw", yaw)]);
    let scenes = [
        (level(&room), [0.3, 0.3], 0.0),
        (level(&[low(4.0, 0.02), low(3.9, 0.01), face(3.0, 0.0, PI)]), [1.0, 0.0], 2.0),
        (level(&[face(0.5, 0.0, PI), face(0.5, 0.0, PI), face(0.0, 0.5, -FRAC_PI_2)]), [1.0, 1.0], 0.0),
    ];
    for (k, (terrain, [vx, vy], x)) in scenes.into_iter().enumerate() {
        let mut start = State::upright(&params);
        let velocity = Vector3::new(vx, vy, 0.0);
        (start.ball_velocity, start.body_velocity) = (velocity, velocity);
        start.ball_angular_velocity = Vector3::z().cross(&velocity) / params.ball_radius;
        let up = if x > 0.0 { 0.0201 } else { 0.0 };
        start.ball_position += Vector3::new(x, 0.0, up);
        start.body_position += Vector3::new(x, 0.0, up);
        let mut robot = robot(&params, ModelKind::Contact, 1e-3, &terrain, &start);
        let mut touched = 0;
        for _ in 0..2000 {
            robot.step([0.0; 3], 1).unwrap();
            let depth = params.ball_radius - terrain.obstacles().distance(robot.state().ball_position.into());
            assert!(depth < 1e-3, "scene {k}: the ball is {depth} m in an obstacle");
            touched += u32::from(robot.on_obstacle());
        }
        assert!(touched > 20, "scene {k}: {touched}");
    }
}

/// A robot is pushed against a wall and a post: both models bring it to rest at the same place.
#[test]
fn contact_and_rigid_agree_at_a_wall() {
    let params = Params::paper();
    for terrain in
        [wall(0.25, 0.3, 0.0), level(&[obstacle("post", &[("x", 0.35), ("radius", 0.1), ("friction", 0.5)])])]
    {
        let ends = MODELS.map(|model| {
            let mut start = State::upright(&params);
            (start.ball_velocity.x, start.body_velocity.x) = (0.4, 0.4);
            start.ball_angular_velocity.y = 0.4 / params.ball_radius;
            start.wheel_speeds = ballbot_core::kinematics::Omniwheels::new(&params).wheel_speeds(
                &start.body_quaternion,
                &Vector3::zeros(),
                &start.ball_angular_velocity,
            );
            let mut robot = robot(&params, model, 1e-4, &terrain, &start);
            let mut touched = 0;
            for _ in 0..2500 {
                robot.step([0.0; 3], 1).unwrap();
                touched += u32::from(robot.on_obstacle());
            }
            assert!(touched > 0, "{model:?}");
            robot.state()
        });
        let [contact, rigid] = ends;
        let apart = (contact.ball_position - rigid.ball_position).norm();
        let tilted = contact.body_quaternion.angle_to(&rigid.body_quaternion);
        assert!(apart < 5e-4 && tilted < 2e-3, "{apart} m and {tilted} rad apart");
    }
}

#[test]
fn a_level_floor_with_far_obstacles_is_a_level_floor_bit_for_bit() {
    let params = Params::paper();
    let far = level(&[obstacle("wall", &[("x", 4.0), ("yaw", PI)]), obstacle("post", &[("y", -3.0)])]);
    for i in 0..8 {
        let start = tossed(&params, i);
        let mut with = robot(&params, ModelKind::Contact, 1e-3, &far, &start);
        let mut without = Ballbot::new(&params, ModelKind::Contact, 1e-3).unwrap();
        without.reset(&start).unwrap();
        for k in 0..1000 {
            for robot in [&mut with, &mut without] {
                robot.step([0.1, -0.05, 0.0], 1).unwrap();
            }
            assert_eq!(with.state(), without.state(), "step {k}");
            let [a, b] = [&with, &without].map(|robot| robot.contacts());
            assert_eq!(a.wheel_normal_forces, b.wheel_normal_forces, "step {k}");
            assert_eq!([a.floor_force, a.bot_floor_force], [b.floor_force, b.bot_floor_force], "step {k}");
        }
    }
}

/// Actions that tip robots over, in sixteenths.
fn action(i: usize, k: usize) -> [f32; 3] {
    [0, 1, 2].map(|wheel| ((i * 7 + wheel * 2 + k / 3) % 5) as f32 * 0.5 - 1.0)
}

#[test]
fn a_robot_in_lanes_equals_a_single_robot_bit_for_bit() {
    let hills = Terrain::generate("noise", 3, &[("slope", 0.15), ("wavelength", 0.8)]).unwrap();
    let on_hills = Arc::new(hills.with_obstacles(cage(1.0).obstacles().shapes()).unwrap());
    let payload = Params::paper().with_payload(0, 0.5, [0.05, 0.0, 0.3]);
    for (name, terrain) in [("level", cage(1.0)), ("hills", on_hills)] {
        let robots: Vec<_> = (0..10)
            .map(|i| match i {
                3 => Params { wheel_preload: 5.0, ..Params::paper() },
                5 => Params { floor_acceleration: [1.0, -2.0], floor_acceleration_period: 0.7, ..Params::paper() },
                6 => Params { payload_stiffness: [30.0; 3], payload_damping: [0.5; 3], ..payload },
                _ => Params::paper(),
            })
            .collect();
        let mut config = task_kind("bare").unwrap().config();
        config.set_model(ModelKind::Contact);
        config.set_terrain(Some(Arc::clone(&terrain)));
        config.set("max_wheel_torque", &[0.5]).unwrap();
        let mut batch = config.batch(robots.len(), Autoreset::SameStep, Some(2), 5).unwrap();
        robots.iter().enumerate().for_each(|(i, params)| batch.set_params(i, params).unwrap());
        let mut many = Run::new(batch);
        let mut alone = Vec::new();
        let mut starts = Vec::new();
        for (i, params) in robots.iter().enumerate() {
            let mut robot = Ballbot::new(params, ModelKind::Contact, 0.002).unwrap();
            robot.set_terrain(Some(&terrain)).unwrap();
            let mut start = robot.state();
            let velocity = tossed(params, i).ball_velocity * 0.4;
            (start.ball_velocity, start.body_velocity) = (velocity, velocity);
            robot.reset(&start).unwrap();
            starts.push(Some(start));
            alone.push(robot);
        }
        let request = ResetRequest { starts: Some(&starts), ..Default::default() };
        many.batch.reset_with(&request, &mut many.observations).unwrap();
        let (mut over, mut compared, mut touched) = (vec![false; robots.len()], 0, 0);
        for k in 0..200 {
            let actions: Vec<_> = (0..robots.len()).flat_map(|i| action(i, k)).collect();
            many.step(&actions).unwrap();
            for (i, robot) in alone.iter_mut().enumerate() {
                over[i] |= many.terminated[i] || many.truncated[i];
                if over[i] {
                    continue;
                }
                robot.step(action(i, k).map(|a| f64::from(a) * 0.5), 5).unwrap();
                assert_eq!(robot.state(), many.batch.state(i).unwrap(), "{name}: robot {i} at step {k}");
                assert_eq!(robot.contacts(), many.batch.contacts(i).unwrap(), "{name}: robot {i} at step {k}");
                compared += 1;
                touched += u32::from(robot.on_obstacle());
            }
        }
        println!("{name}: {compared} steps, {touched} on obstacles");
        assert!(compared > 200 && touched > 20, "{name}: {compared} steps, {touched} on obstacles");
    }
}

#[test]
fn what_no_model_or_terrain_can_have_is_named() {
    let params = Params::paper();
    let terrain = wall(0.3, 0.3, 0.0);
    for model in [ModelKind::Spatial, ModelKind::Planar] {
        let mut robot = Ballbot::new(&params, model, 1e-3).unwrap();
        let error = robot.set_terrain(Some(&terrain)).unwrap_err().to_string();
        assert!(error.contains("obstacles") || error.contains("level ground"), "{error}");
    }
    for model in MODELS {
        let mut robot = Ballbot::new(&params, model, 1e-3).unwrap();
        robot.set_terrain(Some(&terrain)).unwrap();
        let mut inside = State::upright(&params);
        (inside.ball_position.x, inside.body_position.x) = (0.25, 0.25);
        let error = robot.reset(&inside).unwrap_err().to_string();
        assert!(error.contains("distance of the ball from the nearest obstacle"), "{error}");
    }
    assert!(matches!(Obstacle::named("tree", &[]), Err(Error::UnknownName { .. })));
    assert!(matches!(Obstacle::named("post", &[("depth", 1.0)]), Err(Error::UnknownName { .. })));
    for (kind, name, value) in [("post", "radius", 0.0), ("wall", "friction", -0.1), ("box", "restitution", 0.6)] {
        let bad = obstacle(kind, &[(name, value)]);
        let error = Terrain::plane(0.0, 0.0).unwrap().with_obstacles(&[bad]).unwrap_err().to_string();
        assert!(error.contains("obstacles[0]") && error.contains(name), "{error}");
    }
}

#[test]
fn posts_keep_their_gaps_and_the_middles_of_tiles() {
    assert!(TerrainKind::ALL.iter().any(|kind| kind.name == "posts"));
    let terrain = Terrain::generate("posts", 7, &[("density", 0.4), ("gap", 0.7), ("tile", 6.0)]).unwrap();
    let posts: Vec<_> = terrain.obstacles().prisms().iter().map(|p| [p.center.x, p.center.y, p.radius]).collect();
    let tiles = terrain.tiles().unwrap();
    let mut in_level = vec![0; tiles.levels];
    for (i, a) in posts.iter().enumerate() {
        let [column, level] = tiles.nearest(a[0], a[1]);
        in_level[level] += 1;
        let [x, y] = tiles.center(column, level);
        assert!((a[0] - x).hypot(a[1] - y) - a[2] >= 0.8 - 1e-12);
        for b in &posts[..i] {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) - a[2] - b[2] >= 0.7 - 1e-12);
        }
    }
    assert!(in_level.windows(2).all(|pair| pair[0] < pair[1]), "{in_level:?}");
    assert_eq!(terrain, Terrain::generate("posts", 7, &[("density", 0.4), ("gap", 0.7), ("tile", 6.0)]).unwrap());
    assert_ne!(terrain.fingerprint(), Terrain::generate("posts", 8, &[]).unwrap().fingerprint());
}
