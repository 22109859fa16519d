//! Derivatives of a step.
//!
//! With the modes of its contacts fixed a step is smooth, and its impulses λ solve equations F(λ, x) = 0, where x is
//! everything that the step starts from. So dλ = −F_λ⁻¹ F_x dx: `F_x dx` is a step with derivatives and constant
//! impulses, and a second application of the impulses adds their derivatives.

use super::active_set::{Conditions, Modes};
use super::body_contacts::Near;
use super::constants::Constants;
use super::delassus::Delassus;
use super::footing::Footing;
use super::friction::{Friction, JointFriction};
use super::losses::brake;
use super::phases::{Start, finish, free_velocities};
use super::state::ContactState;
use super::step::count_searches;
use super::types::{Actions, PerRow};
use ballbot_base::lanes::{Dual, DualCell, Lane, Scalar, Slopes, Twelve, Value, Vec3, run_one};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::{WHEELS, Wheels};
use std::sync::Arc;

/// Number of rows: of the floor, and of three wheels normal, drive and joint.
const ROWS: usize = PerRow::<f64>::LEN;

/// Number of contacts and gaps with modes.
const MODES: usize = 3 * WHEELS + 2;

/// The mode of each contact and gap.
pub type Kinds = [i8; MODES];

/// A step whose modes are known.
pub struct SolvedStep {
    /// Impulses of the contacts, in the frame of the ground.
    impulses: PerRow<f64>,
    modes: Modes<f64>,
    /// F_λ.
    slope: Factors,
    kinds: Kinds,
    /// The robot after the step, unless the bot touches the floor, or the ball its body.
    after: ContactState<f64>,
    /// Whether they may touch.
    near: bool,
    /// Distance from other modes: the smallest change of an impulse, as a fraction of the impulse of a wheel's static
    /// load, of a gap, as a fraction of g dt², or of a joint's impulse, as a fraction of its dry friction, with which a
    /// contact changes its mode.
    pub margin: f64,
}

impl SolvedStep {
    /// The next step of a robot under constant torques; `None` if its equations are singular.
    pub fn new(
        c: &Constants<f64>,
        state: &ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        torques: Wheels<f64>,
    ) -> Option<Self> {
        run_one(
            #[inline(always)]
            || Self::of(c, state.clone(), ground, torques),
        )
    }

    #[inline(always)]
    fn of(
        c: &Constants<f64>,
        mut state: ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        torques: Wheels<f64>,
    ) -> Option<Self> {
        let mut actions = Actions::level(c.gravity_dt, torques);
        let mut footing = ground.map(Footing::new);
        if let Some(footing) = &mut footing {
            footing.enter::<f64, f64>(c, Scalar, &mut state, &mut actions.gravity_dt);
        }
        brake::<f64, f64>(c, Scalar, &mut state);
        let start = Start::<f64>::new::<true, f64>(c, Scalar, &state);
        let near = Near::new(c, &start, Scalar, &state, footing.as_ref()).mask;
        let (friction, joint_friction) = (Friction::new(c, &start.rows, &start.velocities), JointFriction::new(c, 0.0));
        let free = free_velocities(c, Scalar, &state, &start, &actions);
        let residuals = start.rows.residuals::<true, f64>(c, &free);
        let delassus = Delassus::new::<true, true>(c, &start.rows);
        let static_impulse = c.static_wheel_load * c.sim_dt;
        let conditions = Conditions {
            delassus: &delassus,
            residuals: &residuals,
            friction: &friction,
            joint_friction: &joint_friction,
            static_impulse,
        };
        let solution = conditions.solution::<true>(Scalar, &state.impulses(Scalar), true);
        count_searches(Scalar, &solution, &mut state);
        let impulses = solution.impulses;
        let mut residuals = residuals;
        delassus.add_effect::<true>(&impulses, &mut residuals);
        let conditions = Conditions { residuals: &residuals, ..conditions };
        let trial = conditions.trial::<true>(&impulses, &residuals);
        let modes = Modes::of(&trial, &friction, &joint_friction);

        // Each row has derivatives by the impulse of each row.
        let mut row = 0;
        let moved = impulses.map(
            #[inline(always)]
            |impulse| {
                let mut unit = Twelve::default();
                unit.0[row] = 1.0;
                row += 1;
                Dual { value: *impulse, derivatives: unit }
            },
        );
        let mut moving = residuals.map(constant);
        moving.zip_mut(
            &delassus.rows(),
            #[inline(always)]
            |residual, row| residual.derivatives.0 = *row,
        );
        let (limits, joint_limits) = (friction.map(constant), joint_friction.map(constant));
        let tangent = constant(&c.floor_compliance_inverse);
        let equations = equations(&modes, &moved, &moving, &limits, &joint_limits, tangent);
        let (kinds, margin) = kinds(c, &start, &trial, &friction, &joint_friction, static_impulse);
        let mut velocities = free;
        start.rows.apply::<true, true, f64>(c, &impulses, &mut velocities);
        finish::<f64, f64>(c, Scalar, &mut state, &start, (&velocities, &impulses), 0.0);
        if let Some(footing) = &footing {
            footing.leave::<f64>(Scalar, &mut state);
        }
        Some(Self { impulses, modes, slope: Factors::new(&equations)?, kinds, after: state, near, margin })
    }

