//! Derivatives of the model `contact`.

use crate::Jacobian;
use crate::coordinates::{COORDINATES, FORCES, LOADS, along, coordinates, states};
use crate::parameters::Parameter;
use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Cell, Dual, DualCell, Kernel, Lane, Own, Registers, Scalar, Value, Wide, run_directions};
use ballbot_base::params::Params;
use ballbot_base::state::unit_quaternion;
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_contact::{Constants, ContactState, Footing, SolvedStep, advance};
use nalgebra::DMatrix;
use std::sync::Arc;

/// Fraction of a speed that each loss may remove, of a robot with all of them.
const LEAST_LOSS_SHARE: f64 = 0.25;

/// Steps that are differentiated at once; longer motions are joined by the chain rule.
const MOST_STEPS: usize = 64;

/// A moving robot, whose motion is differentiated.
pub struct Differentiated {
    constants: Constants<f64>,
    state: ContactState<f64>,
    ground: Option<Arc<Ground>>,
    /// Derivatives of the constants with respect to each parameter.
    slopes: Vec<Constants<f64>>,
    /// Fraction of a speed that a loss may remove in a step, while derivatives with respect to losses of zero are
    /// computed.
    loss_share: f64,
    states: usize,
}

impl Differentiated {
    /// A robot in a state of its solver. `with_loads` adds the contact forces of the last step to the states, on which
    /// losses depend.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a parameter without derivative: a ripple of zero, and inertia of a body with equal
    /// principal moments.
    pub fn new(
        params: &Params,
        constants: &Constants<f64>,
        state: ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        parameters: &[Parameter],
        with_loads: bool,
    ) -> Result<Self> {
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
            states: states(with_loads),
        })
    }

    /// Advances the robot by `steps` time steps, at least one, under constant motor torques, N·m.
    ///
    /// # Errors
    /// [`Error::Diverged`] if the robot diverges; [`Error::Inconsistent`] if its bot touches the floor or its ball the
    /// body, or a derivative is not finite; [`Error::Interrupted`] in [`ballbot_base::stoppable`].
    pub fn advance(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian> {
        let mut watch = Watch::new();
        let mut whole: Option<Jacobian> = None;
        let mut left = steps;
        while left > 0 {
            watch.check()?;
            let some = left.min(MOST_STEPS);
            let part = self.advance_some(torques, some)?;
            whole = Some(match whole {
                Some(before) => before.followed_by(part),
                None => part,
            });
            left -= some;
        }
        let whole =
            whole.ok_or_else(|| Error::OutOfRange { name: "steps".into(), value: 0.0, limit: "at least 1".into() })?;
        if whole.is_finite() {
            return Ok(whole);
        }
        Err(Error::Inconsistent(format!("a derivative over {steps} steps is not finite: the motion is too sensitive")))
    }

    fn advance_some(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian> {
        let (solved, end, mut jacobian) = self.followed(torques, steps)?;
        run_directions(Passes {
            problem: Problem {
                constants: &self.constants,
                state: &self.state,
                ground: self.ground.as_ref(),
                torques,
                solved: &solved,
                slopes: &self.slopes,
                loss_share: self.loss_share,
            },
            jacobian: &mut jacobian,
        });
        self.state = end;
        Ok(jacobian)
    }

    /// The motion without derivatives: its steps, its end, and a Jacobian whose matrices are zero.
    fn followed(&self, torques: Wheels<f64>, steps: usize) -> Result<(Vec<SolvedStep>, ContactState<f64>, Jacobian)> {
        let (c, ground) = (&self.constants, self.ground.as_ref());
        let mut state = self.state.clone();
        let mut footing = ground.map(Footing::new);
        let (mut margin, mut modes_changed) = (f64::INFINITY, false);
        let mut solved: Vec<SolvedStep> = Vec::with_capacity(steps);
        for _ in 0..steps {
            let time = state.steps * c.sim_dt;
            let step = SolvedStep::new(c, &state, ground, torques).ok_or_else(|| {
                Error::Inconsistent(format!("the contacts at t = {time} s do not determine their forces"))
            })?;
            advance(c, &mut state, footing.as_mut(), torques, 1);
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
        let columns = [self.states, WHEELS, self.slopes.len()];
        let [a, b, p] = columns.map(|columns| DMatrix::zeros(self.states, columns));
        let [by_state, d, q] = columns.map(|columns| DMatrix::zeros(FORCES, columns));
        let kinds = [&solved[0], &solved[steps - 1]].map(SolvedStep::kinds);
        let jacobian = Jacobian {
            a,
            b,
            p,
            c: by_state,
            d,
            q,
            level: ground.is_none(),
            start: self.state.read(c).into(),
            next: state.read(c).into(),
            contacts: state.contacts(c, ground.map(AsRef::as_ref)),
            modes_changed,
            margin,
            kinds,
        };
        Ok((solved, state, jacobian))
    }
}

/// What is differentiated.
struct Problem<'a> {
    constants: &'a Constants<f64>,
    state: &'a ContactState<f64>,
    ground: Option<&'a Arc<Ground>>,
    torques: Wheels<f64>,
    solved: &'a [SolvedStep],
    slopes: &'a [Constants<f64>],
    loss_share: f64,
}

struct Passes<'a, 'b> {
    problem: Problem<'a>,
    jacobian: &'b mut Jacobian,
}

impl Kernel for Passes<'_, '_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        passes::<Wide<S>>(simd, &self.problem, self.jacobian);
    }

    fn run_one_by_one(self) {
        passes::<f64>(Scalar, &self.problem, self.jacobian);
    }
}

