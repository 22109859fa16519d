//! Derivatives of the model `contact`.

use crate::coordinates::{COORDINATES, Coordinates, FORCES, LOADS, along, coordinates};
use crate::parameters::Parameter;
use crate::rolling;
use crate::{Differentiable, Jacobian, MOST_STEPS, RollingJacobian, too_sensitive};
use ballbot_base::error::{Error, Result};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{
    Cell, Directions, Dual, DualCell, Kernel, Lane, Own, Registers, SIXTEEN, Scalar, Slopes, Value, run_eight,
};
use ballbot_base::params::Params;
use ballbot_base::state::unit_quaternion;
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_contact::{Constants, ContactState, Footing, SolvedStep, advance};
use nalgebra::DMatrix;
use std::sync::Arc;

/// Fraction of a speed that each loss may remove, of a robot with all of them.
const LEAST_LOSS_SHARE: f64 = 0.25;

/// A robot of the model `contact`, whose motion is differentiated.
pub struct Differentiated {
    constants: Constants<f64>,
    state: ContactState<f64>,
    ground: Option<Arc<Ground>>,
    /// Derivatives of the constants with respect to each parameter.
    slopes: Vec<Constants<f64>>,
    /// Fraction of a speed that a loss may remove in a step, while derivatives with respect to losses of zero are
    /// computed.
    loss_share: f64,
    coordinates: Coordinates,
}

impl Differentiated {
    /// A robot in a state of its solver.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a parameter without derivative: a ripple of zero, and inertia of a body with equal
    /// principal moments; for a payload, for a floor that moves, for floor friction that differs from place to place, and for
    /// obstacles.
    pub fn new(
        params: &Params,
        constants: &Constants<f64>,
        state: ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Self> {
        params.require_no_payload("derivatives of motions")?;
        params.require_still_floor("derivatives of motions")?;
        params.require_even_friction("derivatives of motions")?;
        Ground::require_no_obstacles(ground, "derivatives of motions")?;
        let slopes = parameters.iter().map(|parameter| parameter.slopes(params, constants.sim_dt));
        Ok(Self {
            constants: constants.clone(),
            state,
            ground: ground.cloned(),
            slopes: slopes.collect::<Result<_>>()?,
            loss_share: match constants.loss_share {
                0.0 if parameters.iter().any(Parameter::is_loss) => LEAST_LOSS_SHARE,
                share => share,
            },
            coordinates,
        })
    }

    /// [`Jacobian::rolling`] of [`Differentiable::advance`], in half the time: it differentiates only along what it needs.
    /// `params` are the robot's.
    ///
    /// # Errors
    /// As [`Differentiable::advance`] and [`Jacobian::rolling`].
    pub fn advance_rolling(&mut self, torques: Wheels<f64>, steps: usize, params: &Params) -> Result<RollingJacobian> {
        if self.ground.is_some() || !(1..=MOST_STEPS).contains(&steps) {
            return self.advance(torques, steps)?.rolling(params);
        }
        let Followed { solved, end, .. } = self.followed(torques, steps)?;
        let start = self.state.read(&self.constants);
        let lift = rolling::lift(params, &start.into());
        let changes: Vec<_> = lift
            .column_iter()
            .skip(rolling::SHORTCUTS)
            .map(|column| {
                let mut change = LaneState::default();
                for (coordinate, slope) in column.iter().enumerate().filter(|(_, slope)| **slope != 0.0) {
                    change.zip_mut(&along(&start, coordinate), |sum, number| *sum += slope * number);
                }
                change
            })
            .collect();
        let directions = (0..changes.len()).map(Direction::State).chain((0..WHEELS).map(Direction::Torque));
        let columns = self.problem(torques, &solved, &changes).columns(&directions.collect::<Vec<_>>());
        self.state = end;
        let jacobian = RollingJacobian::of(&columns);
        if jacobian.is_finite() {
            return Ok(jacobian);
        }
        Err(too_sensitive(steps))
    }

    fn problem<'a>(
        &'a self,
        torques: Wheels<f64>,
        solved: &'a [SolvedStep],
        changes: &'a [LaneState<f64>],
    ) -> Problem<'a> {
        Problem {
            constants: &self.constants,
            state: &self.state,
            ground: self.ground.as_ref(),
            torques,
            solved,
            changes,
            slopes: &self.slopes,
            loss_share: self.loss_share,
            all_rows: self.all_rows(),
        }
    }

    /// Whether steps need the rows of wheel joints, rims and inclined rollers.
    fn all_rows(&self) -> bool {
        let of_joints = |c: &Constants<f64>| c.joint_dry_impulse != 0.0 || c.joint_viscous_impulse != 0.0;
        self.constants.has_rollers()
            || of_joints(&self.constants)
            || self.slopes.iter().any(|slopes| of_joints(slopes) || inclines(slopes))
    }

    /// The motion without derivatives.
    fn followed(&self, torques: Wheels<f64>, steps: usize) -> Result<Followed> {
        let (c, ground) = (&self.constants, self.ground.as_ref());
        let mut state = self.state.clone();
        let mut footing = ground.map(Footing::new);
        let (mut margin, mut modes_changed) = (f64::INFINITY, false);
        let mut solved: Vec<SolvedStep> = Vec::with_capacity(steps);
        let all_rows = self.all_rows();
        for _ in 0..steps {
            let time = state.steps * c.sim_dt;
            let step = SolvedStep::new(c, &state, ground, torques, all_rows).ok_or_else(|| {
                Error::Inconsistent(format!("the contacts at t = {time} s do not determine their forces"))
            })?;
            match step.end() {
                Some(end) => state.clone_from(end),
                None => advance(c, &mut state, footing.as_mut(), torques, 1),
            }
            if state.diverged > 0.0 {
                return Err(Error::Diverged { time, reason: "the next state is not finite".into() });
            }
            if !step.led_to(&state) {
                return Err(Error::Inconsistent(format!(
                    "at t = {time} s the bot touches the floor or the ball its body: these contacts are solved by \
                     iteration and have no derivatives"
                )));
            }
            margin = margin.min(step.margin);
            modes_changed |= solved.last().is_some_and(|before| !step.has_modes_of(before));
            solved.push(step);
        }
        Ok(Followed { solved, end: state, modes_changed, margin })
    }
}

