//! Derivatives of the motions of the robots of a batch.

use super::batch::Batch;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::interrupt::Watch;
use ballbot_base::memory::require_memory;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_gradients::{Coordinates, Jacobian, Parameter, bytes_of};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

impl Batch {
    /// The states of [`Batch::jacobians`].
    pub fn derivative_coordinates(&self) -> Coordinates {
        self.model().coordinates((0..self.len()).any(|i| self.params(i).is_ok_and(Params::has_losses)))
    }

    /// Derivatives of the next time steps of the model of each robot under motor torques, N·m, without its motors' model: see
    /// [`Ballbot::jacobian`](crate::Ballbot::jacobian). `wheel_torques` has the same number of torques for each robot, at
    /// least one; each is held for `steps` time steps, at least one, and is three columns of B. The robots do not move.
    /// `None` for a robot without derivatives: its bot touches the floor, or it diverges. If one robot has losses, the
    /// contact forces of the last step are states of all.
    ///
    /// # Errors
    /// [`Error::Length`] unless there are as many torques for each robot; [`Error::OutOfRange`] for torques beyond the motors'
    /// limit, and for zero steps; [`Error::Inconsistent`] for a model or ground without derivatives, and for a parameter
    /// without derivative; [`Error::Memory`]; [`Error::Interrupted`] in [`crate::stoppable`].
    pub fn jacobians(
        &mut self,
        wheel_torques: &[Wheels<f64>],
        steps: usize,
        parameters: &[Parameter],
    ) -> Result<Vec<Option<Jacobian>>> {
        let n = self.len();
        let each = wheel_torques.len() / n;
        if wheel_torques.is_empty() {
            let name = "number of wheel_torques of a robot".into();
            return Err(Error::OutOfRange { name, value: 0.0, limit: "at least 1".into() });
        }
        self.expect_len("wheel_torques", wheel_torques.len(), n * each.max(1))?;
        let coordinates = self.derivative_coordinates();
        for (i, torques) in wheel_torques.iter().enumerate() {
            let limit = self.params(i / each)?.max_wheel_torque;
            let fits = |torque: f64| torque.abs() <= limit;
            // Names are made for errors alone.
            for (wheel, &torque) in torques.iter().enumerate().filter(|(_, torque)| !fits(**torque)) {
                let place = if each == 1 { i.to_string() } else { format!("{}, {}", i / each, i % each) };
                let name = format_args!("wheel_torques[{place}, {wheel}]");
                let words = format_args!("within ±max_wheel_torque = {limit} N·m");
                check(name, torque, words, fits)?;
            }
        }
        if steps == 0 {
            return Err(Error::OutOfRange { name: "steps".into(), value: 0.0, limit: "at least 1".into() });
        }
        require_memory("the derivatives", n, bytes_of(coordinates, each, parameters.len()))?;
        let found = Mutex::new((0..n).map(|_| None).collect::<Vec<_>>());
        let failure = Mutex::new(None);
        let next = AtomicUsize::new(0);
        let (chunks, width) = (&self.chunks, self.width);
        let work = || {
            let mut watch = Watch::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= n {
                    return;
                }
                let robot =
                    watch.check().and_then(|()| chunks[i / width].differentiated(i % width, parameters, coordinates));
                let jacobian = robot.map(|mut robot| robot.advance_under(&wheel_torques[i * each..][..each], steps));
                match jacobian {
                    Err(error) | Ok(Err(error @ Error::Interrupted)) => {
                        next.store(n, Ordering::Relaxed);
                        *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    }
                    Ok(jacobian) => found.lock().unwrap_or_else(PoisonError::into_inner)[i] = jacobian.ok(),
                }
            }
        };
        if self.helpers.count() == 0 {
            work();
        } else {
            self.helpers.share(work)?;
        }
        match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner)),
        }
    }
}
