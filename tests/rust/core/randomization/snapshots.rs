//! Environments with events, saved and restored.

use super::{SEED, config, several, started};
use crate::run::actions;
use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, Event};

const N: usize = 9;

#[test]
fn restored_environments_continue_bit_for_bit() {
    for model in ModelKind::ALL {
        let config = config(model, 12, &several());
        for saved_at in [0, 4, 9, 12] {
            let mut original = started(&config, N, Autoreset::SameStep, SEED);
            for k in 0..saved_at {
                original.step(&actions(0, N, k, 0.3)).unwrap();
            }
            // Into environments with other seeds, robots and timers, in another order.
            let mut restored = started(&config, N, Autoreset::SameStep, 5);
            restored.step(&actions(0, N, 0, 0.3)).unwrap();
            for (i, snapshot) in original.snapshots().iter().enumerate() {
                restored.batch.load(i, snapshot).unwrap();
                assert_eq!(restored.batch.params(i).unwrap(), original.batch.params(i).unwrap());
            }
            for k in saved_at..saved_at + 30 {
                original.step(&actions(0, N, k, 0.3)).unwrap();
                restored.step(&actions(0, N, k, 0.3)).unwrap();
                // The last observation of an episode is not part of a snapshot.
                restored.last.copy_from_slice(&original.last);
                assert!(original.all_bits() == restored.all_bits(), "{model}, saved at {saved_at}, step {k}");
                assert_eq!(original.snapshots(), restored.snapshots());
            }
        }
    }
}

#[test]
fn a_snapshot_of_other_events_is_rejected_and_changes_nothing() {
    let with = |events: &[Event]| started(&config(ModelKind::Contact, 12, events), 1, Autoreset::SameStep, SEED);
    let original = with(&several());
    let snapshot = original.snapshots().remove(0);
    let mut wider = several();
    wider[0].range = vec![[0.8, 1.3]];
    for events in [&several()[1..], &wider, &[]] {
        let mut other = with(events);
        let before = (other.all_bits(), other.snapshots());
        let error = other.batch.load(0, &snapshot).unwrap_err().to_string();
        // Without events on motors these keep other numbers.
        assert!(error.contains("events") || error.contains("stages keep other numbers"), "{error}");
        assert!(before == (other.all_bits(), other.snapshots()));
    }
    let mut without = with(&[]);
    let bare = without.snapshots().remove(0);
    assert!(with(&several()).batch.load(0, &bare).is_err());
    without.batch.load(0, &bare).unwrap();
}
