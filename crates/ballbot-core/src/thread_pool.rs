//! Threads that help the caller's.

use crate::error::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// Threads that are made when they are first needed. A forked child has none of its parent's threads, so a pool serves
/// only the process that made it.
#[derive(Default)]
pub struct WorkerThreads {
    count: usize,
    pool: Option<(u32, Arc<ThreadPool>)>,
}

impl WorkerThreads {
    /// `count` threads, of which there are none yet.
    pub fn new(count: usize) -> Self {
        Self { count, pool: None }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Does `work` here and on each of the threads, all at once; they are made if this process has none.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the system gives no threads; no work is done then.
    pub fn share(&mut self, work: impl Fn() + Sync) -> Result<()> {
        match self.pool()? {
            None => work(),
            Some(pool) => share(&pool, work),
        }
        Ok(())
    }

    /// The threads, to be shared without keeping hold of `self`; none if there are to be none.
    ///
    /// # Errors
    /// As [`WorkerThreads::share`].
    pub fn pool(&mut self) -> Result<Option<Arc<ThreadPool>>> {
        if self.count == 0 {
            return Ok(None);
        }
        let process = std::process::id();
        if self.pool.as_ref().is_some_and(|(owner, _)| *owner != process) {
            // Its threads died with the fork: dropping it could wait for them.
            std::mem::forget(self.pool.take());
        }
        if self.pool.is_none() {
            let pool = ThreadPoolBuilder::new()
                .num_threads(self.count)
                .thread_name(|i| format!("ballbot-{i}"))
                .build()
                .map_err(|e| Error::Inconsistent(format!("cannot start {} threads: {e}", self.count)))?;
            self.pool = Some((process, Arc::new(pool)));
        }
        Ok(self.pool.as_ref().map(|(_, pool)| Arc::clone(pool)))
    }
}

/// Does `work` here and on each thread of `pool`, all at once.
pub fn share(pool: &ThreadPool, work: impl Fn() + Sync) {
    pool.in_place_scope(|scope| {
        for _ in 0..pool.current_num_threads() {
            scope.spawn(|_| work());
        }
        work();
    });
}

/// As many threads as are asked for, or as there are cores.
///
/// # Errors
/// [`Error::Inconsistent`] for zero.
pub fn thread_count(num_threads: Option<usize>) -> Result<usize> {
    match num_threads {
        Some(0) => Err(Error::Inconsistent("num_threads = 0, it must be at least 1".into())),
        Some(count) => Ok(count),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    }
}
