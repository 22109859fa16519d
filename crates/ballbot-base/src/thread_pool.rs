//! Worker threads in addition to the calling thread.

use crate::error::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// Worker threads, started on first use. A forked child process does not have the threads of its parent, so a pool is
/// used only in the process that started it.
#[derive(Default)]
pub struct WorkerThreads {
    count: usize,
    pool: Option<(u32, Arc<ThreadPool>)>,
}

impl WorkerThreads {
    /// A pool of `count` threads that have not been started.
    pub fn new(count: usize) -> Self {
        Self { count, pool: None }
    }

    /// Number of threads.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Runs `work` on the calling thread and on each worker at the same time. Starts the workers if necessary.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the threads cannot be started; `work` then does not run.
    pub fn share(&mut self, work: impl Fn() + Sync) -> Result<()> {
        match self.pool()? {
            None => work(),
            Some(pool) => share(&pool, work),
        }
        Ok(())
    }

    /// The started pool, shared so that `self` is not borrowed; `None` for zero threads.
    ///
    /// # Errors
    /// As [`WorkerThreads::share`].
    pub fn pool(&mut self) -> Result<Option<Arc<ThreadPool>>> {
        if self.count == 0 {
            return Ok(None);
        }
        let process = std::process::id();
        if self.pool.as_ref().is_some_and(|(owner, _)| *owner != process) {
            // After a fork the pool's threads do not exist, and dropping it could wait for them.
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

/// Runs `work` on the calling thread and on each thread of `pool` at the same time.
pub fn share(pool: &ThreadPool, work: impl Fn() + Sync) {
    pool.in_place_scope(|scope| {
        for _ in 0..pool.current_num_threads() {
            scope.spawn(|_| work());
        }
        work();
    });
}

/// Largest number of threads: more than machines have cores that a batch could use, few enough to be started at once.
const MAX_THREADS: usize = 256;

/// Requested number of threads; by default the number of cores.
///
/// # Errors
/// [`Error::Inconsistent`] for zero, or more than 256.
pub fn thread_count(num_threads: Option<usize>) -> Result<usize> {
    match num_threads {
        Some(0) => Err(Error::Inconsistent("num_threads = 0, it must be at least 1".into())),
        Some(count) if count > MAX_THREADS => {
            Err(Error::Inconsistent(format!("num_threads = {count}, it must be at most {MAX_THREADS}")))
        }
        Some(count) => Ok(count),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from).min(MAX_THREADS)),
    }
}
