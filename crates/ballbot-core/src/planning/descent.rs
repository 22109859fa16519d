//! One robot's motion over a horizon, and its improvement along its exact derivatives.

use super::horizon::Horizon;
use crate::control::{Controller, LEAST_LOAD, LaneSetpoint, Setpoint};
use crate::models::linear::STATES;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Dual, DualCell, Scalar, run_one};
use ballbot_base::params::Params;
use ballbot_base::state::{Contacts, State};
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_contact::{Constants, ContactState, advance};
use ballbot_gradients::{Coordinates, Differentiated, ROLLING, along_rolling, rolling_change};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Number of coordinates of a rolling robot.
const N: usize = ROLLING.len();
/// Limits of a wheel: its traction one way, the other way, and its least load.
const LIMITS: usize = 3 * WHEELS;
/// Damping of the torques' Hessian, as a fraction of its trace, until the cost falls.
const DAMPING: [f64; 3] = [1e-6, 1e-2, 1.0];
/// Fractions of a change that are tried.
const FRACTIONS: [f64; 4] = [1.0, 0.5, 0.25, 0.0625];
/// Least decrease of the cost, as a fraction of the expected decrease.
const DECREASE: f64 = 0.1;
/// Expected decrease, as a fraction of the cost, below which nothing is left to improve.
const CONVERGED: f64 = 1e-3;
/// Cost below which the motion is not improved; a deviation of the regulator's weights costs 1 at each decision.
const NEGLIGIBLE: f64 = 0.01;
/// Most steps of the search for the best torques within their limits.
const MAX_SEARCH: usize = 20;

type Change = SVector<f64, N>;
type Square = SMatrix<f64, N, N>;

/// The robot, the law that a plan changes, and the cost of a motion.
#[derive(Debug)]
pub(super) struct Problem {
    horizon: Horizon,
    params: Params,
    wheels: Omniwheels,
    constants: Constants<f64>,
    /// Time steps of the simulation from one decision to the next.
    substeps: usize,
    /// Largest traction over load.
    friction: f64,
    /// Least load of each wheel, N.
    least: Wheels<f64>,
    /// Weight of squared violations, 1/N².
    weight: f64,
}

impl Problem {
    /// `traction` is the fraction of friction that wheels may use, `violation` the violation of weight 1, as a fraction of
    /// a wheel's load in equilibrium.
    pub(super) fn new(params: &Params, horizon: Horizon, step: f64, traction: Option<f64>, violation: f64) -> Self {
        // How the floor and a payload will move, and where the floor is slippery, is unknown to a plan.
        let params = &params.on_still_floor().with_payloads_fixed();
        let substeps = (horizon.control_dt / step - 1e-9).ceil().max(1.0) as usize;
        let loads = params.equilibrium_wheel_loads();
        let mean = loads.iter().sum::<f64>() / WHEELS as f64;
        Self {
            wheels: Omniwheels::new(params),
            constants: Constants::new(params, horizon.control_dt / substeps as f64),
            substeps,
            friction: traction.unwrap_or(1.0) * params.wheel_dynamic_friction,
            least: Wheels::from_fn(|i| LEAST_LOAD * loads[i]),
            weight: if traction.is_some() { (violation * mean).powi(-2) } else { 0.0 },
            params: params.clone(),
            horizon,
        }
    }

    /// A state of rolling on a level floor with the attitude, velocities and place of a robot that the regulator feeds back.
    fn rolling(&self, state: &State) -> State {
        let State { ball_position: place, ball_velocity, ball_angular_velocity, .. } = state;
        let (params, wheels) = (&self.params, &self.wheels);
        let (attitude, rate) = (state.body_quaternion, state.body_angular_velocity);
        let mut rolling =
            State::rolling_on(params, wheels, ball_velocity.xy(), ball_angular_velocity.z, attitude, rate);
        for position in [&mut rolling.ball_position, &mut rolling.body_position] {
            position.x = place.x;
            position.y = place.y;
        }
        rolling
    }

