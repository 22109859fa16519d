//! The conditions of a step.

use super::law::{Bounds, Laws};
use super::rows::{FLOOR, Present, ROWS, load, partner};
use crate::lanes::Lane;

/// Compliance of the friction of rates, rollers and joints, as a share of the row's own. With all of them at rest the rows
/// outnumber the degrees of freedom; the compliance makes their impulses unique. A robot that friction of the impulse λ
/// holds creeps by this share of the speed that λ would give the row alone.
const COMPLIANCE: f64 = 1e-8;

/// The rows of one robot or of eight, and the bounds of their impulses.
pub struct Problem<L> {
    /// Change of the speed of each row per impulse of each, 1/kg; symmetric.
    pub coupling: [[L; ROWS]; ROWS],
    /// Speeds without impulses, m/s.
    pub residuals: [L; ROWS],
    pub bounds: Bounds<L>,
    pub present: Present,
    /// Mass of each row by itself, kg.
    pub masses: [L; ROWS],
    /// Impulse of a wheel's static load in a step, N·s.
    pub static_impulse: L,
}

impl<L: Lane> Problem<L> {
    /// A problem of rows with that coupling, without compliance.
    #[inline(always)]
    pub fn new(
        mut coupling: [[L; ROWS]; ROWS],
        residuals: [L; ROWS],
        bounds: Bounds<L>,
        present: Present,
        static_impulse: L,
    ) -> Self {
        let one = static_impulse.splat(1.0);
        let mut masses = [one; ROWS];
        for &row in present.rows() {
            if row < FLOOR {
                coupling[row][row] = coupling[row][row] * (1.0 + COMPLIANCE);
            }
            masses[row] = one / coupling[row][row];
        }
        // In a disc, friction is against the motion only if both rows count alike.
        for &row in present.rows() {
            if let Some(other) = partner(row) {
                masses[row] = masses[row].min(masses[other]);
            }
        }
        Self { coupling, residuals, bounds, present, masses, static_impulse }
    }

    /// Speeds of the rows with impulses.
    #[inline(always)]
    pub fn speeds(&self, impulses: &[L; ROWS]) -> [L; ROWS] {
        let mut speeds = self.residuals;
        for &row in self.present.rows() {
            for &other in self.present.rows() {
                speeds[row] = self.coupling[row][other].mul_add(impulses[other], speeds[row]);
            }
        }
        speeds
    }

    /// Impulses less the speeds times the masses, which would bring each row to rest by itself; the speeds of friction
    /// count `weight` times.
    #[inline(always)]
    pub fn trial(&self, impulses: &[L; ROWS], speeds: &[L; ROWS], weight: f64) -> [L; ROWS] {
        let mut trial = *impulses;
        for &row in self.present.rows() {
            let mass = self.masses[row] * if load(row).is_some() { weight } else { 1.0 };
            trial[row] = speeds[row].neg_mul_add(mass, impulses[row]);
        }
        trial
    }

    /// Largest difference between the impulses and those that answer their trial impulses, N·s: zero for a solution.
    #[inline(always)]
    pub fn violation(&self, impulses: &[L; ROWS], speeds: &[L; ROWS]) -> L {
        let trial = self.trial(impulses, speeds, 1.0);
        let laws = Laws::at(&self.bounds, &trial, &self.masses, self.present.rows());
        let mut worst = self.static_impulse.zero();
        for &row in self.present.rows() {
            worst = (impulses[row] - laws.impulse(row, &trial)).abs().max(worst);
        }
        worst
    }

    /// The impulses with the friction of contacts within the bounds of their loads.
    #[inline(always)]
    pub fn bounded(&self, impulses: &[L; ROWS]) -> [L; ROWS] {
        let laws = Laws::at(&self.bounds, impulses, &self.masses, self.present.rows());
        let mut out = *impulses;
        for &row in self.present.rows() {
            if row >= FLOOR || load(row).is_some() {
                out[row] = laws.impulse(row, impulses) + 0.0;
            }
        }
        out
    }
}
