//! Newton's method for the impulses, with sweeps where it cycles.

use super::law::Laws;
use super::problem::Problem;
use super::rows::{DRIVE, FLOOR, JOINT, NORMAL, ROLLER, ROWS, TORQUE};
use crate::lanes::Lane;

/// Largest violation of an accepted solution, as a share of the impulses.
const TOLERANCE: f64 = 1e-11;

/// Largest number of linear systems in a round. Chosen by experiment.
const MOST_STEPS: usize = 8;

/// Systems of the first round with full weight of the speeds of friction. Chosen by experiment.
const DIRECT_STEPS: usize = 4;

/// Weight of these speeds in later ones: a row that slides the wrong way sticks before it slides the other way. Chosen by
/// experiment.
const CAREFUL_WEIGHT: f64 = 0.1;

/// Largest number of rounds. Chosen by experiment.
const ROUNDS: usize = 5;

/// Sweeps between two rounds. Chosen by experiment.
const SWEEPS: usize = 8;

/// Gain per sweep of the low-pass filter from load to bound of a wheel's friction, without which sweeps may diverge. Chosen
/// by experiment.
const LOAD_FILTER: f64 = 0.33;

/// The impulses of a step.
pub struct Solution<L: Lane> {
    pub impulses: [L; ROWS],
    /// Robots whose impulses violate the conditions; they are within the bounds of friction.
    pub unsolved: L::Mask,
}

impl<L: Lane> Problem<L> {
    /// Impulses of the robots in `open`, by steps from `warm`; the others keep `warm`.
    #[inline(always)]
    pub fn solution(&self, warm: &[L; ROWS], mut open: L::Mask) -> Solution<L> {
        let others = !open;
        let mut impulses = *warm;
        for round in 0..ROUNDS {
            if round > 0 {
                impulses = select(open, &self.swept(&impulses), &impulses);
            }
            let mut speeds = self.speeds(&impulses);
            for step in 0..MOST_STEPS {
                let weight = if round == 0 && step < DIRECT_STEPS { 1.0 } else { CAREFUL_WEIGHT };
                let trial = self.trial(&impulses, &speeds, weight);
                let laws = Laws::at(&self.bounds, &trial, &self.masses, self.present.rows());
                let found = self.solve(&laws, weight);
                let mut size = self.static_impulse;
                for impulse in found {
                    size += impulse.abs();
                }
                let finite = size.le(size.splat(f64::MAX));
                impulses = select(open & finite, &found, &impulses);
                speeds = self.speeds(&impulses);
                let solved = finite & self.violation(&impulses, &speeds).le(size * TOLERANCE);
                open = open & !solved;
                if !L::any(open) {
                    return Solution { impulses: select(others, warm, &self.bounded(&impulses)), unsolved: open };
                }
            }
        }
        impulses = select(open, &self.swept(&impulses), &impulses);
        Solution { impulses: select(others, warm, &self.bounded(&impulses)), unsolved: open }
    }

    #[inline(always)]
    fn swept(&self, impulses: &[L; ROWS]) -> [L; ROWS] {
        let mut impulses = self.bounded(impulses);
        let mut speeds = self.speeds(&impulses);
        let mut estimate = [impulses[NORMAL], impulses[NORMAL + 1], impulses[NORMAL + 2]];
        for _ in 0..SWEEPS {
            self.sweep(&mut estimate, &mut impulses, &mut speeds);
        }
        impulses
    }

    /// One Gauss-Seidel sweep: updates the impulse of each row, projected on its bounds, and the speeds. `estimate` is the
    /// filtered normal impulse of each wheel.
    #[inline(always)]
    pub fn sweep(&self, estimate: &mut [L; 3], impulses: &mut [L; ROWS], speeds: &mut [L; ROWS]) {
        let groups: [&[usize]; 4] =
            [&[FLOOR], &[FLOOR + 1, FLOOR + 2], &[NORMAL, NORMAL + 1, NORMAL + 2], &[DRIVE, DRIVE + 1, DRIVE + 2]];
        let lossy: [&[usize]; 4] =
            [&[TORQUE, TORQUE + 1], &[TORQUE + 2], &[ROLLER, ROLLER + 1, ROLLER + 2], &[JOINT, JOINT + 1, JOINT + 2]];
        for group in groups.into_iter().chain(lossy) {
            if !self.present.rows().contains(&group[0]) {
                continue;
            }
            // A pair in a disc is updated together, other rows one by one.
            let together = if group.len() == 2 { 2 } else { 1 };
            for rows in group.chunks(together) {
                self.relax(rows, estimate, impulses, speeds);
            }
            if group[0] == NORMAL {
                for (i, estimate) in estimate.iter_mut().enumerate() {
                    *estimate = (impulses[NORMAL + i] - *estimate).mul_add_all(LOAD_FILTER, *estimate);
                }
            }
        }
    }

    /// Brings rows as far to rest as their bounds allow.
    #[inline(always)]
    fn relax(&self, rows: &[usize], estimate: &[L; 3], impulses: &mut [L; ROWS], speeds: &mut [L; ROWS]) {
        let mut trial = *impulses;
        // A floor's load is that of this sweep, a wheel's is filtered.
        if rows[0] < NORMAL || rows[0] >= DRIVE {
            trial[NORMAL..DRIVE].copy_from_slice(estimate);
        }
        for &row in rows {
            trial[row] = speeds[row].neg_mul_add(self.masses[row], impulses[row]);
        }
        let laws = Laws::at(&self.bounds, &trial, &self.masses, rows);
        for &row in rows {
            let new = laws.impulse(row, &trial) + 0.0;
            let change = new - impulses[row];
            impulses[row] = new;
            for &other in self.present.rows() {
                speeds[other] = self.coupling[other][row].mul_add(change, speeds[other]);
            }
        }
    }
}

#[inline(always)]
fn select<L: Lane>(mask: L::Mask, yes: &[L; ROWS], no: &[L; ROWS]) -> [L; ROWS] {
    let mut out = *no;
    for (out, yes) in out.iter_mut().zip(yes) {
        *out = L::select(mask, *yes, *out);
    }
    out
}