impl Differentiable for Differentiated {
    fn advance_some(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian> {
        let followed = self.followed(torques, steps)?;
        let start = self.state.read(&self.constants);
        let changes: Vec<_> = (0..COORDINATES).map(|coordinate| along(&start, coordinate)).collect();
        let problem = self.problem(torques, &followed.solved, &changes);
        let counts = [self.coordinates.count(), WHEELS, self.slopes.len()];
        let directions = problem.directions(counts);
        let columns = problem.columns(&directions);
        let [a, b, p] = counts.map(|count| DMatrix::zeros(counts[0], count));
        let [c, d, q] = counts.map(|count| DMatrix::zeros(FORCES, count));
        let ground = self.ground.as_deref();
        let mut jacobian = Jacobian {
            a,
            b,
            p,
            c,
            d,
            q,
            coordinates: self.coordinates,
            level: ground.is_none(),
            start: start.into(),
            next: followed.end.read(&self.constants).into(),
            contacts: followed.end.contacts(&self.constants, ground),
            modes_changed: followed.modes_changed,
            margin: followed.margin,
            kinds: Some([&followed.solved[0], &followed.solved[steps - 1]].map(SolvedStep::kinds)),
        };
        for (direction, column) in directions.iter().zip(&columns) {
            write(&mut jacobian, *direction, column);
        }
        take_shortcuts(&mut jacobian, &problem);
        self.state = followed.end;
        Ok(jacobian)
    }
}

/// A motion without derivatives: its steps and its end.
struct Followed {
    solved: Vec<SolvedStep>,
    end: ContactState<f64>,
    modes_changed: bool,
    margin: f64,
}

/// What is differentiated.
struct Problem<'a> {
    constants: &'a Constants<f64>,
    state: &'a ContactState<f64>,
    ground: Option<&'a Arc<Ground>>,
    torques: Wheels<f64>,
    solved: &'a [SolvedStep],
    /// Changes of the state of [`Direction::State`].
    changes: &'a [LaneState<f64>],
    slopes: &'a [Constants<f64>],
    loss_share: f64,
    all_rows: bool,
}

/// Derivatives along a direction: of the state and of the contact forces of the last step.
pub(crate) struct Column {
    pub(crate) state: [f64; COORDINATES],
    pub(crate) forces: [f64; FORCES],
}

/// A pass along some directions, with parameters among them or without, with the rows of wheel joints and rims (`ALL`) or
/// without. Each is a separate kernel: one for all would take minutes longer to compile.
struct Passes<'a, const PARAMETERS: bool, const ALL: bool> {
    problem: &'a Problem<'a>,
    directions: &'a [Direction],
    columns: &'a mut Vec<Column>,
}

