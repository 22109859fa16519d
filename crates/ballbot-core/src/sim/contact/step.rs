//! The time step of the contact model. One step, with sections of `docs/derivations.md` in parentheses:
//!
//! ```text
//! rows(pose)                              gaps, normals, drive directions, arms               (Rows)
//! if a rare contact is near: body_contacts::step, with the same parts and further sweeps      (Rare contacts)
//! mu   = stribeck(slip(velocities))       friction coefficients at the start of the step      (Friction law)
//! free = velocities + dt M^-1 forces      gravity, motors, push, drag, gyroscopic torque      (Free velocities)
//! W    = J M^-1 J^T                       change of row velocities per impulse                (Delassus matrix)
//! r    = J free + b(gap) + W impulses     residuals with the impulses of the last step        (Warm start)
//! repeat 4 to 60 times, until the wheel impulses change little:                               (Sweeps)
//!     for each row k: impulse_k = project(impulse_k - r_k / W_kk); r += W_k change
//! velocities = free + M^-1 J^T impulses   velocities at the end of the step                   (Sweeps)
//! pose       = pose + dt velocities       attitudes by rotation vectors                       (Semi-implicit Euler)
//! ```

#[cfg(test)]
mod flops;

use super::body_contacts;
use super::constants::{Constants, InLanes, at3};
use super::rows::{Rows, encoder_rate};
use super::solve::{Delassus, Friction, JointFriction, MOST_SWEEPS, SWEEPS};
use super::state::{ContactState, Torques};
use super::types::{PerRow, Pose, Velocities, select3};
use crate::lanes::{EIGHT, Eight, Lane, Rotation, Scalar, Value, Vec3, Wide, run_one};
use crate::sim::friction::stribeck;
use fearless_simd::Simd;

/// Advances one robot by `steps` time steps under constant torques.
pub fn advance(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>, steps: usize) {
    run_one(
        #[inline(always)]
        || {
            for _ in 0..steps {
                advance_one(c, state, torques);
            }
        },
    );
}

#[inline(always)]
fn advance_one(c: &Constants<f64>, state: &mut ContactState<f64>, torques: &Torques<f64>) {
    if !step::<f64, f64>(c, Scalar, state, torques) {
        body_contacts::step(c, state, torques);
    }
}

/// Advances eight robots. The result for each is that of [`advance`] to the last bit.
#[inline(always)]
pub fn advance_wide<S: Simd, V: InLanes>(
    simd: S,
    constants: &Constants<V>,
    state: &mut ContactState<Eight>,
    torques: &Torques<Eight>,
    steps: usize,
) {
    V::with(
        constants,
        simd,
        #[inline(always)]
        |c| {
            for _ in 0..steps {
                if !step::<Wide<S>, V::Wide<S>>(c, simd, state, torques) {
                    one_by_one(constants, state, torques);
                }
            }
        },
    );
}

/// A step of eight robots, one after the other.
#[cold]
pub fn one_by_one<V: InLanes>(constants: &Constants<V>, state: &mut ContactState<Eight>, torques: &Torques<Eight>) {
    for i in 0..EIGHT {
        let mut one = state.lane(i);
        let c = constants.map(|value| value.lane(i));
        advance(&c, &mut one, &[torques[0].0[i], torques[1].0[i], torques[2].0[i]], 1);
        state.set_lane(i, &one);
    }
}

/// One step of robots without contacts of [`body_contacts`]. Returns false, without effect, if a robot needs them.
#[inline(always)]
fn step<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
) -> bool {
    let start = Start::new(c, token, state);
    if L::any(body_contacts::near(c, &start, token, &state.push)) {
        return false;
    }
    let joint_friction = JointFriction::new(c, start.rows.floor_gap);
    if joint_friction.any() {
        step_on_ball::<L, V, true>(c, token, state, torques, &start, &joint_friction);
    } else {
        step_on_ball::<L, V, false>(c, token, state, torques, &start, &joint_friction);
    }
    true
}