    /// The mode of each contact.
    pub fn kinds(&self) -> Kinds {
        self.kinds
    }

    /// Whether all contacts have the modes of another step.
    pub fn has_modes_of(&self, other: &Self) -> bool {
        self.kinds == other.kinds
    }

    /// The robot after the step, unless the bot is near the floor, or the ball near its body.
    pub fn end(&self) -> Option<&ContactState<f64>> {
        (!self.near).then_some(&self.after)
    }

    /// Whether the step led to a state: otherwise the bot touched the floor, or the ball its body.
    pub fn led_to(&self, state: &ContactState<f64>) -> bool {
        let Self { after, .. } = self;
        state.bot_on_floor == 0.0
            && after.ball_velocity == state.ball_velocity
            && after.body_velocity == state.body_velocity
            && after.body_rate == state.body_rate
    }

    /// Advances a robot by this step, with derivatives.
    #[inline(always)]
    pub fn advance<D: Slopes, V: Value<Dual<D>>, const RIPPLE: bool>(
        &self,
        c: &Constants<V>,
        token: D::Token,
        state: &mut ContactState<DualCell<D::Cell>>,
        mut footing: Option<&mut Footing<DualCell<D::Cell>>>,
        torques: &Wheels<DualCell<D::Cell>>,
    ) {
        let mut actions = Actions { torques: *torques, gravity_dt: [DualCell::default(); 3] };
        let like = Dual::<D>::load(token, &state.steps);
        Vec3::from(super::constants::at3(c.gravity_dt, like)).store(&mut actions.gravity_dt);
        if let Some(footing) = &mut footing {
            footing.enter(c, token, state, &mut actions.gravity_dt);
        }
        brake(c, token, state);
        let start = Start::new::<RIPPLE, V>(c, token, state);
        let friction = Friction::new(c, &start.rows, &start.velocities);
        let free = free_velocities(c, token, state, &start, &actions);
        let mut impulses = self.impulses.map(
            #[inline(always)]
            |impulse| like.splat(*impulse),
        );
        let mut velocities = free;
        start.rows.apply::<true, RIPPLE, V>(c, &impulses, &mut velocities);
        let residuals = start.rows.residuals::<RIPPLE, V>(c, &velocities);
        let joint_friction = JointFriction::new(c, like);
        let tangent = c.floor_compliance_inverse.at(like);
        let equations = equations(&self.modes, &impulses, &residuals, &friction, &joint_friction, tangent);
        self.add_derivatives(&equations, &mut impulses);
        let mut velocities = free;
        start.rows.apply::<true, RIPPLE, V>(c, &impulses, &mut velocities);
        finish(c, token, state, &start, (&velocities, &impulses), like.zero());
        if let Some(footing) = &footing {
            footing.leave::<Dual<D>>(token, state);
        }
    }

    /// Gives constant impulses their derivatives, from the derivatives of their equations.
    #[inline(always)]
    fn add_derivatives<D: Slopes>(&self, equations: &PerRow<Dual<D>>, impulses: &mut PerRow<Dual<D>>) {
        let mut slopes = [equations.floor[0].derivatives; ROWS];
        let mut row = 0;
        equations.map(
            #[inline(always)]
            |equation| {
                slopes[row] = equation.derivatives;
                row += 1;
            },
        );
        let found = self.slope.minus_inverse_times(&slopes);
        let mut row = 0;
        *impulses = impulses.map(
            #[inline(always)]
            |impulse| {
                row += 1;
                Dual { value: impulse.value, derivatives: found[row - 1] }
            },
        );
    }
}

#[inline(always)]
fn constant(number: &f64) -> Dual<Twelve> {
    Dual { value: *number, derivatives: Twelve::default() }
}

/// Triangular factors of a matrix with its rows in another order.
struct Factors {
    /// Left factor below the diagonal, negative, and right factor above it.
    rows: [[f64; ROWS]; ROWS],
    /// Inverse of the diagonal of the right factor, negative.
    diagonal: [f64; ROWS],
    order: [usize; ROWS],
}

impl Factors {
    /// Of the derivatives of equations by the impulses; `None` if they are singular.
    #[inline(always)]
    fn new(equations: &PerRow<Dual<Twelve>>) -> Option<Self> {
        let mut rows = [[0.0; ROWS]; ROWS];
        let mut row = 0;
        equations.map(
            #[inline(always)]
            |equation| {
                rows[row] = equation.derivatives.0;
                row += 1;
            },
        );
        let (mut diagonal, mut order) = ([0.0; ROWS], std::array::from_fn(|row| row));
        for k in 0..ROWS {
            let mut pivot = k;
            for row in k + 1..ROWS {
                if rows[row][k].abs() > rows[pivot][k].abs() {
                    pivot = row;
                }
            }
            rows.swap(k, pivot);
            order.swap(k, pivot);
            diagonal[k] = -1.0 / rows[k][k];
            if !diagonal[k].is_finite() {
                return None;
            }
            let right = rows[k];
            for left in &mut rows[k + 1..] {
                if left[k] == 0.0 {
                    continue;
                }
                let factor = left[k] * diagonal[k];
                for (number, right) in left[k + 1..].iter_mut().zip(&right[k + 1..]) {
                    *number = factor.mul_add(*right, *number);
                }
                left[k] = factor;
            }
        }
        Some(Self { rows, diagonal, order })
    }

