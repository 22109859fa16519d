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
use super::held_force::hold;
use super::losses::brake;
use super::phases::{Start, finish, free_velocities};
use super::preload::press;
use super::rows::Rows;
use super::state::ContactState;
use super::step::count_searches;
use super::types::{Actions, PerRow, Velocities};
use ballbot_base::lanes::{
    Cell, Directions, Dual, DualCell, Kernel, Lane, Registers, Scalar, Slopes, Value, Vec3, run_eight,
};
use ballbot_base::terrain::Ground;
use ballbot_base::wheels::{WHEELS, Wheels};
use std::sync::Arc;

/// Number of rows: of the floor, and of three wheels normal, drive and joint.
const ROWS: usize = PerRow::<f64>::LEN;

/// Number of rows without the rows of the joints, which are last.
const CONTACT_ROWS: usize = ROWS - WHEELS;

/// Number of contacts and gaps with modes.
const MODES: usize = 3 * WHEELS + 2;

/// The mode of each contact and gap.
pub type Kinds = [i8; MODES];

/// A step whose modes are known.
pub struct SolvedStep {
    /// Impulses of the contacts, in the frame of the ground.
    impulses: PerRow<f64>,
    modes: Modes<f64>,
    friction: Friction<f64>,
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
    /// The next step of a robot under constant torques; `None` if its equations are singular. `all_rows`, which robots
    /// with ripple or friction of the wheel joints need, includes the joints.
    pub fn new(
        c: &Constants<f64>,
        state: &ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        torques: Wheels<f64>,
        all_rows: bool,
    ) -> Option<Self> {
        let mut solved = None;
        run_eight(Solving { c, state, ground, torques, all_rows, solved: &mut solved });
        solved
    }