    /// Torques near `desired` within the limits.
    pub(super) fn limited(
        &self,
        regulator: Wheels<f64>,
        desired: Wheels<f64>,
        state: &LaneState<f64>,
        largest: f64,
    ) -> Wheels<f64> {
        run_one(
            #[inline(always)]
            || self.horizon.limits.nearest(regulator, desired, state, largest),
        )
    }

    /// How far limits are violated by the contact forces of a step, N.
    fn violations(&self, contacts: &Contacts) -> [f64; LIMITS] {
        std::array::from_fn(|k| {
            let (wheel, kind) = (k / 3, k % 3);
            let (load, traction) = (contacts.wheel_normal_forces[wheel], contacts.wheel_tractions[wheel]);
            let beyond = match kind {
                0 => traction - self.friction * load,
                1 => -traction - self.friction * load,
                _ => self.least[wheel] - load,
            };
            beyond.max(0.0)
        })
    }

    /// The derivative of a violation by the forces of its wheel: by load and traction.
    fn slopes(&self, kind: usize) -> [f64; 2] {
        match kind {
            0 => [-self.friction, 1.0],
            1 => [-self.friction, -1.0],
            _ => [-1.0, 0.0],
        }
    }
}

/// A decision of a motion.
#[derive(Clone, Debug)]
struct Stage {
    start: ContactState<f64>,
    state: LaneState<f64>,
    /// Deviation from the setpoint.
    x: SVector<f64, STATES>,
    /// Torques of the setpoint's motion.
    reference: Vector3<f64>,
    /// Torques of the regulator.
    regulator: Vector3<f64>,
    torques: Vector3<f64>,
    /// Violations in the last time step before the next decision.
    violations: SVector<f64, LIMITS>,
}

/// A motion, up to its end or to a fall.
#[derive(Clone, Debug, Default)]
struct Motion {
    /// Its decisions, and the state at the end.
    stages: Vec<Stage>,
}

impl Motion {
    /// Number of decisions.
    fn len(&self) -> usize {
        self.stages.len().saturating_sub(1)
    }

    fn cost(&self, problem: &Problem) -> f64 {
        let objective = &problem.horizon.objective;
        let (last, stages) = self.stages.split_last().expect("the state at the end");
        let along: f64 = stages
            .iter()
            .map(|stage| {
                let states: f64 = stage.x.iter().zip(&objective.states).map(|(x, weight)| weight * x * x).sum();
                states
                    + objective.torques * (stage.torques - stage.reference).norm_squared()
                    + problem.weight * stage.violations.norm_squared()
            })
            .sum();
        along + last.x.dot(&(to_go(problem) * last.x))
    }
}

fn to_go(problem: &Problem) -> SMatrix<f64, STATES, STATES> {
    let rows = &problem.horizon.objective.to_go;
    SMatrix::from_fn(|i, j| rows[i][j])
}

/// The cost near a decision, and the derivatives of what follows: half the second-order expansion.
#[derive(Clone, Debug)]
struct Expansion {
    a: Square,
    b: SMatrix<f64, N, 3>,
    x: Change,
    xx: Square,
    u: Vector3<f64>,
    uu: Matrix3<f64>,
    ux: SMatrix<f64, 3, N>,
}

/// Changes of the torques of a motion, and feedback on changes of its states.
#[derive(Clone, Debug, Default)]
struct Sweep {
    changes: Vec<Vector3<f64>>,
    gains: Vec<SMatrix<f64, 3, N>>,
    /// First and second order of the expected change of half the cost.
    expected: [f64; 2],
}

/// Workspace of a call.
#[derive(Debug)]
pub(super) struct Descent {
    setpoints: Vec<Setpoint>,
    best: Motion,
    trial: Motion,
    expansions: Vec<Expansion>,
    sweep: Sweep,
}

impl Descent {
    pub(super) fn new(problem: &Problem) -> Self {
        let decisions = problem.horizon.decisions;
        Self {
            setpoints: Vec::with_capacity(decisions + 1),
            best: Motion { stages: Vec::with_capacity(decisions + 1) },
            trial: Motion { stages: Vec::with_capacity(decisions + 1) },
            expansions: Vec::with_capacity(decisions),
            sweep: Sweep::default(),
        }
    }

