//! Prediction over the delay between a torque command and its effect.

use super::lean_planes::product;
use crate::Plant;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::wheels::Wheels;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::SMatrix;

ballbot_base::fields! {
    /// Properties of the motors known to a controller.
    #[derive(Copy)]
    pub struct DelayOptions {
        /// Time between a torque that is commanded and its effect: a multiple of the sampling time, at most ten samples. The
        /// law acts on the state that it predicts for then.
        pub delay: f64 = 0.0, "s", Limit::NOT_NEGATIVE.to(10.0);
    }
}

/// Largest delay in samples.
const MAX_SAMPLES: f64 = 10.0;

/// Largest deviation of a delay from a multiple of a sample, in samples.
const ROUNDING: f64 = 1e-6;

/// The state after the delay, x̂ = Aᵈ x + Σ Aⁱ B τ₋₁₋ᵢ, from the torques of the last d samples: deviations from the
/// torques of the setpoint's motion. The states are the states of the linear model, or `N` states with those that a
/// controller adds.
#[derive(Clone, Debug, Default)]
pub(crate) struct Delayed<const N: usize = STATES> {
    /// −Aᵈ, row by row.
    free: Vec<[f64; N]>,
    /// −Aⁱ B for each sample, the oldest first.
    driven: Vec<[[f64; INPUTS]; N]>,
    /// Delay, s.
    delay: f64,
}

impl Delayed {
    /// The prediction of the linear model.
    ///
    /// # Errors
    /// As [`Delayed::of`].
    pub(crate) fn new(plant: &Plant<'_>, delay: f64) -> Result<Self> {
        let (a, b) = plant.sampled();
        Self::of(&a, &b, plant.control_dt, delay)
    }
}

impl<const N: usize> Delayed<N> {
    /// The prediction of x⁺ = A x + B τ.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for more than ten samples, [`Error::Inconsistent`] for a delay that is not a multiple of a
    /// sample.
    pub(crate) fn of(a: &SMatrix<f64, N, N>, b: &SMatrix<f64, N, INPUTS>, control_dt: f64, delay: f64) -> Result<Self> {
        let limit = format_args!("from 0 to {MAX_SAMPLES} control_dt = {} s", MAX_SAMPLES * control_dt);
        check("delay", delay, limit, |delay| (0.0..=(MAX_SAMPLES + ROUNDING) * control_dt).contains(&delay))?;
        let samples = (delay / control_dt).round();
        if (delay / control_dt - samples).abs() > ROUNDING {
            return Err(Error::Inconsistent(format!(
                "delay = {delay} s is not a multiple of control_dt = {control_dt} s"
            )));
        }
        let mut power = SMatrix::<f64, N, N>::identity();
        let mut driven = Vec::new();
        for _ in 0..samples as usize {
            let response = power * b;
            driven.insert(0, std::array::from_fn(|i| std::array::from_fn(|j| -response[(i, j)])));
            power = a * power;
        }
        let free = (0..N).map(|i| std::array::from_fn(|j| -power[(i, j)])).collect();
        Ok(Self { free, driven, delay: samples * control_dt })
    }

    /// The delay, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.delay
    }

    /// Number of stored values per robot.
    pub(crate) fn kept(&self) -> usize {
        INPUTS * self.driven.len()
    }

    /// The state after the delay.
    #[inline(always)]
    pub(crate) fn state<L: Lane>(&self, x: [L; N], memory: &Memory<'_, L>) -> [L; N] {
        if self.driven.is_empty() {
            return x;
        }
        let mut predicted = x;
        for (row, predicted) in self.free.iter().zip(&mut predicted) {
            *predicted = product(row, &x);
        }
        for (sample, response) in self.driven.iter().enumerate() {
            let torques = memory.wheels(INPUTS * sample);
            for (row, predicted) in response.iter().zip(&mut predicted) {
                *predicted += product(row, &torques.0);
            }
        }
        predicted
    }

    /// The torques that act in this sample. `commanded`, the torques commanded now, are stored until they act, as
    /// deviations from the torques of the setpoint's motion at that time.
    #[inline(always)]
    pub(crate) fn acting<L: Lane>(
        &self,
        commanded: Wheels<L>,
        motion_then: Wheels<L>,
        motion_now: Wheels<L>,
        memory: &mut Memory<'_, L>,
    ) -> Wheels<L> {
        if self.driven.is_empty() {
            return commanded;
        }
        let before = memory.wheels(0);
        self.keep(commanded - motion_then, memory);
        motion_now + before
    }

    /// Stores the torques of this sample as deviations from the torques of the setpoint's motion.
    #[inline(always)]
    pub(crate) fn keep<L: Lane>(&self, torques: Wheels<L>, memory: &mut Memory<'_, L>) {
        let Some(last) = self.driven.len().checked_sub(1) else { return };
        for sample in 0..last {
            let next = memory.wheels(INPUTS * (sample + 1));
            memory.set_wheels(INPUTS * sample, next);
        }
        memory.set_wheels(INPUTS * last, torques);
    }
}
