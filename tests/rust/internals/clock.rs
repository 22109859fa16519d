//! Samples are taken and read at the control steps given by their rate and latency.

use ballbot_stages::perception::clock::Clock;

#[test]
fn samples_are_read_in_order_at_their_age() {
    for (period, latency) in [(1_u32, 0_u32), (1, 3), (4, 0), (4, 1), (4, 4), (4, 11), (7, 3)] {
        let clock = Clock::new(100.0 / f64::from(period), f64::from(latency) * 0.01, 0.01).unwrap();
        let mut kept = vec![0; clock.slots()];
        let mut last = 0;
        for step in 0..200 {
            if let Some(sample) = clock.taken(step) {
                kept[clock.slot(sample)] = sample;
            }
            if let Some(sample) = clock.read(step) {
                assert_eq!(sample, last + 1);
                assert_eq!(kept[clock.slot(sample)], sample, "it was overwritten");
                assert_eq!(step, sample * u64::from(period) + u64::from(latency));
                last = sample;
            }
        }
        assert!(last >= 26);
    }
}

#[test]
fn latencies_between_steps_are_rejected() {
    let error = Clock::new(25.0, 0.015, 0.01).unwrap_err().to_string();
    assert!(error.contains("latency / control_dt = 1.5"), "{error}");
    assert!(Clock::new(25.0, 1.01, 0.01).is_err());
}
