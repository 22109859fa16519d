//! Access in lanes to the internal numbers of a stage, a task or a controller.

use super::group::{Group, each, group_of};
use super::{Lane, Quat, Vec3};
use crate::wheels::Wheels;

/// Numbers of one robot or of eight.
pub struct Memory<'a, L: Lane> {
    token: L::Token,
    cells: &'a mut [L::Cell],
}

impl<'a, L: Lane> Memory<'a, L> {
    /// Access to the numbers in `cells`.
    #[inline(always)]
    pub fn new(token: L::Token, cells: &'a mut [L::Cell]) -> Self {
        Self { token, cells }
    }

    /// The numbers from `first` on.
    #[inline(always)]
    pub fn after(&mut self, first: usize) -> Memory<'_, L> {
        Memory { token: self.token, cells: &mut self.cells[first..] }
    }

    /// Number `index`.
    #[inline(always)]
    pub fn get(&self, index: usize) -> L {
        L::load(self.token, &self.cells[index])
    }

    /// Replaces number `index`.
    #[inline(always)]
    pub fn set(&mut self, index: usize, value: L) {
        value.store(&mut self.cells[index]);
    }

    /// Numbers `first` to `first` + 2.
    #[inline(always)]
    pub fn get3(&self, first: usize) -> [L; 3] {
        [self.get(first), self.get(first + 1), self.get(first + 2)]
    }

    /// Replaces numbers `first` to `first` + 2.
    #[inline(always)]
    pub fn set3(&mut self, first: usize, [a, b, c]: [L; 3]) {
        self.set(first, a);
        self.set(first + 1, b);
        self.set(first + 2, c);
    }

    /// The vector in numbers `first` to `first` + 2.
    #[inline(always)]
    pub fn vector(&self, first: usize) -> Vec3<L> {
        self.get3(first).into()
    }

    /// Replaces the vector in numbers `first` to `first` + 2.
    #[inline(always)]
    pub fn set_vector(&mut self, first: usize, vector: Vec3<L>) {
        self.set3(first, [vector.x, vector.y, vector.z]);
    }

    /// The number of each wheel, from number `first` on.
    #[inline(always)]
    pub fn wheels(&self, first: usize) -> Wheels<L> {
        self.get3(first).into()
    }

    /// Replaces the number of each wheel, from number `first` on.
    #[inline(always)]
    pub fn set_wheels(&mut self, first: usize, values: Wheels<L>) {
        self.set3(first, values.0);
    }

    /// The quaternion `[w, x, y, z]` in numbers `first` to `first` + 3.
    #[inline(always)]
    pub fn quaternion(&self, first: usize) -> Quat<L> {
        Quat { w: self.get(first), v: self.vector(first + 1) }
    }

    /// Replaces the quaternion in numbers `first` to `first` + 3.
    #[inline(always)]
    pub fn set_quaternion(&mut self, first: usize, quaternion: Quat<L>) {
        self.set(first, quaternion.w);
        self.set_vector(first + 1, quaternion.v);
    }

    /// The group in the numbers from `first` on.
    #[inline(always)]
    pub fn group<G: Group<L>>(&self, first: usize) -> G {
        let mut index = first;
        group_of(
            #[inline(always)]
            || {
                index += 1;
                self.get(index - 1)
            },
        )
    }

    /// Replaces the group in the numbers from `first` on.
    #[inline(always)]
    pub fn set_group<G: Group<L>>(&mut self, first: usize, group: &G) {
        let mut index = first;
        each(
            group,
            #[inline(always)]
            |number: &L| {
                self.set(index, *number);
                index += 1;
            },
        );
    }

    /// Proof of the instructions of the lanes.
    #[inline(always)]
    pub fn token(&self) -> L::Token {
        self.token
    }

    /// Loads numbers from other storage.
    #[inline(always)]
    pub fn load(&self, cell: &L::Cell) -> L {
        L::load(self.token, cell)
    }

    /// A constant with the same value for all robots.
    #[inline(always)]
    pub fn splat(&self, value: f64) -> L {
        L::from_f64(self.token, value)
    }
}