/// What changes along a direction.
#[derive(Clone, Copy)]
enum Direction {
    /// A coordinate of the state.
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

/// Differentiates along all directions.
#[inline(always)]
fn passes<L: Lane>(token: L::Token, problem: &Problem<'_>, jacobian: &mut Jacobian) {
    let directions = problem.directions(jacobian.columns());
    for some in directions.chunks(L::Cell::WIDTH) {
        let Moved { value, state, forces } = pass::<L>(token, problem, some);
        for (lane, direction) in some.iter().enumerate() {
            let change = state.map(|cell| cell.derivatives.get(lane));
            let forces = forces.map(|cell| cell.derivatives.get(lane));
            write(jacobian, *direction, &coordinates(&value, &change), &forces);
        }
    }
    take_shortcuts(jacobian, problem);
}

/// Writes a column.
fn write(jacobian: &mut Jacobian, direction: Direction, state: &[f64; COORDINATES], forces: &[f64; FORCES]) {
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

/// The motion with derivatives along some directions.
#[inline(always)]
fn pass<L: Lane>(token: L::Token, problem: &Problem<'_>, directions: &[Direction]) -> Moved<L::Cell> {
    let cell = |value: &f64| DualCell { value: *value, derivatives: L::Cell::default() };
    let start = problem.state.read(problem.constants);
    let mut seeds = start.map(cell);
    let mut state = problem.state.map(cell);
    let mut torques = problem.torques.map(|torque| cell(&torque));
    for (lane, direction) in directions.iter().enumerate() {
        match *direction {
            Direction::State(i) => {
                seeds.zip_mut(&along(&start, i), |cell, slope| cell.derivatives.set(lane, *slope));
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
    let constants = Constants { general: 1.0, loss_share: problem.loss_share, ..problem.constants.clone() };
    if !directions.iter().any(|direction| matches!(direction, Direction::Parameter(_))) {
        return if problem.has_ripple() {
            moved::<L, f64, true>(&constants, token, problem, (seeds, state, torques))
        } else {
            moved::<L, f64, false>(&constants, token, problem, (seeds, state, torques))
        };
    }
    let mut constants = constants.map(cell);
    for (lane, direction) in directions.iter().enumerate() {
        if let Direction::Parameter(i) = *direction {
            constants.zip_mut(&problem.slopes[i], |cell, slope| cell.derivatives.set(lane, *slope));
        }
    }
    moved::<L, Own<Dual<L>>, true>(&constants.owned::<Dual<L>>(token), token, problem, (seeds, state, torques))
}

/// Memory of a robot with derivatives.
type Seeds<C> = (LaneState<DualCell<C>>, ContactState<DualCell<C>>, Wheels<DualCell<C>>);

/// The motion of a robot whose state, memory and torques have derivatives.
#[inline(always)]
fn moved<L: Lane, V: Value<Dual<L>>, const RIPPLE: bool>(
    c: &Constants<V>,
    token: L::Token,
    problem: &Problem<'_>,
    (mut public, mut state, torques): Seeds<L::Cell>,
) -> Moved<L::Cell> {
    state.set_lane_state(c, &public.load::<Dual<L>>(token));
    // The motion starts from the bits of the robot's memory.
    state.zip_mut(problem.state, |cell, value| cell.value = *value);
    let mut footing = problem.ground.map(Footing::new);
    for step in problem.solved {
        step.advance::<L, V, RIPPLE>(c, token, &mut state, footing.as_mut(), &torques);
    }
    public.store(&state.lane_state::<Dual<L>, V>(token, c));
    let impulses = state.impulses::<Dual<L>>(token);
    let rate = problem.constants.sim_dt.recip();
    let [z, x, y] = impulses.floor;
    let ([n0, n1, n2], [d0, d1, d2]) = (impulses.normals.0, impulses.drives.0);
    let mut forces = [DualCell::default(); FORCES];
    for (cell, force) in forces.iter_mut().zip([n0, n1, n2, -d0, -d1, -d2, x, y, z]) {
        (force * rate).store(cell);
    }
    Moved { value: public.map(|cell| cell.value), state: public, forces }
}