/// Pose, velocities and rows at the start of a step.
pub struct Start<L> {
    pub pose: Pose<L>,
    pub velocities: Velocities<L>,
    pub rotation: Rotation<L>,
    pub rows: Rows<L>,
}

impl<L: Lane> Start<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, token: L::Token, state: &ContactState<L::Cell>) -> Self {
        let pose = state.pose::<L>(token);
        let rotation = pose.body_quaternion.rotation();
        let rows = Rows::new(c, &rotation, pose.ball, pose.body);
        Self { velocities: state.velocities(token), rows, rotation, pose }
    }
}

#[inline(always)]
fn step_on_ball<L: Lane, V: Value<L>, const JOINTS: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
) {
    let friction = friction(c, &start.rows, &start.velocities);
    let free = free_velocities(c, token, state, start, torques);
    let delassus = Delassus::new::<JOINTS>(c, &start.rows);
    let mut impulses = state.impulses(token);
    let mut residuals = start.rows.residuals(c, &free);
    delassus.add_effect::<JOINTS>(&impulses, &mut residuals);
    let mut normal_estimate = impulses.normals;
    let mut old = impulses;
    for _ in 0..SWEEPS {
        old = impulses;
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut normal_estimate, &mut impulses, &mut residuals);
    }
    let mut open = Delassus::<L, V>::unsettled(c, &old, &impulses);
    let mut sweeps = SWEEPS;
    while L::any(open) && sweeps < MOST_SWEEPS {
        // Settled robots keep their impulses while their neighbors continue.
        let (old, old_residuals, old_estimate) = (impulses, residuals, normal_estimate);
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut normal_estimate, &mut impulses, &mut residuals);
        let still = Delassus::<L, V>::unsettled(c, &old, &impulses);
        impulses = PerRow::select(open, &impulses, &old);
        residuals = PerRow::select(open, &residuals, &old_residuals);
        normal_estimate = select3(open, normal_estimate, old_estimate);
        open = open & still;
        sweeps += 1;
    }
    finish::<L, V, JOINTS>(c, token, state, start, (free, impulses), free.ball.x.zero());
}

/// Applies the impulses, integrates the pose and stores the result.
#[inline(always)]
pub fn finish<L: Lane, V: Value<L>, const JOINTS: bool>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    start: &Start<L>,
    (mut velocities, impulses): (Velocities<L>, PerRow<L>),
    on_floor: L,
) {
    start.rows.apply::<JOINTS, V>(c, &impulses, &mut velocities);
    let pose = moved(c, &start.pose, &velocities);
    state.take(token, &pose, &velocities, &impulses, on_floor);
    (L::load(token, &state.steps) + 1.0).store(&mut state.steps);
    let zero = on_floor.zero();
    for cell in &mut state.push {
        zero.store(cell);
    }
}

/// Friction coefficients at the slip at the start of the step.
#[inline(always)]
pub fn friction<L: Lane, V: Value<L>>(c: &Constants<V>, rows: &Rows<L>, v: &Velocities<L>) -> Friction<L> {
    let like = v.ball.x;
    let (wheel_static, wheel_dynamic) = (c.wheel_static_friction.at(like), c.wheel_dynamic_friction.at(like));
    let (floor_static, floor_dynamic) = (c.floor_static_friction.at(like), c.floor_dynamic_friction.at(like));
    let mut out = Friction { wheels: [wheel_dynamic; 3], floor: floor_dynamic };
    let scale = c.critical_velocity_inverse_squared.at(like);
    // With equal coefficients the law gives exactly the dynamic one, so the branch does not change the bits of a lane.
    if L::any(wheel_dynamic.lt(wheel_static)) {
        for i in 0..3 {
            let slip = rows.slip_speed(c, v, i).squared() * scale;
            out.wheels[i] = stribeck(wheel_static, wheel_dynamic, slip);
        }
    }
    if L::any(floor_dynamic.lt(floor_static)) {
        let [x, y] = rows.floor_slip(c, v);
        let slip = x.mul_add(x, y.squared()) * scale;
        out.floor = stribeck(floor_static, floor_dynamic, slip);
    }
    out
}

