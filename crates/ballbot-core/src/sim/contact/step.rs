//! One time step, and many.

use super::constants::Constants;
use super::fallen;
use super::memory::{Memory, Torques};
use super::rows::{PerRow, Rows, Velocities};
use super::solve::{Delassus, Friction, JointFriction, SWEEPS};
use crate::lanes::{Eight, Lane, Quat, Rotation, Scalar, Vec3, Wide, exp_of_negative};
use fearless_simd::{Level, Simd, dispatch};

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
    // Fused multiply-adds are instructions only where the compiler knows that the processor has them.
    dispatch!(Level::new(), simd => {
        let _ = simd;
        advance_lanes::<f64>(c, Scalar, memory, torques, steps);
    });
}

/// Advances eight robots; each moves as [`advance`] would move it, to the last bit.
pub fn advance_eight(c: &Constants, memory: &mut Memory<Eight>, torques: &Torques<Eight>, steps: usize) {
    dispatch!(Level::new(), simd => advance_wide(simd, c, memory, torques, steps));
}

#[inline(always)]
fn advance_wide<S: Simd>(simd: S, c: &Constants, memory: &mut Memory<Eight>, torques: &Torques<Eight>, steps: usize) {
    advance_lanes::<Wide<S>>(c, simd, memory, torques, steps);
}

#[inline(always)]
fn advance_lanes<L: Lane>(
    c: &Constants,
    token: L::Token,
    memory: &mut Memory<L::Cell>,
    torques: &Torques<L::Cell>,
    steps: usize,
) {
    let torques = Vec3::<L>::load(token, torques);
    let joint_friction = JointFriction {
        dry: L::load(token, &memory.joint_coulomb_friction) * c.sim_dt,
        viscous: L::load(token, &memory.joint_viscous_friction) * c.sim_dt,
    };
    let zero = torques.x.zero();
    if L::any(zero.lt(joint_friction.dry) | zero.lt(joint_friction.viscous)) {
        for _ in 0..steps {
            step::<L, true>(c, token, memory, torques, &joint_friction);
        }
    } else {
        for _ in 0..steps {
            step::<L, false>(c, token, memory, torques, &joint_friction);
        }
    }
}

#[inline(always)]
fn step<L: Lane, const JOINTS: bool>(
    c: &Constants,
    token: L::Token,
    memory: &mut Memory<L::Cell>,
    torques: Vec3<L>,
    joint_friction: &JointFriction<L>,
) {
    let pose = load_pose(token, memory);
    let before = load_velocities(token, memory);
    let rotation = pose.body_quaternion.rotation();
    let rows = Rows::new(c, &rotation, pose.ball, pose.body);
    let friction = friction(c, &rows, &before);
    let free = free_velocities(c, token, memory, &rotation, &before, torques);
    let delassus = Delassus::new::<JOINTS>(c, &rows);

    let mut impulses = load_impulses(token, memory);
    let mut residuals = rows.residuals(c, &free);
    delassus.add_effect::<JOINTS>(&impulses, &mut residuals);
    for _ in 0..SWEEPS {
        delassus.sweep::<JOINTS>(&friction, joint_friction, &mut impulses, &mut residuals);
    }

    let near = fallen::near(c, &pose, &rotation, &before, &rows);
    let mut after = free;
    let mut on_floor = torques.x.zero();
    if L::any(near) {
        let contacts = fallen::Contacts::new(c, &pose, &rotation, &rows);
        let solved = contacts.solve::<JOINTS>(c, &rows, &delassus, &friction, joint_friction, &free, impulses);
        impulses = PerRow::select(near, solved.impulses, impulses);
        after = Velocities::select(near, &solved.free, &after);
        on_floor = L::select(near, solved.on_floor, on_floor);
    }
    rows.apply::<JOINTS>(c, &impulses, &mut after);

    let moved = moved(c, &pose, &after);
    store(memory, &moved, &after, &impulses, on_floor, (&pose, &before, token));
}

