//! Derivatives of the closed-form models, which roll without slip and have no modes.

use crate::coordinates::{Coordinates, FORCES, INDEPENDENT};
use crate::parameters::{Parameter, WEIGHTS};
use crate::{Differentiable, Jacobian};
use ballbot_base::error::{Error, Result};
use ballbot_base::lane_state::LaneState;
use ballbot_base::model::Model;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};

/// Number of states.
const STATES: usize = INDEPENDENT.len();

/// Steps of the differences: of a rotation, rad, of speeds, m/s and rad/s, of torques, as a fraction of the largest, and of
/// friction, as [`Parameter::step`] takes it.
const ROTATION: f64 = 0.02;
const SPEED: f64 = 0.05;
const TORQUE: f64 = 0.02;
const FRICTION: f64 = 0.01;

/// Largest change of the rates of ball and wheels by a step of a difference, rad/s, where dry friction acts: it changes
/// within 0.05 rad/s.
const RATE: f64 = 1e-3;

/// Fraction of a step with which the change of these rates is found.
const PROBE: f64 = 1e-6;

/// Longest motion that is differentiated at once, s: short against the time in which a robot topples.
const SHORT: f64 = 0.01;

/// Indices among the states: attitude of the ball, of the body, wheel angles, speeds.
const BALL_ROTATION: usize = 2;
const BODY_ROTATION: usize = 5;
const WHEEL_ANGLES: usize = 8;
const SPEEDS: usize = 11;

/// The state and the contact forces at the end of a motion.
type End = [f64; STATES + FORCES];

/// A robot of a model without slip, whose motion is differentiated: by central differences of eighth order, whose error is
/// rounding.
pub struct WithoutSlip<M> {
    model: M,
    parameters: Vec<Parameter>,
    /// Whether there is dry friction, or a derivative with respect to it.
    is_dry: bool,
}

/// What is changed for a difference.
struct Start<'a, M> {
    model: &'a mut M,
    state: State,
    torques: Wheels<f64>,
}

/// A motion whose end is differentiated.
struct Nominal {
    torques: Wheels<f64>,
    steps: usize,
    start: State,
    next: State,
}

impl<M: Model + Clone> WithoutSlip<M> {
    /// A robot on level ground, as it moves next.
    pub fn new(model: &M, parameters: &[Parameter]) -> Self {
        let params = model.params();
        let by_friction = |parameter: &Parameter| parameter.is_loss() || parameter.name() == "wheel_coulomb_friction";
        let has_friction = params.has_losses() || params.wheel_coulomb_friction > 0.0;
        Self {
            model: model.clone(),
            parameters: parameters.to_vec(),
            is_dry: has_friction || parameters.iter().any(by_friction),
        }
    }

    /// Derivative of the end of a motion along what `change` changes by an amount.
    fn column(
        &self,
        nominal: &Nominal,
        mut step: f64,
        change: impl Fn(f64, &mut Start<'_, M>) -> Result<()>,
    ) -> Result<End> {
        // The robot at the end, and how much the rates of ball and wheels differ from the nominal motion.
        let changed = |amount: f64| -> Result<(M, f64)> {
            let mut model = self.model.clone();
            let mut start = Start { model: &mut model, state: nominal.start.clone(), torques: nominal.torques };
            change(amount, &mut start)?;
            let Start { state, torques, .. } = start;
            model.place(&state);
            if self.model.held_force().is_on() {
                model.hold_force(&self.model.held_force())?;
            }
            let before = largest_change(&model.state(), &nominal.start);
            model.advance(torques, nominal.steps);
            let after = largest_change(&model.state(), &nominal.next);
            Ok((model, before.max(after)))
        };
        if self.is_dry {
            let little = PROBE * step;
            step = step.min(RATE * little / changed(little)?.1);
        }
        let mut sum = [0.0; STATES + FORCES];
        for (k, weight) in WEIGHTS.iter().enumerate() {
            let offset = (k + 1) as f64 * step;
            let (ahead, behind) = (changed(offset)?.0, changed(-offset)?.0);
            let change = end_of(&ahead, &nominal.next).into_iter().zip(end_of(&behind, &nominal.next));
            sum.iter_mut().zip(change).for_each(|(sum, (ahead, behind))| *sum = weight.mul_add(ahead - behind, *sum));
        }
        Ok(sum.map(|sum| sum / step))
    }
}

impl<M: Model + Clone> Differentiable for WithoutSlip<M> {
    fn most_steps(&self) -> usize {
        // Dry friction would change too much within a longer motion.
        if self.is_dry { 1 } else { ((SHORT / self.model.sim_dt()) as usize).max(1) }
    }