    /// Improves a plan, torques that are added to the regulator's at each decision.
    pub(super) fn improve(
        &mut self,
        problem: &Problem,
        state: &State,
        setpoint: &Setpoint,
        largest: f64,
        iterations: usize,
        plan: &mut [f64],
    ) {
        let Horizon { base, decisions, limits, .. } = &problem.horizon;
        let (near, bound) = (base.within_reach(state, setpoint), largest.min(limits.max_torque()));
        let state = &problem.rolling(state);
        self.setpoints.clear();
        self.setpoints.extend((0..=*decisions).map(|decision| problem.horizon.ahead(&near, decision)));
        let setpoints = &self.setpoints;
        let limited = |stage: &Stage, desired: Vector3<f64>| {
            let [regulator, desired] = [stage.regulator, desired].map(|torques| Wheels(torques.into()));
            Vector3::from(problem.limited(regulator, desired, &stage.state, largest).0)
        };
        let start = ContactState::at(&problem.constants, &problem.wheels, None, state);
        let (best, trial) = (&mut self.best, &mut self.trial);
        simulate(problem, setpoints, &start, largest, *decisions, best, |k, stage| {
            limited(stage, stage.regulator + Vector3::from_column_slice(&plan[WHEELS * k..][..WHEELS]))
        });
        simulate(problem, setpoints, &start, largest, *decisions, trial, |_, stage| stage.regulator);
        let stages = self.best.len().max(self.trial.len());
        if self.best.len() < stages
            || (self.trial.len() == stages && self.trial.cost(problem) < self.best.cost(problem))
        {
            std::mem::swap(&mut self.best, &mut self.trial);
        }
        if stages == 0 {
            plan.fill(0.0);
            return;
        }
        let mut cost = self.best.cost(problem);
        for _ in 0..iterations {
            if cost <= NEGLIGIBLE || !expand(problem, setpoints, &self.best, &mut self.expansions) {
                break;
            }
            let mut improved = false;
            for damping in DAMPING {
                if !sweep(problem, setpoints, &self.best, &self.expansions, bound, damping, &mut self.sweep) {
                    continue;
                }
                let Sweep { changes, gains, expected: [first, second] } = &self.sweep;
                if -2.0 * (first + second) <= CONVERGED * cost {
                    break;
                }
                let before = &self.best;
                for fraction in FRACTIONS {
                    simulate(problem, setpoints, &start, largest, stages, &mut self.trial, |k, stage| {
                        let from = &before.stages[k];
                        let change = Change::from(rolling_change(&from.state, &stage.state));
                        limited(stage, from.torques + changes[k] * fraction + gains[k] * change)
                    });
                    let expected = -2.0 * (fraction * first + fraction * fraction * second);
                    if self.trial.len() < stages {
                        continue;
                    }
                    let new = self.trial.cost(problem);
                    if cost - new >= DECREASE * expected {
                        (improved, cost) = (true, new);
                        break;
                    }
                }
                if improved {
                    std::mem::swap(&mut self.best, &mut self.trial);
                    break;
                }
            }
            if !improved {
                break;
            }
        }
        plan.fill(0.0);
        for (stage, planned) in self.best.stages[..stages].iter().zip(plan.chunks_exact_mut(WHEELS)) {
            planned.copy_from_slice((stage.torques - stage.regulator).as_slice());
        }
    }
}

/// Simulates `decisions` decisions of a law, or fewer if the robot falls.
fn simulate(
    problem: &Problem,
    setpoints: &[Setpoint],
    start: &ContactState<f64>,
    largest: f64,
    decisions: usize,
    motion: &mut Motion,
    law: impl Fn(usize, &Stage) -> Vector3<f64>,
) {
    let (c, base) = (&problem.constants, &problem.horizon.base);
    motion.stages.clear();
    let mut now = start.clone();
    for (k, setpoint) in setpoints.iter().enumerate().take(decisions + 1) {
        let state = now.read(c);
        let setpoint = LaneSetpoint::from(setpoint);
        let (x, reference) = run_one(
            #[inline(always)]
            || base.lane_deviation(&state, &setpoint),
        );
        let mut stage = Stage {
            start: now.clone(),
            state,
            x: x.into(),
            reference: reference.0.into(),
            regulator: Vector3::zeros(),
            torques: Vector3::zeros(),
            violations: SVector::zeros(),
        };
        if k < decisions {
            stage.regulator = base.torques_one(&stage.state, &setpoint, largest, &mut []).0.into();
            stage.torques = law(k, &stage);
            advance(c, &mut now, None, Wheels(stage.torques.into()), problem.substeps);
            stage.violations = problem.violations(&now.contacts(c, None)).into();
        }
        motion.stages.push(stage);
        if now.diverged > 0.0 || now.bot_on_floor > 0.0 {
            return;
        }
    }
}