    #[inline(always)]
    fn of<D: Slopes, const ALL: bool>(
        token: D::Token,
        c: &Constants<f64>,
        mut state: ContactState<f64>,
        ground: Option<&Arc<Ground>>,
        torques: Wheels<f64>,
    ) -> Option<Self> {
        let mut actions = Actions::new(c.gravity_dt, torques);
        let mut footing = ground.map(Footing::new);
        if let Some(footing) = &mut footing {
            footing.enter::<f64, f64>(c, Scalar, &mut state, &mut actions);
        }
        press::<f64, f64>(c, Scalar, &mut state, &mut actions);
        hold::<f64, f64>(c, Scalar, &mut state, footing.as_ref());
        brake::<f64, f64>(c, Scalar, &mut state);
        let start = Start::<f64>::new::<ALL, f64>(c, Scalar, &state);
        let near = Near::new(c, &start, Scalar, &state, footing.as_ref()).mask;
        let (friction, joint_friction) = (Friction::new(c, &start.rows, &start.velocities), JointFriction::new(c, 0.0));
        let free = free_velocities(c, Scalar, &state, &start, &actions);
        let residuals = start.rows.residuals::<ALL, f64>(c, &free);
        let delassus = Delassus::new::<ALL, ALL>(c, &start.rows);
        let static_impulse = c.static_wheel_load * c.sim_dt;
        let conditions = Conditions {
            delassus: &delassus,
            residuals: &residuals,
            friction: &friction,
            joint_friction: &joint_friction,
            static_impulse,
        };
        let solution = conditions.solution::<ALL>(Scalar, &state.impulses(Scalar), true);
        count_searches(Scalar, &solution, &mut state);
        let impulses = solution.impulses;
        let mut residuals = residuals;
        delassus.add_effect::<ALL>(&impulses, &mut residuals);
        let conditions = Conditions { residuals: &residuals, ..conditions };
        let trial = conditions.trial::<ALL>(&impulses, &residuals);
        let modes = Modes::of(&trial, &friction, &joint_friction);
        let limits = (&friction, &joint_friction);
        let slopes = slopes::<D>(token, c, &modes, (&impulses, &residuals), &delassus, limits);
        let (kinds, margin) = kinds(c, &start, &trial, &friction, &joint_friction, static_impulse);
        let mut velocities = free;
        start.rows.apply::<ALL, ALL, f64>(c, &impulses, &mut velocities);
        finish::<f64, f64>(c, Scalar, &mut state, &start, (&velocities, &impulses), 0.0);
        if let Some(footing) = &footing {
            footing.leave::<f64>(Scalar, &mut state);
        }
        let slope = Factors::new(slopes, if ALL { ROWS } else { CONTACT_ROWS })?;
        Some(Self { impulses, modes, friction, slope, kinds, after: state, near, margin })
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

    /// Whether a closed contact slips.
    fn slips(&self) -> bool {
        let Modes { wheels, floor, .. } = &self.modes;
        (floor.closed && floor.slips) || (0..WHEELS).any(|i| wheels.closed[i] && wheels.slips[i])
    }

    /// Advances a robot by this step, with derivatives; `ALL` as `all_rows` of [`SolvedStep::new`]. `plain` are the
    /// constants without derivatives.
    #[inline(always)]
    pub fn advance<D: Slopes, V: Value<Dual<D>>, const ALL: bool>(
        &self,
        (c, plain): (&Constants<V>, &Constants<f64>),
        token: D::Token,
        state: &mut ContactState<DualCell<D::Cell>>,
        mut footing: Option<&mut Footing<DualCell<D::Cell>>>,
        torques: &Wheels<DualCell<D::Cell>>,
    ) {
        let like = Dual::<D>::from_f64(token, 0.0);
        let mut gravity_dt = [DualCell::default(); 3];
        Vec3::from(super::constants::at3(c.gravity_dt, like)).store(&mut gravity_dt);
        let mut actions = Actions::new(gravity_dt, *torques);
        if let Some(footing) = &mut footing {
            footing.enter(c, token, state, &mut actions);
        }
        press(c, token, state, &mut actions);
        hold(c, token, state, footing.as_deref());
        brake(c, token, state);
        let start = Start::new::<ALL, V>(c, token, state);
        let mut friction = self.friction.map(
            #[inline(always)]
            |number| like.splat(*number),
        );
        // Friction that grips has no effect.
        if self.slips() {
            friction = Friction::new(c, &start.rows, &start.velocities);
        }
        let mut velocities = free_velocities(c, token, state, &start, &actions);
        let mut impulses = self.impulses.map(
            #[inline(always)]
            |number| like.splat(*number),
        );
        start.rows.apply::<ALL, ALL, V>(c, &impulses, &mut velocities);
        let residuals = start.rows.residuals::<ALL, V>(c, &velocities);
        let joint_friction = JointFriction::new(c, like);
        let tangent = c.floor_compliance_inverse.at(like);
        let equations = equations(&self.modes, &impulses, &residuals, &friction, &joint_friction, tangent);
        let changes = self.changes(token, &equations);
        add_effect::<D, ALL>(plain, &start.rows, &changes, &mut velocities);
        impulses.zip_mut(
            &changes,
            #[inline(always)]
            |impulse, change| impulse.derivatives = *change,
        );
        finish(c, token, state, &start, (&velocities, &impulses), like);
        if let Some(footing) = &footing {
            footing.leave::<Dual<D>>(token, state);
        }
    }

    /// Derivatives of the impulses, from the derivatives of their equations at constant impulses.
    #[inline(always)]
    fn changes<D: Slopes>(&self, token: D::Token, equations: &PerRow<Dual<D>>) -> PerRow<D> {
        let mut slopes = [D::Cell::default(); ROWS];
        let mut row = 0;
        equations.map(
            #[inline(always)]
            |equation| {
                equation.derivatives.store(&mut slopes[row]);
                row += 1;
            },
        );
        self.slope.take_minus_inverse_of::<D>(token, &mut slopes);
        let mut row = 0;
        equations.map(
            #[inline(always)]
            |_| {
                row += 1;
                D::load(token, &slopes[row - 1])
            },
        )
    }
}

struct Solving<'a> {
    c: &'a Constants<f64>,
    state: &'a ContactState<f64>,
    ground: Option<&'a Arc<Ground>>,
    torques: Wheels<f64>,
    all_rows: bool,
    solved: &'a mut Option<SolvedStep>,
}

