//! Earlier observations of the robots of a chunk.

use super::Environments;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::history::History;
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::lanes::Cell;

/// Largest magnitude of a row from a snapshot.
const MAX_ROW: f32 = 1e30;

/// Earlier observations of the robots of a chunk, as far back as their history reaches: a ring for each robot. The newest
/// observation is in the ledger.
pub struct Past {
    /// Ages of the observations that are given together, ascending from 0.
    ages: Vec<usize>,
    /// The largest age.
    depth: usize,
    /// Rows of an observation.
    rows: usize,
    /// Robot by robot, `depth` observations.
    kept: Vec<f32>,
    /// Place of the observation of age 1 in each ring.
    newest: usize,
}

impl Past {
    pub fn new(history: &History, rows: usize, robots: usize) -> Self {
        let ages = history.ages();
        let depth = ages.last().copied().unwrap_or(0);
        Self { ages, depth, rows, kept: vec![0.0; robots * depth * rows], newest: 0 }
    }

    /// Keeps the observations of all robots, whose age is 1 from now on.
    fn keep<C: Cell>(&mut self, observations: &[C]) {
        if self.depth == 0 {
            return;
        }
        self.newest = (self.newest + 1) % self.depth;
        let first = self.newest * self.rows;
        for (i, ring) in self.kept.chunks_exact_mut((self.depth * self.rows).max(1)).enumerate() {
            for (out, cell) in ring[first..].iter_mut().zip(observations) {
                *out = cell.get(i) as f32;
            }
        }
    }

    /// The place of the observation of robot `i` that is `age` steps old, from 1 to `depth`.
    fn place(&self, i: usize, age: usize) -> std::ops::Range<usize> {
        let first = (i * self.depth + (self.newest + self.depth + 1 - age) % self.depth) * self.rows;
        first..first + self.rows
    }
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Makes the newest observations of all robots their last ones, before a step writes the next.
    pub fn keep_observations(&mut self) {
        self.past.keep(&self.ledger.observation);
    }

    /// Writes the rows of robot `i`, oldest first.
    #[inline]
    pub fn write_rows(&self, i: usize, out: &mut [f32]) {
        let rows = self.past.rows;
        for (out, age) in out.chunks_exact_mut(rows.max(1)).rev().zip(&self.past.ages) {
            self.write_aged(i, *age, out);
        }
    }

    /// Writes the rows of robot `i` as they were `age` steps ago, or at the start of its episode.
    #[inline]
    fn write_aged(&self, i: usize, age: usize, out: &mut [f32]) {
        // The first observation of an episode replaces earlier ones.
        let age = if age == 0 { 0 } else { age.min(self.ledger.episode.steps.get(i) as usize) };
        if age > 0 {
            out.copy_from_slice(&self.past.kept[self.past.place(i, age)]);
            return;
        }
        for (out, cell) in out.iter_mut().zip(&self.ledger.observation) {
            *out = cell.get(i) as f32;
        }
    }

    /// Earlier observations of robot `i` for a snapshot, by age.
    pub fn past_of(&self, i: usize) -> Vec<f32> {
        let mut past = vec![0.0; self.past.depth * self.past.rows];
        for (age, out) in past.chunks_exact_mut(self.past.rows.max(1)).enumerate() {
            self.write_aged(i, age + 1, out);
        }
        past
    }

    /// Whether the earlier observations of a snapshot are valid for these robots.
    pub fn past_fits(&self, saved: &[f32]) -> bool {
        saved.len() == self.past.depth * self.past.rows && saved.iter().all(|row| row.abs() <= MAX_ROW)
    }

    /// Restores earlier observations of robot `i` from [`Environments::past_of`].
    pub fn restore_past(&mut self, i: usize, saved: &[f32]) {
        for (age, rows) in saved.chunks_exact(self.past.rows.max(1)).enumerate() {
            let place = self.past.place(i, age + 1);
            self.past.kept[place].copy_from_slice(rows);
        }
    }
}
