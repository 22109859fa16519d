//! Scenes of the page in the browser, natively.

use ballbot_core::batch::{History, Layer, policy_controller};
use ballbot_core::control::{Setpoint, controller_kind};
use ballbot_core::{Ballbot, ModelKind, Params};
use ballbot_web::{ROW, Scene, catalog, row_width};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

fn part<'a>(scene: &'a Scene, robot: usize, name: &str) -> &'a [f64] {
    let before: usize = ROW.iter().take_while(|(part, _)| *part != name).map(|(_, len)| len).sum();
    let (_, len) = ROW.iter().find(|(part, _)| *part == name).expect("a part of a row");
    &scene.rows()[robot * row_width() + before..][..*len]
}

#[test]
fn a_scene_is_the_closed_loop_of_robot_and_controller_to_the_bit() {
    let mut scene = Scene::new("robot = 'kugle'\ncontroller = 'lqr'\ntilt = 0.05").unwrap();
    // In pieces that end between two calls of the controller.
    (0..300).for_each(|_| scene.advance(7));

    let params = Params::preset("kugle").unwrap();
    let kind = controller_kind("lqr").unwrap();
    let mut lqr = (kind.make)(&params, 0.01, &kind.limits, &[]).unwrap();
    let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.001).unwrap();
    robot.place_on_ground(0.0, 0.0, 0.0, Some([0.05, 0.0].into())).unwrap();
    for _ in 0..210 {
        robot.step(lqr.wheel_torques(&robot.state(), &Setpoint::default()), 10).unwrap();
    }
    assert_eq!(part(&scene, 0, "ball_position"), robot.state().ball_position.as_slice());
    assert_eq!(part(&scene, 0, "wheel_angles"), robot.state().wheel_angles.0);
    assert!((scene.time() - 2.1).abs() < 1e-12);
}

#[test]
fn a_recurrent_policy_is_the_controller_of_its_cells_and_layers_to_the_bit() {
    // A cell of two units has eight gates of the rows and of its last outputs.
    let (rows, units, params) = (16, 2, Params::paper());
    let count = 4 * units * (rows + units + 1);
    let numbers: Vec<f64> = (0..count + 3 * (units + 1)).map(|i| ((i * i) as f64).sin()).collect();
    let text = numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let policy = format!("[policy]\nwidths = [{rows}, {units}, 3]\ncells = 1\ncontrol_dt = 0.01\nnumbers = [{text}]");
    let mut scene = Scene::new(&format!("tilt = 0.05\n{policy}")).unwrap();
    scene.advance(100);

    let layer = |inputs, outputs, numbers| {
        let (weights, biases) = <[f64]>::split_at(numbers, inputs * outputs);
        Layer { inputs, outputs, weights, biases }
    };
    let (cell, last) = numbers.split_at(count);
    let (cells, layers) = ([layer(rows + units, 4 * units, cell)], [layer(units, 3, last)]);
    let options = [("control_dt", &[0.01][..])];
    let mut law = policy_controller("balance", &params, &options, &History::default(), &cells, &layers).unwrap();
    let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.001).unwrap();
    robot.place_on_ground(0.0, 0.0, 0.0, Some([0.05, 0.0].into())).unwrap();
    for _ in 0..10 {
        robot.step(law.wheel_torques(&robot.state(), &Setpoint::default()), 10).unwrap();
    }
    assert_eq!(part(&scene, 0, "wheel_angles"), robot.state().wheel_angles.0);
    assert!(robot.state().wheel_speeds.column().amax() > 0.1);
}