#[inline(always)]
fn load_pose<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> Pose<L> {
    let angles = Vec3::load(token, &memory.wheel_angles);
    Pose {
        ball: Vec3::load(token, &memory.ball_position),
        ball_quaternion: Quat::load(token, &memory.ball_quaternion),
        body: Vec3::load(token, &memory.body_position),
        body_quaternion: Quat::load(token, &memory.body_quaternion),
        wheel_angles: [angles.x, angles.y, angles.z],
    }
}

#[inline(always)]
fn load_velocities<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> Velocities<L> {
    let spins = Vec3::load(token, &memory.wheel_spins);
    Velocities {
        ball: Vec3::load(token, &memory.ball_velocity),
        ball_rate: Vec3::load(token, &memory.ball_rate),
        body: Vec3::load(token, &memory.body_velocity),
        body_rate: Vec3::load(token, &memory.body_rate),
        spins: [spins.x, spins.y, spins.z],
    }
}

#[inline(always)]
fn load_impulses<L: Lane>(token: L::Token, memory: &Memory<L::Cell>) -> PerRow<L> {
    let three = |cells: &[L::Cell; 3]| {
        let v = Vec3::load(token, cells);
        [v.x, v.y, v.z]
    };
    PerRow {
        floor: three(&memory.floor_impulse),
        normals: three(&memory.normal_impulses),
        drives: three(&memory.drive_impulses),
        joints: three(&memory.joint_impulses),
    }
}