impl<const PARAMETERS: bool, const ALL: bool> Kernel for Passes<'_, PARAMETERS, ALL> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        self.along_all::<Directions<S>>(simd);
    }

    fn run_one_by_one(self) {
        self.along_all::<f64>(Scalar);
    }
}

/// What changes along a direction.
#[derive(Clone, Copy)]
enum Direction {
    /// A change of the state.
    State(usize),
    /// A force of the last step, of [`LOADS`].
    Load(usize),
    Torque(usize),
    Parameter(usize),
}

impl Problem<'_> {
    /// The directions that need a pass, parameters last.
    fn directions(&self, [states, torques, parameters]: [usize; 3]) -> Vec<Direction> {
        let coordinates = (0..COORDINATES).filter(|i| !self.is_shortcut(*i)).map(Direction::State);
        coordinates
            .chain((COORDINATES..states).map(|i| Direction::Load(i - COORDINATES)))
            .chain((0..torques).map(Direction::Torque))
            .chain((0..parameters).map(Direction::Parameter))
            .collect()
    }

    /// The derivatives along some directions.
    fn columns(&self, directions: &[Direction]) -> Vec<Column> {
        let mut columns = Vec::with_capacity(directions.len());
        for directions in directions.chunks(SIXTEEN) {
            let columns = &mut columns;
            let parameters = directions.iter().any(|direction| matches!(direction, Direction::Parameter(_)));
            match (parameters, self.all_rows) {
                (true, _) => run_eight(Passes::<true, true> { problem: self, directions, columns }),
                (false, true) => run_eight(Passes::<false, true> { problem: self, directions, columns }),
                (false, false) => run_eight(Passes::<false, false> { problem: self, directions, columns }),
            }
        }
        columns
    }

    /// Whether the column of a coordinate follows without a pass.
    fn is_shortcut(&self, coordinate: usize) -> bool {
        match coordinate {
            // Level ground is the same everywhere.
            0 | 1 => self.ground.is_none(),
            // The attitude of the ball acts on nothing, and so do the angles of round wheels.
            3..6 => true,
            12..15 => !self.has_ripple(),
            _ => false,
        }
    }

    fn has_ripple(&self) -> bool {
        self.constants.ripple_amplitude > 0.0
    }
}

impl<const PARAMETERS: bool, const ALL: bool> Passes<'_, PARAMETERS, ALL> {
    /// Differentiates along all directions.
    #[inline(always)]
    fn along_all<D: Slopes>(self, token: D::Token) {
        for some in self.directions.chunks(D::Cell::WIDTH) {
            let Moved { value, state, forces } = pass::<D, PARAMETERS, ALL>(token, self.problem, some);
            self.columns.extend((0..some.len()).map(|lane| Column {
                state: coordinates(&value, &state.map(|cell| cell.derivatives.get(lane))),
                forces: forces.map(|cell| cell.derivatives.get(lane)),
            }));
        }
    }
}

/// Writes a column.
fn write(jacobian: &mut Jacobian, direction: Direction, Column { state, forces }: &Column) {
    let Jacobian { a, b, p, c, d, q, .. } = jacobian;
    let (of_state, of_forces, column) = match direction {
        Direction::State(i) => (a, c, i),
        Direction::Load(i) => (a, c, COORDINATES + i),
        Direction::Torque(i) => (b, d, i),
        Direction::Parameter(i) => (p, q, i),
    };
    let loads = LOADS.map(|force| forces[force]);
    for (place, value) in of_state.column_mut(column).iter_mut().zip(state.iter().chain(&loads)) {
        *place = *value;
    }
    of_forces.column_mut(column).copy_from_slice(forces);
}

/// Writes the columns that need no pass.
fn take_shortcuts(jacobian: &mut Jacobian, problem: &Problem<'_>) {
    let start = problem.state.ball_quaternion;
    let start = unit_quaternion("ball_quaternion", start).unwrap_or_default();
    let turned = (jacobian.next.ball_quaternion * start.inverse()).to_rotation_matrix();
    let Jacobian { a, c, .. } = jacobian;
    for i in (0..COORDINATES).filter(|i| problem.is_shortcut(*i)) {
        match i {
            0 | 1 => {
                // Ball and body moved together.
                let (of_state, of_forces) = (-a.column(i + 6), -c.column(i + 6));
                a.set_column(i, &of_state);
                c.set_column(i, &of_forces);
                a[(i, i)] += 1.0;
                a[(i + 6, i)] += 1.0;
            }
            3..6 => (0..3).for_each(|row| a[(3 + row, i)] = turned[(row, i - 3)]),
            _ => a[(i, i)] = 1.0,
        }
    }
}