#[test]
fn robots_go_where_they_are_sent_and_all_at_once() {
    for robot in Params::preset_names() {
        let mut scene = Scene::new(&format!("robot = '{robot}'\nrobots = 4")).unwrap();
        let places: Vec<_> = (0..4).map(|i| part(&scene, i, "ball_position").to_vec()).collect();
        scene.go_to([1.0, -0.5]).unwrap();
        scene.advance(20_000);
        for (i, place) in places.iter().enumerate() {
            let now = part(&scene, i, "ball_position");
            let error = (now[0] - place[0] - 1.0).hypot(now[1] - place[1] + 0.5);
            // Dry friction of wheel joints keeps asroballet away from its place.
            assert!(error < 0.15, "{robot} {i}: {error} m");
            assert_eq!(part(&scene, i, "fallen"), [0.0]);
        }
    }
}

#[test]
fn a_robot_that_yields_is_pulled_along_and_goes_where_it_is_sent() {
    for model in ["contact", "spatial"] {
        let mut scene = Scene::new(&format!("controller = 'admittance'\nmodel = '{model}'")).unwrap();
        scene.pull(0, [1.5, 0.0, 0.0]).unwrap();
        scene.advance(4000);
        assert!(part(&scene, 0, "ball_velocity")[0] > 0.25, "{model}");
        scene.pull(0, [0.0; 3]).unwrap();
        scene.advance(8000);
        let led = part(&scene, 0, "ball_position").to_vec();
        assert!(led[0] > 0.8 && part(&scene, 0, "ball_velocity")[0].abs() < 2e-3, "{model}: {led:?}");
        scene.go_to([0.3, 0.2]).unwrap();
        scene.advance(15_000);
        let at = part(&scene, 0, "ball_position");
        assert!((at[0] - 0.3).hypot(at[1] - 0.2) < 0.03, "{model}: {at:?}");
    }
}

#[test]
fn a_robot_that_has_yielded_keeps_its_heading() {
    let heading = |scene: &Scene| {
        let forward =
            |q: &[f64]| UnitQuaternion::from_quaternion(Quaternion::from_parts(q[0], [q[1], q[2], q[3]].into()));
        let x = forward(part(scene, 0, "body_quaternion")) * Vector3::x();
        x.y.atan2(x.x)
    };
    let mut scene = Scene::new("controller = 'admittance'").unwrap();
    scene.drive([0.0, 0.0, 1.0]).unwrap();
    scene.advance(2000);
    scene.drive([0.0; 3]).unwrap();
    scene.advance(2000);
    let turned = heading(&scene);
    assert!(turned.abs() > 0.5, "{turned}");
    scene.pull(0, [1.5, 0.0, 0.0]).unwrap();
    scene.advance(4000);
    scene.pull(0, [0.0; 3]).unwrap();
    scene.advance(8000);
    scene.go_to([0.3, 0.2]).unwrap();
    scene.advance(10_000);
    assert!((heading(&scene) - turned).abs() < 0.05, "{} after {turned}", heading(&scene));
}

#[test]
fn robots_follow_a_circle_and_an_eight_and_stop_where_they_are_sent() {
    for robot in Params::preset_names() {
        for curve in ["circle", "eight"] {
            let mut scene = Scene::new(&format!("robot = '{robot}'\ncontroller = 'lqr_pi'")).unwrap();
            // From a motion, which ends first.
            scene.drive([1.0, 0.0, 0.5]).unwrap();
            scene.advance(1500);
            scene.follow(curve).unwrap();
            let (mut worst, mut least, mut most) = (0.0_f64, [f64::INFINITY; 2], [-f64::INFINITY; 2]);
            for step in 0..600 {
                scene.advance(50);
                let (ball, goal) = (part(&scene, 0, "ball_position"), part(&scene, 0, "setpoint"));
                if step > 200 {
                    for axis in 0..2 {
                        least[axis] = least[axis].min(ball[axis]);
                        most[axis] = most[axis].max(ball[axis]);
                    }
                    worst = worst.max((ball[0] - goal[0]).hypot(ball[1] - goal[1]));
                }
            }
            assert!((0..2).all(|axis| most[axis] - least[axis] > 0.4), "{robot} {curve}: {least:?} {most:?}");
            assert!(worst < 0.06, "{robot} {curve}: {worst} m");
            let begin = part(&scene, 0, "setpoint").to_vec();
            scene.go_to([begin[0], begin[1]]).unwrap();
            scene.advance(10_000);
            assert!(part(&scene, 0, "ball_velocity")[0].abs() < 0.02, "{robot} {curve}");
            assert_eq!(part(&scene, 0, "fallen"), [0.0]);
        }
    }
    let mut scene = Scene::new("").unwrap();
    assert!(scene.follow("square").unwrap_err().to_string().contains("circle, eight"));
    let mut scene = Scene::new("[terrain]\nkind = 'bumps'\nslope = 0.05\nsize_x = 4\nsize_y = 4").unwrap();
    assert!(scene.follow("circle").unwrap_err().to_string().contains("leave the ground"));
}

