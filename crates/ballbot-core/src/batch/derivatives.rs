//! Derivatives of the motions of the robots of a batch.

use super::batch::Batch;
use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::memory::require_memory;
use ballbot_base::wheels::Wheels;
use ballbot_gradients::{Jacobian, Parameter, bytes_of};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

impl Batch {
    /// Derivatives of the next `steps` time steps of the model, at least one, of each robot under constant motor torques,
    /// N·m, without its motors' model: see [`Ballbot::jacobian`](crate::Ballbot::jacobian). The robots do not move. `None`
    /// for a robot without derivatives: its bot touches the floor, or it diverges. If one robot has losses, the contact
    /// forces of the last step are states of all.
    ///
    /// # Errors
    /// [`Error::Length`] unless there are torques for each robot; [`Error::OutOfRange`] for torques that are not finite, and
    /// for zero steps; [`Error::Inconsistent`] for other models than `contact`; [`Error::Memory`];
    /// [`Error::Interrupted`] in [`crate::stoppable`].
    pub fn jacobians(
        &mut self,
        wheel_torques: &[Wheels<f64>],
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Vec<Option<Jacobian>>> {
        let n = self.len();
        self.expect_len("wheel_torques", wheel_torques.len(), n)?;
        let mut with_loads = false;
        for (i, torques) in wheel_torques.iter().enumerate() {
            if let Some((wheel, value)) = torques.iter().enumerate().find(|(_, torque)| !torque.is_finite()) {
                let name = format!("wheel_torques[{i}, {wheel}]");
                return Err(Error::OutOfRange { name, value: *value, limit: "finite".into() });
            }
            with_loads |= self.params(i)?.has_losses();
        }
        require_memory("the derivatives", n, bytes_of(parameters.len(), with_loads))?;
        // Errors of the model and of parameters are of all robots.
        self.chunks[0].differentiated(0, parameters, with_loads)?;
        let found = Mutex::new((0..n).map(|_| None).collect::<Vec<_>>());
        let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
        let (chunks, width) = (&self.chunks, self.width);
        let work = || {
            let mut watch = Watch::new();
            while !stopped.load(Ordering::Relaxed) {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= n {
                    return;
                }
                if watch.check().is_err() {
                    stopped.store(true, Ordering::Relaxed);
                }
                let robot = chunks[i / width].differentiated(i % width, parameters, with_loads);
                let jacobian = robot.and_then(|mut robot| robot.advance(wheel_torques[i], steps)).ok();
                found.lock().unwrap_or_else(PoisonError::into_inner)[i] = jacobian;
            }
        };
        if self.helpers.count() == 0 {
            work();
        } else {
            self.helpers.share(work)?;
        }
        if stopped.into_inner() {
            return Err(Error::Interrupted);
        }
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}