/// The end of a motion.
struct Moved<C> {
    value: LaneState<f64>,
    state: LaneState<DualCell<C>>,
    forces: [DualCell<C>; FORCES],
}

/// Whether the derivatives are with respect to the angle of the rollers, at which they may not be inclined.
fn inclines(slopes: &Constants<f64>) -> bool {
    slopes.roller_axis != [0.0; 2]
}

/// The motion with derivatives along some directions.
#[inline(always)]
fn pass<D: Slopes, const PARAMETERS: bool, const ALL: bool>(
    token: D::Token,
    problem: &Problem<'_>,
    directions: &[Direction],
) -> Moved<D::Cell> {
    let cell = |value: &f64| DualCell { value: *value, derivatives: D::Cell::default() };
    let start = problem.state.read(problem.constants);
    let mut seeds = start.map(cell);
    let mut state = problem.state.map(cell);
    let mut torques = problem.torques.map(|torque| cell(&torque));
    for (lane, direction) in directions.iter().enumerate() {
        match *direction {
            Direction::State(i) => {
                seeds.zip_mut(&problem.changes[i], |cell, slope| cell.derivatives.set(lane, *slope));
            }
            Direction::Load(i) => {
                // The floor's impulse is normal, x and y.
                let impulse = match LOADS[i] {
                    wheel if wheel < WHEELS => &mut state.normal_impulses[wheel],
                    axis => &mut state.floor_impulse[(axis - 2 * WHEELS + 1) % 3],
                };
                impulse.derivatives.set(lane, problem.constants.sim_dt);
            }
            Direction::Torque(i) => torques[i].derivatives.set(lane, 1.0),
            Direction::Parameter(_) => {}
        }
    }
    // Bodies of all kinds have the same derivatives.
    let mut constants = Constants { general: 1.0, loss_share: problem.loss_share, ..problem.constants.clone() };
    if problem.slopes.iter().any(|slopes| slopes.preload_impulse != 0.0) {
        constants.has_preload = 1.0;
    }
    if problem.slopes.iter().any(inclines) {
        constants.inclined = 1.0;
    }
    if !PARAMETERS {
        return moved::<D, f64, ALL>(&constants, token, problem, (seeds, state, torques));
    }
    let mut constants = constants.map(cell);
    for (lane, direction) in directions.iter().enumerate() {
        if let Direction::Parameter(i) = *direction {
            constants.zip_mut(&problem.slopes[i], |cell, slope| cell.derivatives.set(lane, *slope));
        }
    }
    moved::<D, Own<Dual<D>>, ALL>(&constants.owned::<Dual<D>>(token), token, problem, (seeds, state, torques))
}

/// Memory of a robot with derivatives.
type Seeds<C> = (LaneState<DualCell<C>>, ContactState<DualCell<C>>, Wheels<DualCell<C>>);

/// The motion of a robot whose state, memory and torques have derivatives.
#[inline(always)]
fn moved<D: Slopes, V: Value<Dual<D>>, const ALL: bool>(
    c: &Constants<V>,
    token: D::Token,
    problem: &Problem<'_>,
    (mut public, mut state, torques): Seeds<D::Cell>,
) -> Moved<D::Cell> {
    state.set_lane_state(c, &public.load::<Dual<D>>(token));
    // The motion starts from the bits of the robot's memory.
    state.zip_mut(problem.state, |cell, value| cell.value = *value);
    let mut footing = problem.ground.map(Footing::new);
    for step in problem.solved {
        step.advance::<D, V, ALL>((c, problem.constants), token, &mut state, footing.as_mut(), &torques);
    }
    public.store(&state.lane_state::<Dual<D>, V>(token, c));
    let impulses = state.impulses::<Dual<D>>(token);
    let rate = problem.constants.sim_dt.recip();
    let [z, x, y] = impulses.floor;
    let ([n0, n1, n2], [d0, d1, d2]) = (impulses.normals.0, impulses.drives.0);
    let mut forces = [DualCell::default(); FORCES];
    for (cell, force) in forces.iter_mut().zip([n0, n1, n2, -d0, -d1, -d2, x, y, z]) {
        (force * rate).store(cell);
    }
    Moved { value: public.map(|cell| cell.value), state: public, forces }
}
