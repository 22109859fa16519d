//! Impulses of the rows: unilateral contacts with Coulomb friction, solved exactly by an active set.
//!
//! Each contact is open, sticks or slides; each joint sticks or slides. For given modes the impulses are the solution
//! of a linear system. Its solution and the velocities it leaves give the modes again. When the modes repeat, the
//! solution is exact: every friction force is within the limit set by the normal impulse of the same step.

use ballbot_base::wheels::Wheels;
use nalgebra::{SMatrix, SVector};

/// Number of rows: three normals, three tractions, floor (normal, x, y), three joints.
pub const ROWS: usize = 12;
/// First row of the tractions.
pub const TRACTION: usize = 3;
/// Normal row of the floor.
pub const FLOOR: usize = 6;
/// First row of the joints.
pub const JOINT: usize = 9;

/// Largest number of linear systems between sweeps.
const SOLUTIONS: usize = 12;
/// Sweeps after modes that did not settle.
const SWEEPS: usize = 10;
/// Rounds of solutions and sweeps before the sweeps' result is accepted.
const ROUNDS: usize = 6;
/// Change of the slip direction on the floor at which it has settled.
const SAME_DIRECTION: f64 = 1e-10;
/// Gain per sweep of the low-pass filter from normal impulse to friction bound; without it sweeps may diverge.
const LOAD_FILTER: f64 = 0.33;

/// Impulses, one per row, N·s or N·m·s.
pub type Impulses = SVector<f64, ROWS>;

/// Velocity change of each row per impulse of each row.
pub type Coupling = SMatrix<f64, ROWS, ROWS>;

/// Limits of friction.
pub struct Limits {
    /// Friction coefficients of the wheels.
    pub wheels: Wheels<f64>,
    /// Friction coefficient of the floor.
    pub floor: f64,
    /// Largest angular impulse of dry joint friction, N·m·s.
    pub joint: f64,
}

/// Velocities of the rows per impulse, and without impulses.
pub struct Problem<'a> {
    pub coupling: &'a Coupling,
    pub residual: SVector<f64, ROWS>,
    /// Rows from this index on are absent.
    pub active: usize,
}

/// How the modes of a step were found, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Settling {
    /// Without sweeps.
    AtOnce,
    /// After sweeps.
    Searched,
    /// Not at all.
    Unsolved,
}

/// State of a contact or joint.
#[derive(Clone, Copy, Debug)]
enum Mode {
    Open,
    Stick,
    /// Friction at its limit along this direction.
    Slide([f64; 2]),
}

impl Mode {
    fn same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Open, Self::Open) | (Self::Stick, Self::Stick) => true,
            (Self::Slide(a), Self::Slide(b)) => {
                (a[0] - b[0]).abs() <= SAME_DIRECTION && (a[1] - b[1]).abs() <= SAME_DIRECTION
            }
            _ => false,
        }
    }
}

/// An unknown impulse: its row, and the rows whose impulses are fractions of it.
#[derive(Clone, Copy, Default)]
struct Unknown {
    row: usize,
    shares: [(usize, f64); 2],
}

impl Unknown {
    fn of(row: usize) -> Self {
        Self { row, shares: Default::default() }
    }
}

/// Modes of the wheels, the floor and the joints.
type Modes = [Mode; 7];

/// The wheel, floor or joint of mode `k`: its normal row, its friction rows.
fn rows_of(k: usize) -> (Option<usize>, &'static [usize]) {
    const TANGENTS: [&[usize]; 7] = [&[3], &[4], &[5], &[7, 8], &[9], &[10], &[11]];
    let normal = match k {
        0..=2 => Some(k),
        3 => Some(FLOOR),
        _ => None,
    };
    (normal, TANGENTS[k])
}

