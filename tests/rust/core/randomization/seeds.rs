//! A seed within an episode.

use super::{SEED, config, every, scaled, started};
use crate::run::{Run, actions};
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, BalanceConfig, Event};
use ballbot_core::sensor::SensorOptions;

const N: usize = 9;

/// Results of a step, including samples and readings.
fn shown(run: &Run) -> Vec<Vec<u64>> {
    let mut all = run.all_bits();
    for (i, row) in all.iter_mut().enumerate() {
        row.extend(run.batch.draws(i).unwrap().iter().map(|v| v.to_bits()));
        let read = run.batch.readings(i).unwrap();
        row.extend([read.gyro.x, read.specific_force.z].map(f64::to_bits));
    }
    all
}

fn step(run: &mut Run, k: usize) {
    run.step(&actions(0, N, k, 0.1)).unwrap();
    run.last.fill(0.0);
}

/// The running episode keeps its random numbers; the next one begins with the seed, in a copy from a snapshot as well.
#[test]
fn a_seed_waits_for_the_next_episode() {
    let events = [
        scaled("body_mass", [0.9, 1.1]),
        every([0.02, 0.05], Event::new("push", [0.0, 0.2])),
        // `spatial` has no slip.
        Event { optional: true, ..every([0.02, 0.05], scaled("wheel_dynamic_friction", [0.5, 1.0])) },
    ];
    let noisy = SensorOptions { gyro_noise: 0.01, accelerometer_bias: 0.1, ..SensorOptions::default() };
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        let config = BalanceConfig { sensors: Some(noisy.clone()), ..config(model, 30, &events) };
        let new = |seed| started(&config, N, Autoreset::SameStep, seed);
        let (mut seeded, mut plain, mut copy) = (new(SEED), new(SEED), new(SEED + 100));
        for k in 0..10 {
            [&mut seeded, &mut plain].into_iter().for_each(|run| step(run, k));
        }
        seeded.batch.seed(&(0..N as u64).map(|i| Some(3 + i)).collect::<Vec<_>>()).unwrap();
        for (i, bytes) in seeded.snapshots().iter().enumerate() {
            copy.batch.load(i, bytes).unwrap();
        }
        for k in 10..29 {
            [&mut seeded, &mut plain, &mut copy].into_iter().for_each(|run| step(run, k));
            assert!(shown(&seeded) == shown(&plain), "{model}: step {k} depends on the seed of the next episode");
            assert!(shown(&seeded) == shown(&copy), "{model}: step {k} of a copy");
        }
        let mut fresh = new(3);
        // This step ends the episodes.
        [&mut seeded, &mut plain, &mut copy].into_iter().for_each(|run| step(run, 29));
        for k in 0..20 {
            if k > 0 {
                [&mut seeded, &mut plain, &mut copy, &mut fresh].into_iter().for_each(|run| step(run, k));
                assert!(shown(&seeded) == shown(&fresh), "{model}: step {k} of the new episode");
                assert!(shown(&seeded) == shown(&copy), "{model}: step {k} of the new episode of a copy");
            }
            assert_eq!(seeded.observations, fresh.observations, "{model}: step {k} of the new episode");
            assert_ne!(seeded.observations, plain.observations, "{model}: step {k} of the new episode");
        }
    }
}
