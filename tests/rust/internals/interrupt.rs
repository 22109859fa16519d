//! Work ends when its caller stops it, and only then.

use ballbot_base::interrupt::Watch;
use ballbot_core::{Error, Result, stoppable};
use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

fn work_for(seconds: f64) -> Result<u32> {
    let (start, mut watch, mut turns) = (Instant::now(), Watch::new(), 0);
    while start.elapsed().as_secs_f64() < seconds {
        watch.check()?;
        std::thread::sleep(Duration::from_millis(1));
        turns += 1;
    }
    Ok(turns)
}

#[test]
fn work_is_stopped_on_request_of_its_caller() {
    let requested = Rc::new(Cell::new(0));
    let count = Rc::clone(&requested);
    let stop = move || {
        count.set(count.get() + 1);
        count.get() == 2
    };
    assert!(matches!(stoppable(stop, || work_for(60.0)), Err(Error::Interrupted)));
    assert_eq!(requested.get(), 2);
    // The caller is not queried any more.
    assert!(work_for(0.2).unwrap() > 1);
    assert_eq!(requested.get(), 2);
}

#[test]
fn short_work_is_not_stopped() {
    assert!(stoppable(|| true, || Watch::new().check()).is_ok());
}