/// Friction coefficients at the present slip.
#[inline(always)]
fn friction<L: Lane>(c: &Constants, rows: &Rows<L>, v: &Velocities<L>) -> Friction<L> {
    let like = v.ball.x;
    let mut out = Friction { wheels: [like.splat(c.wheel_dynamic_friction); 3], floor: like.splat(c.floor_dynamic_friction) };
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

/// Friction coefficient at a slip speed, given as its squared ratio to the critical velocity.
#[inline(always)]
fn stribeck<L: Lane>(fixed: f64, moving: f64, squared_ratio: L) -> L {
    /// Below this four terms of the exponential's series are exact.
    const SMALL: f64 = 1e-3;
    let one = squared_ratio.splat(1.0);
    let x = -squared_ratio;
    let mut share = x.mul_add_all(0.25, one);
    for n in [3.0, 2.0, 1.0] {
        share = (share * x).mul_add_all(1.0 / n, one);
    }
    let large = !squared_ratio.le(squared_ratio.splat(SMALL));
    if L::any(large) {
        share = L::select(large, exp_of_negative(squared_ratio), share);
    }
    share.mul_add_all(fixed - moving, one * moving)
}

/// Velocities at the end of the step if nothing touched.
#[inline(always)]
fn free_velocities<L: Lane>(
    c: &Constants,
    token: L::Token,
    memory: &Memory<L::Cell>,
    rotation: &Rotation<L>,
    before: &Velocities<L>,
    torques: Vec3<L>,
) -> Velocities<L> {
    let like = before.ball.x;
    let dt = c.sim_dt;
    let fall = c.gravity * dt;
    let drag = 1.0 - dt * c.ball_viscous_friction * c.ball_mass_inverse;
    let [fx, fy, fz, tx, ty, tz] = &memory.push;
    let force = Vec3::new(L::load(token, fx), L::load(token, fy), L::load(token, fz));
    let turning = Vec3::new(L::load(token, tx), L::load(token, ty), L::load(token, tz));

    let mut reaction = Vec3::splat(like, &[0.0; 3]);
    let mut spin_momentum = reaction;
    let wheel = [torques.x, torques.y, torques.z];
    for i in 0..3 {
        let u = Vec3::splat(like, &c.u[i]);
        reaction = reaction.plus(u, wheel[i]);
        spin_momentum = spin_momentum.plus(u, before.spins[i] * c.wheel_inertia);
    }
    // Euler's equations at the middle of the step: an explicit step would pump energy into a tumbling body.
    let gyroscopic = |rate: Vec3<L>| (rate.scaled_by(&c.body_inertia) - spin_momentum).cross(rate);
    let half = before.body_rate.plus_all(gyroscopic(before.body_rate).scaled_by(&c.body_inertia_inverse), 0.5 * dt);
    let turned = rotation.apply_transposed(turning).plus_all(reaction + gyroscopic(half), dt);

    let body = before.body.plus_all(force, c.body_mass_inverse);
    let spun = |i: usize| wheel[i].mul_add_all(dt / c.wheel_inertia, before.spins[i]);
    Velocities {
        ball: Vec3::new(before.ball.x * drag, before.ball.y * drag, before.ball.z - fall),
        ball_rate: before.ball_rate,
        body: Vec3::new(body.x, body.y, body.z - fall),
        body_rate: before.body_rate + turned.scaled_by(&c.body_inertia_inverse),
        spins: [spun(0), spun(1), spun(2)],
    }
}

#[inline(always)]
fn moved<L: Lane>(c: &Constants, pose: &Pose<L>, v: &Velocities<L>) -> Pose<L> {
    let half = 0.5 * c.sim_dt;
    let angle = |i: usize| {
        let rate = Vec3::splat(v.ball.x, &c.u[i]).dot(v.body_rate) + v.spins[i];
        rate.mul_add_all(c.sim_dt, pose.wheel_angles[i])
    };
    Pose {
        ball: pose.ball.plus_all(v.ball, c.sim_dt),
        ball_quaternion: pose.ball_quaternion.turned(v.ball_rate.scaled_by(&[half; 3])),
        body: pose.body.plus_all(v.body, c.sim_dt),
        body_quaternion: pose.body_quaternion.turned_in_own_frame(v.body_rate.scaled_by(&[half; 3])),
        wheel_angles: [angle(0), angle(1), angle(2)],
    }
}

/// Writes what the step led to; a robot whose velocities are not finite stays where it was and is marked.
#[inline(always)]
fn store<L: Lane>(
    memory: &mut Memory<L::Cell>,
    pose: &Pose<L>,
    v: &Velocities<L>,
    impulses: &PerRow<L>,
    on_floor: L,
    (old_pose, old, token): (&Pose<L>, &Velocities<L>, L::Token),
) {
    let spins = Vec3::new(v.spins[0], v.spins[1], v.spins[2]);
    let size = v.ball.norm_squared()
        + v.ball_rate.norm_squared()
        + v.body.norm_squared()
        + v.body_rate.norm_squared()
        + spins.norm_squared();
    let finite = size.lt(size.splat(f64::MAX));
    if L::any(!finite) {
        let old_impulses = load_impulses(token, memory);
        let marked = L::load(token, &memory.diverged);
        L::select(finite, marked, size.splat(1.0)).store(&mut memory.diverged);
        write(
            memory,
            &Pose {
                ball: Vec3::select(finite, pose.ball, old_pose.ball),
                ball_quaternion: Quat::select(finite, pose.ball_quaternion, old_pose.ball_quaternion),
                body: Vec3::select(finite, pose.body, old_pose.body),
                body_quaternion: Quat::select(finite, pose.body_quaternion, old_pose.body_quaternion),
                wheel_angles: select3(finite, pose.wheel_angles, old_pose.wheel_angles),
            },
            &Velocities::select(finite, v, old),
            &PerRow::select(finite, *impulses, old_impulses),
        );
    } else {
        write(memory, pose, v, impulses);
    }
    on_floor.store(&mut memory.bot_on_floor);
    let zero = on_floor.zero();
    for cell in &mut memory.push {
        zero.store(cell);
    }
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
    let three = |values: [L; 3]| Vec3::new(values[0], values[1], values[2]);
    pose.ball.store(&mut memory.ball_position);
    pose.ball_quaternion.store(&mut memory.ball_quaternion);
    pose.body.store(&mut memory.body_position);
    pose.body_quaternion.store(&mut memory.body_quaternion);
    three(pose.wheel_angles).store(&mut memory.wheel_angles);
    v.ball.store(&mut memory.ball_velocity);
    v.ball_rate.store(&mut memory.ball_rate);
    v.body.store(&mut memory.body_velocity);
    v.body_rate.store(&mut memory.body_rate);
    three(v.spins).store(&mut memory.wheel_spins);
    three(impulses.floor).store(&mut memory.floor_impulse);
    three(impulses.normals).store(&mut memory.normal_impulses);
    three(impulses.drives).store(&mut memory.drive_impulses);
    three(impulses.joints).store(&mut memory.joint_impulses);
}