impl Problem<'_> {
    /// The impulses, starting from the impulses of the last step. They are exact unless the modes do not settle; then they
    /// leave the least energy of their multiples. Friction is always within its limits.
    pub fn solve(&self, limits: &Limits, start: &Impulses) -> (Impulses, Settling) {
        let mut impulses = *start;
        let mut loads = Wheels::from_fn(|i| start[i]);
        for round in 0..ROUNDS {
            let mut modes = self.modes(limits, &impulses);
            for _ in 0..SOLUTIONS {
                let Some(found) = self.solve_modes(limits, &modes) else { break };
                let next = self.modes(limits, &found);
                if modes.iter().zip(&next).all(|(old, new)| old.same(new)) {
                    return (found, if round == 0 { Settling::AtOnce } else { Settling::Searched });
                }
                impulses = found;
                modes = next;
            }
            for _ in 0..SWEEPS {
                self.sweep(limits, &mut loads, &mut impulses);
            }
        }
        self.bound(limits, &mut impulses);
        (impulses * self.least_energy(&impulses), Settling::Unsolved)
    }

    /// The factor from 0 to 1 on impulses that leaves the least kinetic energy. Where rims jam against the ball no impulses
    /// satisfy all conditions, and sweeps grow without bound.
    fn least_energy(&self, impulses: &Impulses) -> f64 {
        let effect = impulses.dot(&(self.coupling * impulses));
        if effect > 0.0 { (-impulses.dot(&self.residual) / effect).clamp(0.0, 1.0) } else { 1.0 }
    }

    fn modes(&self, limits: &Limits, impulses: &Impulses) -> Modes {
        let velocities = self.residual + self.coupling * impulses;
        let required = |row: usize| impulses[row] - velocities[row] / self.coupling[(row, row)];
        std::array::from_fn(|k| {
            let (normal, tangents) = rows_of(k);
            let limit = match normal {
                Some(normal) => {
                    let load = required(normal);
                    if load <= 0.0 {
                        return Mode::Open;
                    }
                    load * if k < 3 { limits.wheels[k] } else { limits.floor }
                }
                None if self.active <= tangents[0] => return Mode::Open,
                None => limits.joint,
            };
            if self.coupling[(tangents[0], tangents[0])] == 0.0 {
                return Mode::Slide([0.0; 2]);
            }
            let x = required(tangents[0]);
            let y = tangents.get(1).map_or(0.0, |&row| required(row));
            let size = x.hypot(y);
            if size <= limit { Mode::Stick } else { Mode::Slide([x / size, y / size]) }
        })
    }

    /// Impulses for given modes: rows that stick or carry have zero velocity. `None` if the system is singular.
    fn solve_modes(&self, limits: &Limits, modes: &Modes) -> Option<Impulses> {
        // Each unknown is the impulse of a row; friction that slides is a fraction of its normal impulse.
        let mut unknowns = [Unknown::default(); ROWS];
        let mut n = 0;
        let mut constants = Impulses::zeros();
        for (k, mode) in modes.iter().enumerate() {
            let (normal, tangents) = rows_of(k);
            if matches!(mode, Mode::Open) {
                continue;
            }
            if let Some(normal) = normal {
                let mut unknown = Unknown::of(normal);
                if let Mode::Slide(direction) = mode {
                    let friction = if k < 3 { limits.wheels[k] } else { limits.floor };
                    for (i, &row) in tangents.iter().enumerate() {
                        unknown.shares[i] = (row, friction * direction[i]);
                    }
                }
                unknowns[n] = unknown;
                n += 1;
            } else if let Mode::Slide([sign, _]) = mode {
                constants[tangents[0]] = limits.joint * sign;
            }
            if matches!(mode, Mode::Stick) {
                for &row in tangents {
                    unknowns[n] = Unknown::of(row);
                    n += 1;
                }
            }
        }
        let unknowns = &unknowns[..n];
        let left = self.residual + self.coupling * constants;
        let mut system = [[0.0; ROWS + 1]; ROWS];
        for (equation, of) in system.iter_mut().zip(unknowns) {
            for (entry, unknown) in equation.iter_mut().zip(unknowns) {
                *entry = self.coupling[(of.row, unknown.row)];
                for &(row, share) in &unknown.shares {
                    *entry += share * self.coupling[(of.row, row)];
                }
            }
            equation[ROWS] = -left[of.row];
        }
        let x = eliminate(&mut system, n)?;
        let mut impulses = constants;
        for (unknown, x) in unknowns.iter().zip(&x) {
            impulses[unknown.row] = *x;
            for &(row, share) in &unknown.shares {
                if share != 0.0 {
                    impulses[row] = share * x;
                }
            }
        }
        Some(impulses)
    }

    /// One projected Gauss-Seidel sweep.
    fn sweep(&self, limits: &Limits, loads: &mut Wheels<f64>, impulses: &mut Impulses) {
        let required = |row: usize, impulses: &Impulses| {
            let velocity = self.residual[row] + self.coupling.row(row).transpose().dot(impulses);
            impulses[row] - velocity / self.coupling[(row, row)]
        };
        for k in 0..7 {
            let (normal, tangents) = rows_of(k);
            let limit = match normal {
                Some(normal) => {
                    impulses[normal] = required(normal, impulses).max(0.0);
                    match loads.0.get_mut(k) {
                        Some(load) => {
                            *load += LOAD_FILTER * (impulses[normal] - *load);
                            limits.wheels[k] * *load
                        }
                        None => limits.floor * impulses[normal],
                    }
                }
                None if self.active <= tangents[0] => continue,
                None => limits.joint,
            };
            for &row in tangents {
                if self.coupling[(row, row)] > 0.0 {
                    impulses[row] = required(row, impulses);
                }
            }
            within(limit, tangents, impulses);
        }
    }

    /// Brings friction within its limits.
    fn bound(&self, limits: &Limits, impulses: &mut Impulses) {
        for k in 0..7 {
            let (normal, tangents) = rows_of(k);
            let limit = normal.map_or(limits.joint, |normal| {
                impulses[normal] = impulses[normal].max(0.0);
                impulses[normal] * if k < 3 { limits.wheels[k] } else { limits.floor }
            });
            within(limit, tangents, impulses);
        }
    }
}

/// Scales the friction of a contact to at most `limit`.
fn within(limit: f64, tangents: &[usize], impulses: &mut Impulses) {
    let size = tangents.iter().map(|&row| impulses[row] * impulses[row]).sum::<f64>().sqrt();
    if size > limit {
        tangents.iter().for_each(|&row| impulses[row] *= limit / size);
    }
}

/// Solution of the first `n` equations, whose right-hand sides are in the last column. `None` if they are singular.
fn eliminate(system: &mut [[f64; ROWS + 1]; ROWS], n: usize) -> Option<SVector<f64, ROWS>> {
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| system[a][k].abs().total_cmp(&system[b][k].abs()))?;
        system.swap(k, pivot);
        let (done, rest) = system.split_at_mut(k + 1);
        let pivot = &done[k];
        if pivot[k] == 0.0 || pivot[k].is_nan() {
            return None;
        }
        for row in &mut rest[..n - k - 1] {
            let share = row[k] / pivot[k];
            for (entry, above) in row[k + 1..n].iter_mut().zip(&pivot[k + 1..n]) {
                *entry -= share * above;
            }
            row[ROWS] -= share * pivot[ROWS];
        }
    }
    let mut x = SVector::zeros();
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| system[k][j] * x[j]).sum();
        x[k] = (system[k][ROWS] - known) / system[k][k];
    }
    Some(x)
}