    /// −F⁻¹ times a column.
    #[inline(always)]
    fn minus_inverse_times<D: Slopes>(&self, column: &[D; ROWS]) -> [D; ROWS] {
        let mut out = *column;
        for i in 0..ROWS {
            let mut sum = column[self.order[i]];
            for (found, factor) in out[..i].iter().zip(&self.rows[i]) {
                sum = found.mul_add(*factor, sum);
            }
            out[i] = sum;
        }
        for i in (0..ROWS).rev() {
            let mut sum = out[i];
            for (found, factor) in out[i + 1..].iter().zip(&self.rows[i][i + 1..]) {
                sum = found.mul_add(*factor, sum);
            }
            out[i] = sum * self.diagonal[i];
        }
        out
    }
}

/// What the impulses of given modes and their residuals bring to zero; of a ball that slips on the floor, the deviation
/// of the friction from the projection of its trial impulse.
#[inline(always)]
fn equations<L: Lane>(
    modes: &Modes<f64>,
    impulses: &PerRow<L>,
    residuals: &PerRow<L>,
    friction: &Friction<L>,
    joint_friction: &JointFriction<L>,
    tangent: L,
) -> PerRow<L> {
    let mut out = *residuals;
    for i in 0..WHEELS {
        if !modes.wheels.closed[i] {
            out.normals[i] = impulses.normals[i];
        }
        if modes.wheels.slips[i] {
            let bound = friction.wheels[i] * impulses.normals[i];
            let along = if modes.wheels.slopes[i] < 0.0 { -bound } else { bound };
            out.drives[i] = impulses.drives[i] - along;
        }
        if !modes.joints.sticks[i] {
            let dry = joint_friction.dry;
            // Also of a joint without dry friction, for the derivative with respect to it.
            let dry = if modes.joints.dry[i].is_sign_negative() { -dry } else { dry };
            out.joints[i] = residuals.joints[i].mul_add(joint_friction.viscous, impulses.joints[i] - dry);
        }
    }
    let [z, x, y] = impulses.floor;
    if !modes.floor.closed {
        out.floor = [z, x, y];
    } else if modes.floor.slips {
        let (tx, ty) = (residuals.floor[1].neg_mul_add(tangent, x), residuals.floor[2].neg_mul_add(tangent, y));
        let share = friction.floor * z / tx.mul_add(tx, ty.squared()).sqrt();
        out.floor[1] = share.neg_mul_add(tx, x);
        out.floor[2] = share.neg_mul_add(ty, y);
    }
    out
}

/// The mode of each contact and gap, and the distance from other modes.
#[inline(always)]
fn kinds(
    c: &Constants<f64>,
    start: &Start<f64>,
    trial: &PerRow<f64>,
    friction: &Friction<f64>,
    joint_friction: &JointFriction<f64>,
    static_impulse: f64,
) -> (Kinds, f64) {
    let (mut kinds, mut margin) = ([0; MODES], f64::INFINITY);
    let mut next = 0;
    let mut add = |kind: i8, distance: f64| {
        kinds[next] = kind;
        next += 1;
        margin = margin.min(distance);
    };
    // Open, gripping, or slipping one way or the other.
    let contact = |normal: f64, along: f64, coefficient: f64| {
        let beyond = along.abs() - coefficient * normal.max(0.0);
        let kind = match (normal > 0.0, beyond > 0.0) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) if along < 0.0 => 2,
            (true, true) => 3,
        };
        (kind, if kind == 0 { -normal } else { normal.min(beyond.abs()) } / static_impulse)
    };
    let fall = c.gravity_dt[2].abs() * c.sim_dt;
    let [normal, x, y] = trial.floor;
    for i in 0..=WHEELS {
        let (gap, (kind, distance)) = if i < WHEELS {
            (start.rows.gaps[i], contact(trial.normals[i], trial.drives[i], friction.wheels[i]))
        } else {
            (start.rows.floor_gap, contact(normal, x.hypot(y), friction.floor))
        };
        add(kind, distance);
        add(i8::from(gap > 0.0), if kind == 0 { f64::INFINITY } else { gap.abs() / fall });
    }
    let dry = joint_friction.dry;
    for joint in trial.joints {
        let kind = if joint.abs() <= dry {
            1
        } else if joint < 0.0 {
            2
        } else {
            3
        };
        if dry > 0.0 {
            add(kind, (joint.abs() - dry).abs() / dry);
        }
    }
    (kinds, margin)
}
