//! Struct-of-arrays storage of one robot or of eight, and access to the numbers of one robot.

use serde::{Deserialize, Serialize};

/// Number of robots side by side.
pub const EIGHT: usize = 8;

/// One number of each of eight robots, aligned for vector registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub struct Eight(pub [f64; EIGHT]);

/// A stored number: of one robot (`f64`) or of eight ([`Eight`]).
pub trait Cell: Copy + Default + PartialEq + Send + Sync + 'static {
    /// Number of robots.
    const WIDTH: usize;
    /// The number of one robot.
    fn get(&self, index: usize) -> f64;
    /// Replaces the number of one robot.
    fn set(&mut self, index: usize, value: f64);
}

impl Cell for f64 {
    const WIDTH: usize = 1;
    #[inline(always)]
    fn get(&self, _: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set(&mut self, _: usize, value: f64) {
        *self = value;
    }
}

impl Cell for Eight {
    const WIDTH: usize = EIGHT;
    #[inline(always)]
    fn get(&self, index: usize) -> f64 {
        self.0[index]
    }
    #[inline(always)]
    fn set(&mut self, index: usize, value: f64) {
        self.0[index] = value;
    }
}
