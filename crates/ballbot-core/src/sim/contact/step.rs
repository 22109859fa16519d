//! One time step, and many.

#[cfg(test)]
mod flops;

use super::constants::Constants;
use super::fallen;
use super::memory::{Memory, Torques};
use super::quantities::{PerRow, Pose, Velocities, select3};
use super::rows::{Rows, encoder_rate};
use super::solve::{Delassus, Friction, JointFriction, MOST_SWEEPS, SWEEPS};
use crate::lanes::{EIGHT, Eight, Lane, Rotation, Scalar, Vec3, Wide, run_one};
use crate::sim::friction::stribeck;
use fearless_simd::Simd;

/// Advances one robot by `steps` time steps under constant torques.
pub fn advance(c: &Constants, memory: &mut Memory<f64>, torques: &Torques<f64>, steps: usize) {
    run_one(
        #[inline(always)]
        || {
            for _ in 0..steps {
                advance_one(c, memory, torques);
            }
        },
    );
}

#[inline(always)]
fn advance_one(c: &Constants, memory: &mut Memory<f64>, torques: &Torques<f64>) {
    if !step::<f64>(c, Scalar, memory, torques) {
        fallen::step(c, memory, torques);
    }
}

/// Advances eight robots; each moves as [`advance`] would move it, to the last bit.
#[inline(always)]
pub fn advance_wide<S: Simd>(
    simd: S,
    c: &Constants,
    memory: &mut Memory<Eight>,
    torques: &Torques<Eight>,
    steps: usize,
) {
    for _ in 0..steps {
        if !step::<Wide<S>>(c, simd, memory, torques) {
            one_by_one(c, memory, torques);
        }
    }
}

/// A step of eight robots of which some have fallen.
#[cold]
fn one_by_one(c: &Constants, memory: &mut Memory<Eight>, torques: &Torques<Eight>) {
    for i in 0..EIGHT {
        let mut one = memory.lane(i);
        advance(c, &mut one, &[torques[0].0[i], torques[1].0[i], torques[2].0[i]], 1);
        memory.set_lane(i, &one);
    }
}

/// One step of robots of which none has fallen; false, and nothing done, if one has.
#[inline(always)]
fn step<L: Lane>(c: &Constants, token: L::Token, memory: &mut Memory<L::Cell>, torques: &Torques<L::Cell>) -> bool {
    let start = Start::new(c, token, memory);
    if L::any(fallen::near(c, &start, token, &memory.push)) {
        return false;
    }
    let joint_friction = JointFriction::load(c, token, memory);
    if joint_friction.any() {
        step_on_ball::<L, true>(c, token, memory, torques, &start, &joint_friction);
    } else {
        step_on_ball::<L, false>(c, token, memory, torques, &start, &joint_friction);
    }
    true
}

/// The robot at the start of a step.
pub struct Start<L> {
    pub pose: Pose<L>,
    pub velocities: Velocities<L>,
    pub rotation: Rotation<L>,
    pub rows: Rows<L>,
}

impl<L: Lane> Start<L> {
    #[inline(always)]
    pub fn new(c: &Constants, token: L::Token, memory: &Memory<L::Cell>) -> Self {
        let pose = memory.pose::<L>(token);
        let rotation = pose.body_quaternion.rotation();
        let rows = Rows::new(c, &rotation, pose.ball, pose.body);
        Self { velocities: memory.velocities(token), rows, rotation, pose }
    }
}

#[inline(always)]
fn step_on_ball<L: Lane, const JOINTS: bool>(
    c: &Constants,
    token: L::Token,
    memory: &mut Memory<L::Cell>,
    torques: &Torques<L::Cell>,
    start: &Start<L>,
    joint_friction: &JointFriction<L>,
) {
    let friction = friction(c, &start.rows, &start.velocities);
    let free = free_velocities(c, token, memory, start, torques);
    let delassus = Delassus::new::<JOINTS>(c, &start.rows);
    let mut impulses = memory.impulses(token);
    let mut residuals = start.rows.residuals(c, &free);
    delassus.add_effect::<JOINTS>(&impulses, &mut residuals);
    let mut bearing = impulses.normals;
    let mut old = impulses;
    for _ in 0..SWEEPS {
        old = impulses;
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut bearing, &mut impulses, &mut residuals);
    }
    let mut open = Delassus::unsettled(c, &old, &impulses);
    let mut sweeps = SWEEPS;
    while L::any(open) && sweeps < MOST_SWEEPS {
        // Robots that have settled keep what they have, whatever their neighbours need.
        let (old, old_residuals, old_bearing) = (impulses, residuals, bearing);
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut bearing, &mut impulses, &mut residuals);
        let still = Delassus::unsettled(c, &old, &impulses);
        impulses = PerRow::select(open, &impulses, &old);
        residuals = PerRow::select(open, &residuals, &old_residuals);
        bearing = select3(open, bearing, old_bearing);
        open = open & still;
        sweeps += 1;
    }
    finish::<L, JOINTS>(c, token, memory, start, (free, impulses), free.ball.x.zero());
}

