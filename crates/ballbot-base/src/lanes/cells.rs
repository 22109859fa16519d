//! Struct-of-arrays storage of eight robots, and access to the numbers of one robot.

use serde::{Deserialize, Serialize};
use std::slice;

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

/// A number or an array of numbers as a slice of cells.
pub trait AsCells<T> {
    /// Cells for reading.
    fn as_cells(&self) -> &[T];
    /// Cells for writing.
    fn as_cells_mut(&mut self) -> &mut [T];
}

impl<T> AsCells<T> for T {
    fn as_cells(&self) -> &[T] {
        slice::from_ref(self)
    }
    fn as_cells_mut(&mut self) -> &mut [T] {
        slice::from_mut(self)
    }
}

impl<T, const N: usize> AsCells<T> for [T; N] {
    fn as_cells(&self) -> &[T] {
        self
    }
    fn as_cells_mut(&mut self) -> &mut [T] {
        self
    }
}

impl<T, const N: usize, const M: usize> AsCells<T> for [[T; N]; M] {
    fn as_cells(&self) -> &[T] {
        self.as_flattened()
    }
    fn as_cells_mut(&mut self) -> &mut [T] {
        self.as_flattened_mut()
    }
}

/// Defines a struct of cells `T`, numbers of one robot (`f64`) or of eight ([`Eight`]), with access to one robot.
#[macro_export]
macro_rules! cells {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$doc:meta])* pub $field:ident: $type:ty,)* }) => {
        $(#[$meta])*
        pub struct $name<T> {
            $($(#[$doc])* pub $field: $type,)*
        }

        impl<T: $crate::lanes::Cell> $name<T> {
            /// The numbers of one robot.
            #[inline]
            pub fn lane(&self, index: usize) -> $name<f64> {
                use $crate::lanes::AsCells;
                let mut out = $name::<f64>::default();
                $(
                    let all = AsCells::<T>::as_cells(&self.$field);
                    let cells = AsCells::<f64>::as_cells_mut(&mut out.$field);
                    for (cell, all) in cells.iter_mut().zip(all) {
                        *cell = all.get(index);
                    }
                )*
                out
            }

            /// Replaces the numbers of one robot.
            #[inline]
            pub fn set_lane(&mut self, index: usize, one: &$name<f64>) {
                use $crate::lanes::AsCells;
                $(
                    let all = AsCells::<T>::as_cells_mut(&mut self.$field);
                    let cells = AsCells::<f64>::as_cells(&one.$field);
                    for (all, cell) in all.iter_mut().zip(cells) {
                        all.set(index, *cell);
                    }
                )*
            }
        }
    };
}
