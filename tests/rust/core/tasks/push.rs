//! The push task.

use super::{config, metrics, regulate, run_of};
use ballbot_core::Params;
use ballbot_core::models::capture_impulse;

#[test]
fn capture_impulses_of_the_presets() {
    for (name, expected) in [("paper", 2.41), ("kugle", 41.5), ("asroballet", 19.0), ("rezero", 32.6)] {
        let found = capture_impulse(&Params::preset(name).unwrap());
        assert!((found / expected - 1.0).abs() < 0.01, "{name}: {found} N·s, {expected} N·s");
    }
}

#[test]
fn harder_pushes_are_survived_less_often() {
    let survived = [[0.0, 0.2], [0.4, 0.5], [1.5, 2.0]].map(|push| {
        let mut run = run_of(&*config("push", &[("push", &push), ("push_seconds", &[3.0, 3.0])]), 16);
        let mut survived = [true; 16];
        let mut pushed = 0;
        regulate(&mut run, 1000, |k, run| {
            pushed += usize::from(
                k == 301 && (0..16).any(|i| run.batch.state(i).unwrap().body_angular_velocity.norm() > 0.01),
            );
            survived.iter_mut().zip(&run.outcomes).for_each(|(all, now)| *all &= now.terminated.is_none());
        });
        assert_eq!(pushed, 1);
        assert!((0..16).all(|i| metrics(&run, i)[0] > 0.0));
        survived.iter().filter(|survived| **survived).count()
    });
    assert!(survived[0] == 16 && survived[1] >= 15 && survived[2] < 4, "{survived:?}");
}
