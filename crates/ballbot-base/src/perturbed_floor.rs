//! A floor that moves, and on which friction differs from place to place, under one robot or eight.
//!
//! The state of a robot is relative to its floor. In the frame of a floor that accelerates in its plane, bodies fall with
//! gravity less this acceleration, exactly. A floor that tilts like a ship turns gravity in its frame. The terms of the
//! turning frame itself, of Euler and Coriolis and of centrifugal force, are neglected: at the distance r from the axis and
//! at the speed v, with the amplitude A and the period T, they are at most A (2π/T)² r, 2 A (2π/T) v and A² (2π/T)² r.

use crate::lanes::{Cell, Lane, Vec3, floor, lane_struct, philox, sin_cos, sin_cos_of_step};
use crate::params::Params;
use std::f64::consts::TAU;

/// Separates the random numbers of patches from other uses of the same seed.
const STREAM: u32 = u32::from_le_bytes(*b"tile");

/// Largest factor of a gradient of friction.
const MOST: f64 = 2.0;

lane_struct! {
    /// Motion of a floor.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct FloorMotion<T> {
        gravity: T,
        tilt: [T; 2],
        roll: [T; 2],
        roll_rate: T,
        roll_phases: [T; 2],
        acceleration: [T; 2],
        acceleration_rate: T,
        acceleration_phase: T,
        rise: T,
        /// 1 for a floor that moves, else 0.
        moves: T,
    }
}

impl FloorMotion<f64> {
    /// The motion of a robot's floor.
    pub fn new(params: &Params) -> Self {
        Self {
            gravity: params.gravity,
            tilt: params.floor_tilt,
            roll: params.floor_tilt_amplitude,
            roll_rate: TAU / params.floor_tilt_period,
            roll_phases: params.floor_tilt_phases,
            acceleration: params.floor_acceleration,
            acceleration_rate: TAU / params.floor_acceleration_period,
            acceleration_phase: params.floor_acceleration_phase,
            rise: params.floor_acceleration_rise,
            moves: f64::from(u8::from(params.has_moving_floor())),
        }
    }
}

impl<L: Lane> FloorMotion<L> {
    /// Mask of the floors that move.
    #[inline(always)]
    pub fn moves(&self) -> L::Mask {
        self.moves.zero().lt(self.moves)
    }

    /// Acceleration of the floor minus gravity, in its frame, m/s², at a time since the start of the episode, s.
    #[inline(always)]
    pub fn up(&self, time: L) -> Vec3<L> {
        let one = time.splat(1.0);
        let (to_x, _) = sin_cos(time.mul_add(self.roll_rate, self.roll_phases[0]));
        let (to_y, _) = sin_cos(time.mul_add(self.roll_rate, self.roll_phases[1]));
        let x = self.roll[0].mul_add(to_x, self.tilt[0]);
        let y = self.roll[1].mul_add(to_y, self.tilt[1]);
        let angle = x.mul_add(x, y.squared()).sqrt().max(time.splat(f64::MIN_POSITIVE));
        let (sin, cos) = sin_cos_of_step(angle);
        let share = sin / angle;
        let phase = time.mul_add(self.acceleration_rate, self.acceleration_phase);
        let (wave, _) = sin_cos(phase);
        // A triangle with the period and the sign of the sine: it reaches 1 after a quarter.
        let turns = phase * (1.0 / TAU);
        let turns = turns - floor(turns + 0.5);
        let height = turns.abs() * 4.0;
        let height = height.min(-height + 2.0);
        let level = (height / L::select(time.zero().lt(self.rise), self.rise, one)).min(one);
        let trapezoid = L::select(turns.lt(time.zero()), -level, level);
        let share_of_amplitude = L::select(time.zero().lt(self.rise), trapezoid, wave);
        Vec3::new(
            (-y * share).mul_add(self.gravity, self.acceleration[0] * share_of_amplitude),
            (x * share).mul_add(self.gravity, self.acceleration[1] * share_of_amplitude),
            cos * self.gravity,
        )
    }
}

lane_struct! {
    /// Friction of a floor by place.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct FrictionMap<T> {
        gradient: [T; 2],
        /// 1 / side of a patch; 0 without patches.
        per_meter: T,
        /// Factor of a patch at the random number 0, and its growth with the number.
        least: T,
        span: T,
        seed: T,
    }
}

impl FrictionMap<f64> {
    /// The friction of a robot's floor.
    pub fn new(params: &Params) -> Self {
        let size = params.floor_patch_size;
        let [least, most] = if size > 0.0 { params.floor_patch_friction } else { [1.0; 2] };
        Self {
            gradient: params.floor_friction_gradient,
            per_meter: if size > 0.0 { size.recip() } else { 0.0 },
            least,
            span: most - least,
            seed: params.floor_patch_seed,
        }
    }
}

lane_struct! {
    /// The patch of each robot, kept from step to step. No result depends on what was kept.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Tile<T> {
        /// Column and row; NaN for none.
        place: [T; 2],
        factor: T,
    }
}

impl<T: Cell> Default for Tile<T> {
    fn default() -> Self {
        let mut none = T::default();
        (0..T::WIDTH).for_each(|i| none.set(i, f64::NAN));
        Self { place: [none; 2], factor: none }
    }
}

impl<T: Cell> Tile<T> {
    /// Forgets the patch of one robot, whose floor has changed.
    pub fn forget(&mut self, lane: usize) {
        self.place.iter_mut().for_each(|cell| cell.set(lane, f64::NAN));
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self, map: &FrictionMap<T>, place: &[T; 2]) {
        for i in 0..T::WIDTH {
            let [column, row] = [place[0].get(i), place[1].get(i)];
            if column == self.place[0].get(i) && row == self.place[1].get(i) {
                continue;
            }
            // Of a state that has diverged, too: conversions saturate.
            let words = |index: f64| [index as i64 as u32, (index as i64 >> 32) as u32];
            let ([a, b], [c, d]) = (words(column), words(row));
            let [low, high, ..] = philox([map.seed.get(i) as u32, STREAM], [a, b, c, d]).map(u64::from);
            let unit = ((high << 32 | low) >> 11) as f64 * (0.5 * f64::EPSILON);
            self.factor.set(i, map.span.get(i).mul_add(unit, map.least.get(i)));
            self.place[0].set(i, column);
            self.place[1].set(i, row);
        }
    }
}

impl<T: Cell> FrictionMap<T> {
    /// Factor of friction at x and y, m.
    #[inline(always)]
    pub fn factor<L: Lane<Cell = T>>(&self, token: L::Token, [x, y]: [L; 2], tile: &mut Tile<T>) -> L {
        let per_meter = L::load(token, &self.per_meter);
        // The origin is in the middle of a patch.
        let (column, row) = (floor(x * per_meter + 0.5), floor(y * per_meter + 0.5));
        let (kept_column, kept_row) = (L::load(token, &tile.place[0]), L::load(token, &tile.place[1]));
        let same_column = column.le(kept_column) & kept_column.le(column);
        if L::any(!(same_column & row.le(kept_row) & kept_row.le(row))) {
            let mut place = [T::default(); 2];
            column.store(&mut place[0]);
            row.store(&mut place[1]);
            tile.refill(self, &place);
        }
        let (gx, gy) = (L::load(token, &self.gradient[0]), L::load(token, &self.gradient[1]));
        let one = x.splat(1.0);
        let linear = x.mul_add(gx, y.mul_add(gy, one)).max(x.zero()).min(x.splat(MOST));
        linear * L::load(token, &tile.factor)
    }
}