/// Velocities at the end of the step without contact impulses.
#[inline(always)]
pub fn free_velocities<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    start: &Start<L>,
    torques: &Torques<L::Cell>,
) -> Velocities<L> {
    let before = &start.velocities;
    let like = before.ball.x;
    let [px, py, pz, ax, ay, az] = &state.push;
    let impulse = Vec3::new(L::load(token, px), L::load(token, py), L::load(token, pz));
    let angular_impulse = Vec3::new(L::load(token, ax), L::load(token, ay), L::load(token, az));

    let mut reaction = Vec3::zero(like);
    let mut spin_momentum = reaction;
    let torques = Vec3::load(token, torques);
    let wheel = [torques.x, torques.y, torques.z];
    for (i, torque) in wheel.into_iter().enumerate() {
        let u = c.u(i, like);
        reaction = reaction.plus(u, torque);
        spin_momentum = spin_momentum.plus(u, before.spins[i] * c.wheel_inertia.at(like));
    }
    // Gyroscopic torque at the midpoint of the step: an explicit step would add energy to a tumbling body.
    let explicit = gyroscopic(c, spin_momentum, before.body_rate).scaled_by(at3(c.body_inertia_inverse, like));
    let midpoint = gyroscopic(c, spin_momentum, before.body_rate.plus(explicit, c.half_dt.at(like)));
    let body_angular_impulse =
        start.rotation.apply_transposed(angular_impulse).plus(reaction + midpoint, c.sim_dt.at(like));

    let (drag, fall) = (c.ball_drag.at(like), c.gravity_dt.at(like));
    let body = before.body.plus(impulse, c.body_mass_inverse.at(like));
    let spin = c.wheel_dt_inverse_inertia.at(like);
    Velocities {
        ball: Vec3::new(before.ball.x * drag, before.ball.y * drag, before.ball.z - fall),
        ball_rate: before.ball_rate,
        body: Vec3::new(body.x, body.y, body.z - fall),
        body_rate: before.body_rate + body_angular_impulse.scaled_by(at3(c.body_inertia_inverse, like)),
        spins: [
            wheel[0].mul_add(spin, before.spins[0]),
            wheel[1].mul_add(spin, before.spins[1]),
            wheel[2].mul_add(spin, before.spins[2]),
        ],
    }
}

/// Gyroscopic torque of body rotation and wheel spins on the body, body frame, N·m.
#[inline(always)]
fn gyroscopic<L: Lane, V: Value<L>>(c: &Constants<V>, spin_momentum: Vec3<L>, rate: Vec3<L>) -> Vec3<L> {
    (rate.scaled_by(at3(c.body_inertia, rate.x)) - spin_momentum).cross(rate)
}

/// Pose after a step with the velocities `v`.
#[inline(always)]
fn moved<L: Lane, V: Value<L>>(c: &Constants<V>, pose: &Pose<L>, v: &Velocities<L>) -> Pose<L> {
    let (dt, half) = (c.sim_dt.at(v.ball.x), c.half_dt.at(v.ball.x));
    Pose {
        ball: pose.ball.plus(v.ball, dt),
        ball_quaternion: pose.ball_quaternion.turned(v.ball_rate * half),
        body: pose.body.plus(v.body, dt),
        body_quaternion: pose.body_quaternion.turned_in_own_frame(v.body_rate * half),
        wheel_angles: [
            encoder_rate(c, v, 0).mul_add(dt, pose.wheel_angles[0]),
            encoder_rate(c, v, 1).mul_add(dt, pose.wheel_angles[1]),
            encoder_rate(c, v, 2).mul_add(dt, pose.wheel_angles[2]),
        ],
    }
}