#[test]
fn nobody_is_sent_over_the_edge_of_the_ground() {
    let settings = "robots = 4\n[terrain]\nkind = 'bumps'\nslope = 0.05";
    let mut scene = Scene::new(settings).unwrap();
    for place in [[100.0, 0.0], [100.0, -100.0]] {
        for _ in 0..6 {
            scene.go_to(place).unwrap();
            scene.advance(4000);
        }
        let at = part(&scene, 0, "ball_position");
        assert!(at[0] > 1.0 && at[0].abs() < 4.0 && at[1].abs() < 4.0, "{at:?}");
    }
    // On level ground there is no edge, and a goal is at most 5 m away.
    let mut scene = Scene::new("").unwrap();
    for _ in 0..2 {
        scene.go_to([100.0, 0.0]).unwrap();
        scene.advance(20_000);
    }
    let at = part(&scene, 0, "ball_position")[0];
    assert!((9.0..10.1).contains(&at), "{at}");
}

#[test]
fn a_controller_that_follows_no_motion_names_it() {
    let mut scene = Scene::new("controller = 'pid'").unwrap();
    for error in [scene.go_to([1.0, 0.0]), scene.drive([1.0, 0.0, 0.0]), scene.follow("circle")] {
        assert!(error.unwrap_err().to_string().contains("holds the tilt"));
    }
    let numbers = vec!["0.01"; 3 * 21].join(",");
    let mut scene =
        Scene::new(&format!("[policy]\ntask = 'velocity'\nwidths = [20, 3]\nnumbers = [{numbers}]")).unwrap();
    scene.drive([1.0, 0.0, 0.0]).unwrap();
    assert!(scene.go_to([1.0, 0.0]).unwrap_err().to_string().contains("drive it"));
}

#[test]
fn no_drive_however_wild_topples_a_robot() {
    for robot in Params::preset_names() {
        let mut scene = Scene::new(&format!("robot = '{robot}'")).unwrap();
        for i in 0..40 {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            scene.drive([sign, if i % 3 == 0 { 1.0 } else { -1.0 }, -sign]).unwrap();
            scene.advance(700);
            assert_eq!(part(&scene, 0, "fallen"), [0.0], "{robot} after {} s", scene.time());
        }
    }
}

#[test]
fn a_fallen_robot_lies_and_begins_again() {
    let mut scene = Scene::new("robots = 2").unwrap();
    scene.push(1, [20.0, 0.0, 0.0]).unwrap();
    scene.advance(1000);
    assert_eq!([part(&scene, 0, "fallen"), part(&scene, 1, "fallen")], [[0.0], [1.0]]);
    scene.advance(4000);
    assert_eq!(part(&scene, 1, "fallen"), [0.0]);
    assert!(part(&scene, 1, "tilt")[0] < 0.02);
}