impl Solving<'_> {
    #[inline(always)]
    fn with<D: Slopes>(self, token: D::Token) {
        let Self { c, state, ground, torques, all_rows, solved } = self;
        *solved = if all_rows {
            SolvedStep::of::<D, true>(token, c, state.clone(), ground, torques)
        } else {
            SolvedStep::of::<D, false>(token, c, state.clone(), ground, torques)
        };
    }
}

impl Kernel for Solving<'_> {
    #[inline(always)]
    fn run<S: Registers>(self, simd: S) {
        self.with::<Directions<S>>(simd);
    }

    fn run_one_by_one(self) {
        self.with::<f64>(Scalar);
    }
}

/// Adds to the velocities what derivatives of the impulses add: [`Rows::apply`] is linear in the impulses.
#[inline(always)]
fn add_effect<D: Slopes, const ALL: bool>(
    c: &Constants<f64>,
    rows: &Rows<Dual<D>>,
    changes: &PerRow<D>,
    v: &mut Velocities<Dual<D>>,
) {
    let none = [changes.floor[0].zero(); 3];
    let (mut bot, mut ball, mut body) = (none, none, none);
    for i in 0..WHEELS {
        let (normal, drive) = (changes.normals[i], changes.drives[i]);
        add(&mut bot, values(rows.normals[i]), normal);
        add(&mut bot, values(rows.drives[i]), drive);
        add(&mut ball, values(rows.turns[i]), -drive);
        add(&mut body, values(rows.normal_arms[i]), normal);
        add(&mut body, values(rows.drive_arms[i]), drive);
        let mut wheel = drive * (rows.spin_shares[i].value * c.wheel_radius);
        if ALL {
            add(&mut body, c.u[i], changes.joints[i]);
            wheel = normal.mul_add(rows.ripple.slopes[i].value, wheel + changes.joints[i]);
        }
        let spin = &mut v.spins[i].derivatives;
        *spin = wheel.mul_add(c.wheel_inertia_inverse, *spin);
    }
    let [z, x, y] = changes.floor;
    ball = [ball[0] + y, ball[1] - x, ball[2]];
    let on_ball = [x - bot[0], y - bot[1], z - bot[2]];
    for (velocity, impulse, factors) in [
        (&mut v.ball, on_ball, [c.ball_mass_inverse; 3]),
        (&mut v.ball_rate, ball, [c.ball_rim_ratio; 3]),
        (&mut v.body, bot, [c.body_mass_inverse; 3]),
        (&mut v.body_rate, body, c.body_inertia_inverse),
    ] {
        let Vec3 { x, y, z } = velocity;
        x.derivatives = impulse[0].mul_add(factors[0], x.derivatives);
        y.derivatives = impulse[1].mul_add(factors[1], y.derivatives);
        z.derivatives = impulse[2].mul_add(factors[2], z.derivatives);
    }
}

#[inline(always)]
fn values<D: Slopes>(v: Vec3<Dual<D>>) -> [f64; 3] {
    [v.x.value, v.y.value, v.z.value]
}

/// Adds a multiple of a direction.
#[inline(always)]
fn add<D: Slopes>([x, y, z]: &mut [D; 3], direction: [f64; 3], amount: D) {
    *x = amount.mul_add(direction[0], *x);
    *y = amount.mul_add(direction[1], *y);
    *z = amount.mul_add(direction[2], *z);
}

