//! Work that its caller can stop.

use crate::error::{Error, Result};
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Least time between two queries of the caller.
const INTERVAL: Duration = Duration::from_millis(50);

/// Approximate duration of work between two clock readings.
const WORK_PER_LOOK: Duration = Duration::from_millis(5);

/// A caller to query, and the time of its last query.
struct Caller {
    stop: Rc<dyn Fn() -> bool>,
    last_request: Instant,
}

thread_local! {
    static CALLER: RefCell<Option<Caller>> = const { RefCell::new(None) };
}

/// Runs `work`. During long work, `stop` is called on this thread about every 50 ms; if it returns true, the work
/// returns [`Error::Interrupted`].
pub fn stoppable<T>(stop: impl Fn() -> bool + 'static, work: impl FnOnce() -> T) -> T {
    struct Restore(Option<Caller>);
    impl Drop for Restore {
        fn drop(&mut self) {
            CALLER.set(self.0.take());
        }
    }
    let _restore = Restore(CALLER.replace(Some(Caller { stop: Rc::new(stop), last_request: Instant::now() })));
    work()
}

/// Queries the caller if there is one and the time has come.
fn stopped(now: Instant) -> bool {
    let stop = CALLER.with_borrow_mut(|caller| {
        let caller = caller.as_mut()?;
        if now.duration_since(caller.last_request) < INTERVAL {
            return None;
        }
        caller.last_request = now;
        Some(Rc::clone(&caller.stop))
    });
    // Not while the caller is borrowed: its function may call this one again.
    stop.is_some_and(|stop| stop())
}

/// Checks periodically whether the caller has requested to stop the work.
pub struct Watch {
    /// Last clock reading; `None` without a caller that may stop the work.
    looked: Option<Instant>,
    /// Calls of [`Watch::check`] between two clock readings, adapted to their duration.
    every: u64,
    left: u64,
}

impl Default for Watch {
    fn default() -> Self {
        Self::new()
    }
}

impl Watch {
    /// For work that starts now.
    pub fn new() -> Self {
        let watched = CALLER.with_borrow(Option::is_some);
        Self { looked: watched.then(Instant::now), every: 0, left: 0 }
    }

    /// # Errors
    /// [`Error::Interrupted`] if the caller stopped its work.
    #[inline]
    pub fn check(&mut self) -> Result<()> {
        if self.left > 0 {
            self.left -= 1;
            return Ok(());
        }
        self.look()
    }

    fn look(&mut self) -> Result<()> {
        let Some(looked) = &mut self.looked else {
            self.left = u64::MAX;
            return Ok(());
        };
        let now = Instant::now();
        let worked = now.duration_since(*looked);
        *looked = now;
        if worked < WORK_PER_LOOK / 2 {
            self.every = 2 * self.every + 1;
        } else if worked > WORK_PER_LOOK * 2 {
            self.every /= 4;
        }
        self.left = self.every;
        if stopped(now) { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Stops work on several threads: the calling thread checks, all threads stop.
#[derive(Default)]
pub struct Stop {
    set: AtomicBool,
}

impl Stop {
    /// Whether this thread must stop its work.
    #[inline]
    pub fn look(&self, watch: &mut Watch) -> bool {
        if watch.check().is_err() {
            self.set.store(true, Ordering::Relaxed);
        }
        self.is_set()
    }

    /// Whether the work was stopped.
    pub fn is_set(&self) -> bool {
        self.set.load(Ordering::Relaxed)
    }
}