/// The derivatives of a motion; false if it has none.
fn expand(problem: &Problem, setpoints: &[Setpoint], motion: &Motion, out: &mut Vec<Expansion>) -> bool {
    let objective = &problem.horizon.objective;
    let start = motion.stages[0].start.clone();
    let new = Differentiated::new(&problem.params, &problem.constants, start, None, &[], Coordinates::All);
    let Ok(mut robot) = new else { return false };
    out.clear();
    for (stage, setpoint) in motion.stages.iter().zip(setpoints).take(motion.len()) {
        let torques = Wheels(stage.torques.into());
        let Ok(rolling) = robot.advance_rolling(torques, problem.substeps, &problem.params) else { return false };
        let by_state = deviation_by_change(problem, &stage.state, setpoint);
        let weighted = SMatrix::<f64, STATES, N>::from_fn(|i, j| objective.states[i] * by_state[(i, j)]);
        let mut expansion = Expansion {
            a: rolling.a.fixed_view::<N, N>(0, 0).into_owned(),
            b: rolling.b.fixed_view::<N, 3>(0, 0).into_owned(),
            x: weighted.tr_mul(&stage.x),
            xx: weighted.tr_mul(&by_state),
            u: objective.torques * (stage.torques - stage.reference),
            uu: Matrix3::from_diagonal_element(objective.torques),
            ux: SMatrix::zeros(),
        };
        for (k, violation) in stage.violations.iter().enumerate().filter(|(_, violation)| **violation > 0.0) {
            let (wheel, [by_load, by_traction]) = (k / 3, problem.slopes(k % 3));
            // Rows of the forces: normals, then tractions.
            let (c, d) = (&rolling.c, &rolling.d);
            let x = (c.row(wheel) * by_load + c.row(WHEELS + wheel) * by_traction).transpose();
            let x = Change::from_column_slice(x.as_slice());
            let u = (d.row(wheel) * by_load + d.row(WHEELS + wheel) * by_traction).transpose();
            let u = Vector3::from_column_slice(u.as_slice());
            let weight = problem.weight;
            expansion.x += x * (weight * violation);
            expansion.u += u * (weight * violation);
            expansion.xx += x * x.transpose() * weight;
            expansion.uu += u * u.transpose() * weight;
            expansion.ux += u * x.transpose() * weight;
        }
        out.push(expansion);
    }
    true
}

/// The deviation from a setpoint by changes of a rolling robot.
fn deviation_by_change(problem: &Problem, state: &LaneState<f64>, setpoint: &Setpoint) -> SMatrix<f64, STATES, N> {
    let setpoint = LaneSetpoint::from(setpoint).map(|value| DualCell { value: *value, derivatives: 0.0 });
    let mut out = SMatrix::<f64, STATES, N>::zeros();
    for coordinate in 0..N {
        let moved = along_rolling(state, coordinate);
        let (x, _) = run_one(
            #[inline(always)]
            || {
                let (state, setpoint) = (moved.load::<Dual<f64>>(Scalar), setpoint.load::<Dual<f64>>(Scalar));
                problem.horizon.base.lane_deviation(&state, &setpoint)
            },
        );
        let slopes = SVector::<f64, STATES>::from(x.map(|dual: Dual<f64>| dual.derivatives));
        out.set_column(coordinate, &slopes);
    }
    out
}