#[test]
fn what_does_not_fit_is_an_error_and_changes_nothing() {
    for (settings, words) in [
        ("robot = 'nobody'", "nobody"),
        ("model = 'rigid'\nrobots = 0", "1 to 1000"),
        ("tilt = 2", "within ±1 rad"),
        ("tilt = [", "the settings"),
        ("[params]\nbody_mass = -1", "body_mass"),
        ("[options]\ntorque = 'much'", "torque"),
        ("[terrain]\nkind = 'bumps'\nslope = 9", "slope"),
        ("[terrain]\nkind = 'bumps'\nslope = [0.1, 9]", "slope"),
        ("[terrain]\nslope = 0.1", "level ground"),
        ("speed = 1", "unknown setting"),
        ("policy = 'balance'", "a table"),
        ("[policy]\nwidths = [16, 3]", "no numbers"),
        ("[policy]\nwidths = [16, 3]\nnumbers = [1]", "51"),
        ("[policy]\nwidths = [16, -3]\nnumbers = [1]", "widths = -3"),
        ("[policy]\nwidths = [16.7, 3]\nnumbers = [1]", "whole number"),
        ("[policy]\nwidths = [1e30, 3]\nnumbers = [1]", "10000"),
        ("[policy]\nwidths = [0, 3]\nnumbers = [1, 1, 1]", "from 1"),
        (
            "[policy]\nwidths = [16, 3]\ncells = 2\nnumbers = [1]",
            "cells of the policy: expected a whole number up to 1",
        ),
        ("[policy]\nwidths = [16, 3]\ncells = 0.5\nnumbers = [1]", "cells of the policy"),
        ("[policy]\nwidths = [16, 3]\ncells = 1\nnumbers = [1]", "240"),
        ("controller = 'lqr'\n[policy]", "in place of a controller"),
    ] {
        let error = Scene::new(settings).err().expect(settings).to_string();
        assert!(error.contains(words), "{settings}: {error}");
    }
    let mut scene = Scene::new("").unwrap();
    let before = scene.rows().to_vec();
    assert!(scene.push(1, [0.0; 3]).is_err());
    assert!(scene.push(0, [f64::NAN, 0.0, 0.0]).is_err());
    assert!(scene.pull(0, [0.0, f64::INFINITY, 0.0]).is_err());
    assert!(scene.drive([2.0, 0.0, 0.0]).is_err());
    assert!(scene.go_to([f64::NAN, 0.0]).is_err());
    assert!(scene.set_params("body_mass = 'x'").is_err());
    assert_eq!(scene.rows(), before);
}

#[test]
fn the_catalog_has_every_preset_and_the_width_of_a_row() {
    let catalog = catalog().unwrap();
    let of = |kind: &str| catalog.lines().filter(|line| line.split('\t').next() == Some(kind)).count();
    assert_eq!(of("robot"), Params::preset_names().len());
    assert_eq!(of("row"), ROW.len());
    assert!(of("controller") >= 11);
    assert!(catalog.lines().all(|line| line.split('\t').count() >= 2));
}

/// Rows of x, y, top, angle, length, width and radius; posts have only a radius.
#[test]
fn posts_are_rows_for_the_page_and_robots_keep_out_of_them() {
    assert!(Scene::new("").unwrap().obstacles().is_empty());
    let mut scene = Scene::new("robots = 1\n[terrain]\nkind = 'posts'\nheight = 0.5").unwrap();
    let posts: Vec<_> = scene.obstacles().chunks(7).map(<[f64]>::to_vec).collect();
    assert!(posts.len() > 50 && posts.iter().all(|post| post.len() == 7));
    for post in &posts {
        assert!((post[2] - 0.5).abs() < 1e-9 && post[4..6] == [0.0; 2] && post[6] > 0.05, "{post:?}");
    }
    scene.advance(500);
    let ball = part(&scene, 0, "ball_position");
    let nearest = posts.iter().map(|post| (post[0] - ball[0]).hypot(post[1] - ball[1]) - post[6]);
    assert!(nearest.fold(f64::INFINITY, f64::min) > 0.11);
}