/// Applies the impulses, moves the robot and writes where it is.
#[inline(always)]
pub fn finish<L: Lane, const JOINTS: bool>(
    c: &Constants,
    token: L::Token,
    memory: &mut Memory<L::Cell>,
    start: &Start<L>,
    (mut velocities, impulses): (Velocities<L>, PerRow<L>),
    on_floor: L,
) {
    start.rows.apply::<JOINTS>(c, &impulses, &mut velocities);
    let pose = moved(c, &start.pose, &velocities);
    memory.take(token, &pose, &velocities, &impulses, on_floor);
    (L::load(token, &memory.steps) + 1.0).store(&mut memory.steps);
    let zero = on_floor.zero();
    for cell in &mut memory.push {
        zero.store(cell);
    }
}

/// Friction coefficients at the present slip.
#[inline(always)]
pub fn friction<L: Lane>(c: &Constants, rows: &Rows<L>, v: &Velocities<L>) -> Friction<L> {
    let like = v.ball.x;
    let mut out =
        Friction { wheels: [like.splat(c.wheel_dynamic_friction); 3], floor: like.splat(c.floor_dynamic_friction) };
    let scale = c.critical_velocity_inverse * c.critical_velocity_inverse;
    if c.wheel_static_friction > c.wheel_dynamic_friction {
        for i in 0..3 {
            let slip = rows.slip_speed(c, v, i).squared() * scale;
            out.wheels[i] = stribeck(c.wheel_static_friction, c.wheel_dynamic_friction, slip);
        }
    }
    if c.floor_static_friction > c.floor_dynamic_friction {
        let [x, y] = rows.floor_slip(c, v);
        let slip = x.mul_add(x, y.squared()) * scale;
        out.floor = stribeck(c.floor_static_friction, c.floor_dynamic_friction, slip);
    }
    out
}

/// Velocities at the end of the step if nothing touched.
#[inline(always)]
pub fn free_velocities<L: Lane>(
    c: &Constants,
    token: L::Token,
    memory: &Memory<L::Cell>,
    start: &Start<L>,
    torques: &Torques<L::Cell>,
) -> Velocities<L> {
    let before = &start.velocities;
    let like = before.ball.x;
    let dt = c.sim_dt;
    let fall = c.gravity * dt;
    let drag = 1.0 - dt * c.ball_viscous_friction * c.ball_mass_inverse;
    let [fx, fy, fz, tx, ty, tz] = &memory.push;
    let force = Vec3::new(L::load(token, fx), L::load(token, fy), L::load(token, fz));
    let turning = Vec3::new(L::load(token, tx), L::load(token, ty), L::load(token, tz));

    let mut reaction = Vec3::splat(like, &[0.0; 3]);
    let mut spin_momentum = reaction;
    let torques = Vec3::load(token, torques);
    let wheel = [torques.x, torques.y, torques.z];
    for (i, torque) in wheel.into_iter().enumerate() {
        let u = Vec3::splat(like, &c.u[i]);
        reaction = reaction.plus(u, torque);
        spin_momentum = spin_momentum.plus(u, before.spins[i] * c.wheel_inertia);
    }
    // Euler's equations at the middle of the step: an explicit step would pump energy into a tumbling body.
    let first = gyroscopic(c, spin_momentum, before.body_rate).scaled_by(&c.body_inertia_inverse);
    let middle = gyroscopic(c, spin_momentum, before.body_rate.plus_all(first, 0.5 * dt));
    let turned = start.rotation.apply_transposed(turning).plus_all(reaction + middle, dt);

    let body = before.body.plus_all(force, c.body_mass_inverse);
    let spun = dt / c.wheel_inertia;
    Velocities {
        ball: Vec3::new(before.ball.x * drag, before.ball.y * drag, before.ball.z - fall),
        ball_rate: before.ball_rate,
        body: Vec3::new(body.x, body.y, body.z - fall),
        body_rate: before.body_rate + turned.scaled_by(&c.body_inertia_inverse),
        spins: [
            wheel[0].mul_add_all(spun, before.spins[0]),
            wheel[1].mul_add_all(spun, before.spins[1]),
            wheel[2].mul_add_all(spun, before.spins[2]),
        ],
    }
}

/// Torque of the body's own rotation and the wheels' spins on it, body frame.
#[inline(always)]
fn gyroscopic<L: Lane>(c: &Constants, spin_momentum: Vec3<L>, rate: Vec3<L>) -> Vec3<L> {
    (rate.scaled_by(&c.body_inertia) - spin_momentum).cross(rate)
}

#[inline(always)]
fn moved<L: Lane>(c: &Constants, pose: &Pose<L>, v: &Velocities<L>) -> Pose<L> {
    let half = 0.5 * c.sim_dt;
    Pose {
        ball: pose.ball.plus_all(v.ball, c.sim_dt),
        ball_quaternion: pose.ball_quaternion.turned(v.ball_rate.scaled_by(&[half; 3])),
        body: pose.body.plus_all(v.body, c.sim_dt),
        body_quaternion: pose.body_quaternion.turned_in_own_frame(v.body_rate.scaled_by(&[half; 3])),
        wheel_angles: [
            encoder_rate(c, v, 0).mul_add_all(c.sim_dt, pose.wheel_angles[0]),
            encoder_rate(c, v, 1).mul_add_all(c.sim_dt, pose.wheel_angles[1]),
            encoder_rate(c, v, 2).mul_add_all(c.sim_dt, pose.wheel_angles[2]),
        ],
    }
}