/// The backward sweep, with torques up to `bound`; false if the Hessian of the torques is not positive definite.
fn sweep(
    problem: &Problem,
    setpoints: &[Setpoint],
    motion: &Motion,
    expansions: &[Expansion],
    bound: f64,
    damping: f64,
    out: &mut Sweep,
) -> bool {
    let stages = motion.len();
    let last = &motion.stages[stages];
    let by_state = deviation_by_change(problem, &last.state, &setpoints[stages]);
    let weighted = to_go(problem) * by_state;
    let (mut vx, mut vxx) = (weighted.tr_mul(&last.x), weighted.tr_mul(&by_state));
    out.changes.resize(stages, Vector3::zeros());
    out.gains.resize(stages, SMatrix::zeros());
    let [mut first, mut second] = [0.0, 0.0];
    for k in (0..stages).rev() {
        let Expansion { a, b, x, xx, u, uu, ux } = &expansions[k];
        let (va, vb) = (vxx * a, vxx * b);
        let (qx, qu) = (x + a.tr_mul(&vx), u + b.tr_mul(&vx));
        let (qxx, qux, quu) = (xx + a.tr_mul(&va), ux + b.tr_mul(&va), uu + b.tr_mul(&vb));
        let damped = quu + Matrix3::from_diagonal_element(damping * quu.trace());
        let torques = motion.stages[k].torques;
        let (low, high) = (torques.map(|t| (-bound - t).min(0.0)), torques.map(|t| (bound - t).max(0.0)));
        let Some((change, free)) = within(&damped, &qu, &low, &high) else { return false };
        let Some(factor) = masked(&damped, &free).cholesky() else { return false };
        let mut pull = qux;
        for (wheel, free) in free.iter().enumerate() {
            if !free {
                pull.row_mut(wheel).fill(0.0);
            }
        }
        let gain = -factor.solve(&pull);
        first += change.dot(&qu);
        second += 0.5 * change.dot(&(quu * change));
        vx = qx + gain.tr_mul(&(quu * change + qu)) + qux.tr_mul(&change);
        let mixed = gain.tr_mul(&qux);
        vxx = qxx + gain.tr_mul(&(quu * gain)) + mixed + mixed.transpose();
        vxx = (vxx + vxx.transpose()) * 0.5;
        (out.changes[k], out.gains[k]) = (change, gain);
    }
    out.expected = [first, second];
    [first, second].iter().all(|number| number.is_finite())
}

/// The minimum of xᵀ H x / 2 + gᵀ x within limits around zero by projected Newton steps, and which components are free;
/// `None` if H is not positive definite.
fn within(
    hessian: &Matrix3<f64>,
    gradient: &Vector3<f64>,
    low: &Vector3<f64>,
    high: &Vector3<f64>,
) -> Option<(Vector3<f64>, [bool; 3])> {
    let mut x = Vector3::zeros();
    let mut free = [true; 3];
    for _ in 0..MAX_SEARCH {
        let slope = gradient + hessian * x;
        free = std::array::from_fn(|i| !((x[i] <= low[i] && slope[i] > 0.0) || (x[i] >= high[i] && slope[i] < 0.0)));
        let pull = Vector3::from_fn(|i, _| if free[i] { -slope[i] } else { 0.0 });
        let step = masked(hessian, &free).cholesky()?.solve(&pull);
        let better = FRACTIONS.iter().find_map(|fraction| {
            let new = (x + step * *fraction).zip_zip_map(low, high, f64::clamp);
            let change = new - x;
            let less = slope.dot(&change) + 0.5 * change.dot(&(hessian * change));
            (less < -1e-12 * gradient.dot(&x).abs() && less < 0.0).then_some(new)
        });
        match better {
            Some(new) if (new - x).amax() > 1e-12 * (high - low).amax() => x = new,
            _ => break,
        }
    }
    Some((x, free))
}

/// A Hessian of the free components, with the identity for the others.
fn masked(hessian: &Matrix3<f64>, free: &[bool; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| match (free[i] && free[j], i == j) {
        (true, _) => hessian[(i, j)],
        (false, true) => 1.0,
        (false, false) => 0.0,
    })
}