/// Derivatives of the equations by the impulses: a row for each equation.
#[inline(always)]
fn slopes<D: Slopes>(
    token: D::Token,
    c: &Constants<f64>,
    modes: &Modes<f64>,
    (impulses, residuals): (&PerRow<f64>, &PerRow<f64>),
    delassus: &Delassus<f64, f64>,
    (friction, joint_friction): (&Friction<f64>, &JointFriction<f64>),
) -> [[f64; ROWS]; ROWS] {
    let like = Dual::<D>::from_f64(token, 0.0);
    let mut out = [[0.0; ROWS]; ROWS];
    for first in (0..ROWS).step_by(D::Cell::WIDTH) {
        let columns = first..ROWS.min(first + D::Cell::WIDTH);
        let mut row = 0;
        let moved = impulses.map(
            #[inline(always)]
            |impulse| {
                let mut unit = D::Cell::default();
                if columns.contains(&row) {
                    unit.set(row - first, 1.0);
                }
                row += 1;
                Dual { value: *impulse, derivatives: D::load(token, &unit) }
            },
        );
        let mut moving = residuals.map(
            #[inline(always)]
            |number| like.splat(*number),
        );
        moving.zip_mut(
            &delassus.rows(),
            #[inline(always)]
            |residual, row| {
                let mut slopes = D::Cell::default();
                for column in columns.clone() {
                    slopes.set(column - first, row[column]);
                }
                residual.derivatives = D::load(token, &slopes);
            },
        );
        let limits = friction.map(
            #[inline(always)]
            |number| like.splat(*number),
        );
        let joint_limits = joint_friction.map(
            #[inline(always)]
            |number| like.splat(*number),
        );
        let tangent = like.splat(c.floor_compliance_inverse);
        let mut row = 0;
        equations(modes, &moved, &moving, &limits, &joint_limits, tangent).map(
            #[inline(always)]
            |equation| {
                let mut slopes = D::Cell::default();
                equation.derivatives.store(&mut slopes);
                for column in columns.clone() {
                    out[row][column] = slopes.get(column - first);
                }
                row += 1;
            },
        );
    }
    out
}

/// Triangular factors of a matrix with its rows in another order.
struct Factors {
    /// Left factor below the diagonal, negative, and right factor above it.
    rows: [[f64; ROWS]; ROWS],
    /// Inverse of the diagonal of the right factor, negative.
    diagonal: [f64; ROWS],
    order: [usize; ROWS],
    /// Number of rows and columns; the equations of the others have no derivatives.
    size: usize,
}

impl Factors {
    /// Of the first rows and columns of a matrix; `None` if they are singular.
    #[inline(always)]
    fn new(mut rows: [[f64; ROWS]; ROWS], size: usize) -> Option<Self> {
        // Apart from the rows, so that each step is of whole rows.
        let mut left = [[0.0; ROWS]; ROWS];
        let (mut diagonal, mut order) = ([0.0; ROWS], std::array::from_fn(|row| row));
        for k in 0..size {
            let mut pivot = k;
            for row in k + 1..size {
                if rows[row][k].abs() > rows[pivot][k].abs() {
                    pivot = row;
                }
            }
            if pivot != k {
                rows.swap(k, pivot);
                left.swap(k, pivot);
                order.swap(k, pivot);
            }
            diagonal[k] = -1.0 / rows[k][k];
            if !diagonal[k].is_finite() {
                return None;
            }
            let right = rows[k];
            for (row, left) in rows[k + 1..size].iter_mut().zip(&mut left[k + 1..size]) {
                let factor = row[k] * diagonal[k];
                for (number, right) in row.iter_mut().zip(&right) {
                    *number = factor.mul_add(*right, *number);
                }
                left[k] = factor;
            }
        }
        for (i, (row, left)) in rows.iter_mut().zip(&left).enumerate() {
            row[..i].copy_from_slice(&left[..i]);
        }
        Some(Self { rows, diagonal, order, size })
    }

    /// Replaces columns by −F⁻¹ times them.
    #[inline(always)]
    fn take_minus_inverse_of<D: Slopes>(&self, token: D::Token, columns: &mut [D::Cell; ROWS]) {
        let mut found = *columns;
        for i in 0..self.size {
            let mut sum = D::load(token, &columns[self.order[i]]);
            for (found, factor) in found[..i].iter().zip(&self.rows[i]) {
                sum = D::load(token, found).mul_add(*factor, sum);
            }
            sum.store(&mut found[i]);
        }
        for i in (0..self.size).rev() {
            let mut sum = D::load(token, &found[i]);
            for (found, factor) in found[i + 1..self.size].iter().zip(&self.rows[i][i + 1..]) {
                sum = D::load(token, found).mul_add(*factor, sum);
            }
            (sum * self.diagonal[i]).store(&mut found[i]);
        }
        *columns = found;
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