    fn advance_some(&mut self, torques: Wheels<f64>, steps: usize) -> Result<Jacobian> {
        let params = self.model.params().clone();
        let mut moved = self.model.clone();
        moved.advance(torques, steps);
        let nominal = Nominal { torques, steps, start: self.model.state(), next: moved.state() };
        if let Some(reason) = LaneState::from(&nominal.next).out_of_bounds() {
            return Err(Error::Diverged { time: moved.time(), reason });
        }
        let [mut a, mut b, mut p] =
            [STATES, WHEELS, self.parameters.len()].map(|count| DMatrix::zeros(STATES + FORCES, count));
        // Position and wheel angles act on nothing, and the ball's attitude only on itself.
        for i in (0..BALL_ROTATION).chain(WHEEL_ANGLES..SPEEDS) {
            a[(i, i)] = 1.0;
        }
        let turned = (nominal.next.ball_quaternion * nominal.start.ball_quaternion.inverse()).to_rotation_matrix();
        a.fixed_view_mut::<3, 3>(BALL_ROTATION, BALL_ROTATION).copy_from(turned.matrix());
        for i in (BODY_ROTATION..WHEEL_ANGLES).chain(SPEEDS..STATES) {
            let step = if i < SPEEDS { ROTATION } else { SPEED };
            let column = self.column(&nominal, step, |amount, start| {
                move_along(&mut start.state, i, amount);
                Ok(())
            })?;
            a.column_mut(i).copy_from_slice(&column);
        }
        for i in 0..WHEELS {
            let column = self.column(&nominal, TORQUE * params.max_wheel_torque, |amount, start| {
                start.torques[i] += amount;
                Ok(())
            })?;
            b.column_mut(i).copy_from_slice(&column);
        }
        for (i, parameter) in self.parameters.iter().enumerate() {
            let column = self.column(&nominal, parameter.step(&params, FRICTION), |amount, start| {
                start.model.set_params(&parameter.changed(&params, amount)).map_err(|error| {
                    Error::Inconsistent(format!(
                        "no derivative with respect to {parameter}: the model does not simulate a robot with another: {error}"
                    ))
                })
            })?;
            p.column_mut(i).copy_from_slice(&column);
        }
        let contacts = moved.contacts();
        self.model = moved;
        let Nominal { start, next, .. } = nominal;
        let split =
            |matrix: DMatrix<f64>| (matrix.rows(0, STATES).into_owned(), matrix.rows(STATES, FORCES).into_owned());
        let ((a, c), (b, d), (p, q)) = (split(a), split(b), split(p));
        Ok(Jacobian {
            a,
            b,
            p,
            c,
            d,
            q,
            coordinates: Coordinates::WithoutSlip,
            level: true,
            start,
            next,
            contacts,
            modes_changed: false,
            margin: f64::INFINITY,
            kinds: None,
        })
    }
}

/// Changes a state along a coordinate. What follows from rolling is left to the model.
fn move_along(state: &mut State, coordinate: usize, amount: f64) {
    let place = INDEPENDENT[coordinate];
    let axis = place % 3;
    match place / 3 {
        3 => state.body_quaternion *= UnitQuaternion::from_scaled_axis(Vector3::ith(axis, amount)),
        5 => state.ball_velocity[axis] += amount,
        6 => state.ball_angular_velocity[axis] += amount,
        8 => state.body_angular_velocity[axis] += amount,
        _ => unreachable!("positions, the ball's attitude and wheel angles need no difference"),
    }
}

/// Largest difference of a rate of ball or wheels, rad/s.
fn largest_change(state: &State, other: &State) -> f64 {
    let ball = (state.ball_angular_velocity - other.ball_angular_velocity).amax();
    (state.wheel_speeds - other.wheel_speeds).into_iter().fold(ball, |largest, change| largest.max(change.abs()))
}

/// Change of the state at the end from `next`, and contact forces.
fn end_of(model: &impl Model, next: &State) -> End {
    let (state, contacts) = (model.state(), model.contacts());
    let position = state.ball_position - next.ball_position;
    let ball = (state.ball_quaternion * next.ball_quaternion.inverse()).scaled_axis();
    let body = (next.body_quaternion.inverse() * state.body_quaternion).scaled_axis();
    let velocity = state.ball_velocity - next.ball_velocity;
    let spin = state.ball_angular_velocity.z - next.ball_angular_velocity.z;
    let rate = state.body_angular_velocity - next.body_angular_velocity;
    let groups: [&[f64]; 10] = [
        &position.as_slice()[..2],
        ball.as_slice(),
        body.as_slice(),
        &(state.wheel_angles - next.wheel_angles).0,
        &velocity.as_slice()[..2],
        &[spin],
        rate.as_slice(),
        &contacts.wheel_normal_forces.0,
        &contacts.wheel_tractions.0,
        contacts.floor_force.as_slice(),
    ];
    let mut end = [0.0; STATES + FORCES];
    end.iter_mut().zip(groups.iter().copied().flatten()).for_each(|(place, number)| *place = *number);
    end
}
