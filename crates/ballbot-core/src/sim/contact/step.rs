//! One time step, and many.

#[cfg(test)]
mod flops;

use super::constants::Constants;
use super::fallen;
use super::memory::{Memory, Torques};
use super::rows::{PerRow, Rows, Velocities, encoder_rate};
use super::solve::{Delassus, Friction, JointFriction, SWEEPS};
use crate::lanes::{EIGHT, Eight, Lane, Quat, Rotation, Scalar, Vec3, Wide, run_one};
use crate::sim::friction::stribeck;
use fearless_simd::Simd;

/// Squared speeds and rates from which arithmetic would overflow soon.
const BEYOND_MEANING: f64 = 1e30;

/// Where the robot is.
pub struct Pose<L> {
    pub ball: Vec3<L>,
    pub ball_quaternion: Quat<L>,
    /// CoM.
    pub body: Vec3<L>,
    pub body_quaternion: Quat<L>,
    pub wheel_angles: [L; 3],
}

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
    if L::any(fallen::near(c, &start)) {
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
        let pose = load_pose::<L>(token, memory);
        let rotation = pose.body_quaternion.rotation();
        let rows = Rows::new(c, &rotation, pose.ball, pose.body);
        Self { velocities: load_velocities(token, memory), rows, rotation, pose }
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
    let mut impulses = load_impulses(token, memory);
    let mut residuals = start.rows.residuals(c, &free);
    delassus.add_effect::<JOINTS>(&impulses, &mut residuals);
    for _ in 0..SWEEPS {
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut impulses, &mut residuals);
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
    store(memory, token, &pose, &velocities, &impulses);
    on_floor.store(&mut memory.bot_on_floor);
    (L::load(token, &memory.steps) + 1.0).store(&mut memory.steps);
    let zero = on_floor.zero();
    for cell in &mut memory.push {
        zero.store(cell);
    }
}

#[inline(always)]
fn load_pose<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> Pose<L> {
    Pose {
        ball: Vec3::load(token, &memory.ball_position),
        ball_quaternion: Quat::load(token, &memory.ball_quaternion),
        body: Vec3::load(token, &memory.body_position),
        body_quaternion: Quat::load(token, &memory.body_quaternion),
        wheel_angles: load3(token, &memory.wheel_angles),
    }
}

#[inline(always)]
fn load_velocities<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> Velocities<L> {
    Velocities {
        ball: Vec3::load(token, &memory.ball_velocity),
        ball_rate: Vec3::load(token, &memory.ball_rate),
        body: Vec3::load(token, &memory.body_velocity),
        body_rate: Vec3::load(token, &memory.body_rate),
        spins: load3(token, &memory.wheel_spins),
    }
}

#[inline(always)]
pub fn load_impulses<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> PerRow<L> {
    PerRow {
        floor: load3(token, &memory.floor_impulse),
        normals: load3(token, &memory.normal_impulses),
        drives: load3(token, &memory.drive_impulses),
        joints: load3(token, &memory.joint_impulses),
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
    for i in 0..3 {
        let u = Vec3::splat(like, &c.u[i]);
        reaction = reaction.plus(u, wheel[i]);
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

/// Writes what the step led to; a robot whose velocities are beyond meaning stays where it was and is marked.
#[inline(always)]
fn store<L: Lane>(
    memory: &mut Memory<L::Cell>,
    token: L::Token,
    pose: &Pose<L>,
    v: &Velocities<L>,
    impulses: &PerRow<L>,
) {
    let spins = Vec3::new(v.spins[0], v.spins[1], v.spins[2]);
    let size = v.ball.norm_squared()
        + v.ball_rate.norm_squared()
        + v.body.norm_squared()
        + v.body_rate.norm_squared()
        + spins.norm_squared();
    let finite = size.lt(size.splat(BEYOND_MEANING));
    if !L::any(!finite) {
        write(memory, pose, v, impulses);
        return;
    }
    let (old_pose, old) = (load_pose::<L>(token, memory), load_velocities(token, memory));
    let old_impulses = load_impulses(token, memory);
    let marked = L::load(token, &memory.diverged);
    L::select(finite, marked, size.splat(1.0)).store(&mut memory.diverged);
    let pose = Pose {
        ball: Vec3::select(finite, pose.ball, old_pose.ball),
        ball_quaternion: Quat::select(finite, pose.ball_quaternion, old_pose.ball_quaternion),
        body: Vec3::select(finite, pose.body, old_pose.body),
        body_quaternion: Quat::select(finite, pose.body_quaternion, old_pose.body_quaternion),
        wheel_angles: select3(finite, pose.wheel_angles, old_pose.wheel_angles),
    };
    write(memory, &pose, &Velocities::select(finite, v, &old), &PerRow::select(finite, *impulses, old_impulses));
}

#[inline(always)]
fn load3<L: Lane>(token: L::Token, [a, b, c]: &[L::Cell; 3]) -> [L; 3] {
    [L::load(token, a), L::load(token, b), L::load(token, c)]
}

#[inline(always)]
fn store3<L: Lane>([a, b, c]: [L; 3], cells: &mut [L::Cell; 3]) {
    a.store(&mut cells[0]);
    b.store(&mut cells[1]);
    c.store(&mut cells[2]);
}

#[inline(always)]
fn select3<L: Lane>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}

impl<L: Lane> PerRow<L> {
    /// `yes` where `mask` is true, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        Self {
            floor: select3(mask, yes.floor, no.floor),
            normals: select3(mask, yes.normals, no.normals),
            drives: select3(mask, yes.drives, no.drives),
            joints: select3(mask, yes.joints, no.joints),
        }
    }
}

impl<L: Lane> Velocities<L> {
    /// `yes` where `mask` is true, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            ball: Vec3::select(mask, yes.ball, no.ball),
            ball_rate: Vec3::select(mask, yes.ball_rate, no.ball_rate),
            body: Vec3::select(mask, yes.body, no.body),
            body_rate: Vec3::select(mask, yes.body_rate, no.body_rate),
            spins: select3(mask, yes.spins, no.spins),
        }
    }
}

#[inline(always)]
fn write<L: Lane>(memory: &mut Memory<L::Cell>, pose: &Pose<L>, v: &Velocities<L>, impulses: &PerRow<L>) {
    pose.ball.store(&mut memory.ball_position);
    pose.ball_quaternion.store(&mut memory.ball_quaternion);
    pose.body.store(&mut memory.body_position);
    pose.body_quaternion.store(&mut memory.body_quaternion);
    store3(pose.wheel_angles, &mut memory.wheel_angles);
    v.ball.store(&mut memory.ball_velocity);
    v.ball_rate.store(&mut memory.ball_rate);
    v.body.store(&mut memory.body_velocity);
    v.body_rate.store(&mut memory.body_rate);
    store3(v.spins, &mut memory.wheel_spins);
    store3(impulses.floor, &mut memory.floor_impulse);
    store3(impulses.normals, &mut memory.normal_impulses);
    store3(impulses.drives, &mut memory.drive_impulses);
    store3(impulses.joints, &mut memory.joint_impulses);
}
