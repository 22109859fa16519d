//! The terrain task and its levels, and the task of OpenBallBot-RL.

use super::{config, regulate, run_of};
use ballbot_core::Params;
use ballbot_core::batch::{Autoreset, Levels, TaskConfig, task_kind};
use ballbot_core::terrain::Terrain;
use std::sync::Arc;

#[test]
fn every_preset_robot_has_terrain_up_to_its_limit() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let limit = params.slope_limits(30.0_f64.to_radians()).unwrap().smallest();
        for task in ["terrain", "openballbot"] {
            let mut config = task_kind(task).unwrap().config();
            config.set_params(params.clone());
            let run = run_of(&*config, 1);
            let terrain = run.batch.terrain().unwrap();
            assert!(terrain.tiles().is_some(), "{name}");
            if task == "terrain" {
                let recipe = terrain.recipe().unwrap();
                let slope = recipe.parameters.iter().find(|(name, _)| *name == "slope").unwrap().1;
                assert!((slope - 0.7 * limit).abs() < 1e-12, "{name}: {slope}");
            }
        }
    }
}

#[test]
fn episodes_begin_on_level_ground_of_their_level_and_end_at_the_edge_of_the_tile() {
    let mut config = config("terrain", &[]);
    config.set_levels(Levels::One(3));
    config.set("fall_tilt", &[1.5]).unwrap();
    let run = run_of(&*config, 64);
    let tiles = *run.batch.terrain().unwrap().tiles().unwrap();
    let mut columns = [0; 4];
    for i in 0..64 {
        let ball = run.batch.state(i).unwrap().ball_position;
        let [column, level] = tiles.nearest(ball.x, ball.y);
        assert_eq!((level, run.batch.level(i).unwrap()), (3, 3));
        assert_eq!([ball.x, ball.y], tiles.center(column, level));
        assert!((ball.z - Params::paper().ball_radius).abs() < 1e-9, "{}", ball.z);
        columns[column] += 1;
    }
    assert!(columns.iter().all(|count| *count > 5), "{columns:?}");
}

#[test]
fn episodes_end_at_the_edge_of_the_tile_although_the_terrain_continues() {
    let plane = [("slope", 0.0), ("levels", 1.0), ("tile", 6.0)];
    let terrain = Arc::new(Terrain::generate("levels", 0, &plane).unwrap());
    let mut config = config("terrain", &[("speed_range", &[0.5, 0.5]), ("max_episode_steps", &[2000.0])]);
    config.set_terrain(Some(Arc::clone(&terrain)));
    let mut run = run_of(&*config, 8);
    let tiles = terrain.tiles().unwrap();
    let mut last = (0..8).map(|i| run.batch.state(i).unwrap().ball_position).collect::<Vec<_>>();
    let mut truncated = 0;
    regulate(&mut run, 1100, |k, run| {
        for (i, last) in last.iter_mut().enumerate() {
            let [column, level] = tiles.nearest(last.x, last.y);
            let [x, y] = tiles.center(column, level);
            let edge = 3.0 - (last.x - x).abs().max((last.y - y).abs());
            assert_eq!(run.truncated[i], run.outcomes[i].done(), "none falls");
            if run.truncated[i] {
                assert!(k > 550 && edge < 0.006, "{k}, {edge}");
                truncated += 1;
            } else {
                assert!(edge >= 0.0);
            }
            *last = run.batch.state(i).unwrap().ball_position;
        }
    });
    assert!(truncated >= 8, "{truncated}");
}

#[test]
fn a_curriculum_rises_with_what_is_done_and_is_in_snapshots() {
    let mut config = config("terrain", &[]);
    config.set_levels(Levels::Curriculum);
    config.set("max_episode_steps", &[800.0]).unwrap();
    let mut run = run_of(&*config, 16);
    assert!((0..16).all(|i| run.batch.level(i).unwrap() == 0));
    regulate(&mut run, 801, |_, _| ());
    let risen = (0..16).filter(|i| run.batch.level(*i).unwrap() == 1).count();
    assert!(risen >= 12, "{risen}");
    // Robots that are not driven fall, and go back.
    let saved = run.snapshots();
    for _ in 0..300 {
        run.step(&[0.0; 48]).unwrap();
    }
    assert!((0..16).all(|i| run.batch.level(i).unwrap() == 0));
    for (i, bytes) in saved.iter().enumerate() {
        run.batch.load(i, bytes).unwrap();
    }
    assert_eq!((0..16).filter(|i| run.batch.level(*i).unwrap() == 1).count(), risen);
}

#[test]
fn wrong_levels_and_tasks_with_a_position_are_rejected() {
    let error =
        |config: &dyn TaskConfig| config.batch(1, Autoreset::SameStep, None, 0).map(|_| ()).unwrap_err().to_string();
    let mut terrain = config("terrain", &[]);
    terrain.set_levels(Levels::One(5));
    assert!(error(&*terrain).contains("level = 5, but the terrain has levels from 0 to 4"));
    let mut velocity = config("velocity", &[]);
    velocity.set_levels(Levels::Curriculum);
    assert!(error(&*velocity).contains("the terrain has none"));
    let tiles = Arc::new(Terrain::generate("levels", 0, &[("levels", 2.0)]).unwrap());
    velocity.set_terrain(Some(Arc::clone(&tiles)));
    assert!(velocity.batch(1, Autoreset::SameStep, None, 0).is_ok());
    let mut balance = config("balance", &[]);
    balance.set_terrain(Some(tiles));
    assert!(error(&*balance).contains("the task 'balance' has its place at the origin"));
}

#[test]
fn the_return_of_the_published_task_does_not_depend_on_the_control_rate() {
    // A robot that stays upright for 8 s: 0.02 for each 2 ms is 80.
    let plane = Arc::new(Terrain::plane(0.0, 0.0).unwrap());
    for (dt, steps) in [(0.002, 4000_usize), (0.01, 800)] {
        let mut config = config("openballbot", &[]);
        config.set_terrain(Some(Arc::clone(&plane)));
        config.set("control_dt", &[dt]).unwrap();
        config.set("max_episode_steps", &[steps as f64]).unwrap();
        config.set("speed", &[0.0]).unwrap();
        let mut run = run_of(&*config, 1);
        let mut sum = 0.0;
        regulate(&mut run, steps, |_, run| {
            assert!(!run.terminated[0]);
            sum += run.rewards[0];
        });
        assert!(run.truncated[0] && (sum - 80.0).abs() < 0.5, "{sum}");
    }
}
