//! Phases of a time step with any contacts: start, free velocities, finish.

use super::constants::{Constants, at3};
use super::encoder::encoder_rates;
use super::ripple::Ripple;
use super::rows::Rows;
use super::state::ContactState;
use super::types::{Actions, PerRow, Pose, Velocities};
use ballbot_base::lanes::{Lane, Rotation, Value, Vec3};
use ballbot_base::wheels::Wheels;

/// The robot at the start of a step.
pub struct Start<L: Lane> {
    pub pose: Pose<L>,
    pub velocities: Velocities<L>,
    pub rotation: Rotation<L>,
    pub rows: Rows<L>,
}

impl<L: Lane> Start<L> {
    /// The robot at the start of a step; with `RIPPLE` also with what only some robots have: inclined rollers and rims that
    /// are not round.
    #[inline(always)]
    pub fn new<const RIPPLE: bool, V: Value<L>>(
        c: &Constants<V>,
        token: L::Token,
        state: &ContactState<L::Cell>,
    ) -> Self {
        let (pose, velocities) = (state.pose::<L>(token), state.velocities(token));
        let rotation = pose.body_quaternion.rotation();
        let mut rows = Rows::new(c, &rotation, pose.ball, pose.body);
        if RIPPLE {
            rows = rows.with_inclined_rollers(c, &rotation).with_ripple(c, Ripple::new(c, &pose, &velocities));
        }
        Self { velocities, rows, rotation, pose }
    }
}

/// Moves the robot with the velocities at the end of the step and writes its pose.
#[inline(always)]
pub fn finish<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &mut ContactState<L::Cell>,
    start: &Start<L>,
    (velocities, impulses): (&Velocities<L>, &PerRow<L>),
    on_floor: L,
) {
    let pose = moved(c, &start.pose, velocities);
    state.take(token, &pose, velocities, impulses, on_floor);
    (L::load(token, &state.steps) + 1.0).store(&mut state.steps);
    let zero = on_floor.zero();
    for cell in &mut state.push {
        zero.store(cell);
    }
}

/// Velocities at the end of the step without contacts.
#[inline(always)]
pub fn free_velocities<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    token: L::Token,
    state: &ContactState<L::Cell>,
    start: &Start<L>,
    actions: &Actions<L::Cell>,
) -> Velocities<L> {
    let before = &start.velocities;
    let like = before.ball.x;
    let [px, py, pz, ax, ay, az] = &state.push;
    let impulse = Vec3::new(L::load(token, px), L::load(token, py), L::load(token, pz));
    let angular_impulse = Vec3::new(L::load(token, ax), L::load(token, ay), L::load(token, az));

    let mut reaction = Vec3::zero(like);
    let mut spin_momentum = reaction;
    let torques = Wheels::<L>::load(token, &actions.torques);
    for (i, torque) in torques.into_iter().enumerate() {
        let u = c.u(i, like);
        reaction = reaction.plus(u, torque);
        spin_momentum = spin_momentum.plus(u, before.spins[i] * c.wheel_inertia.at(like));
    }
    // Euler's equations at the midpoint of the step: an explicit step would add energy to a tumbling body.
    let explicit = gyroscopic(c, spin_momentum, before.body_rate).scaled_by(at3(c.body_inertia_inverse, like));
    let midpoint = gyroscopic(c, spin_momentum, before.body_rate.plus(explicit, c.half_dt.at(like)));
    let body_angular_impulse =
        start.rotation.apply_transposed(angular_impulse).plus(reaction + midpoint, c.sim_dt.at(like));

    let drag = c.ball_drag.at(like);
    let body = before.body.plus(impulse, c.body_mass_inverse.at(like));
    let spin = c.wheel_dt_inverse_inertia.at(like);
    Velocities {
        ball: Vec3::new(before.ball.x * drag, before.ball.y * drag, before.ball.z)
            - Vec3::load(token, &actions.ball_fall),
        ball_rate: before.ball_rate,
        body: body - Vec3::load(token, &actions.body_fall),
        body_rate: before.body_rate + body_angular_impulse.scaled_by(at3(c.body_inertia_inverse, like)),
        spins: before.spins.plus(torques, spin),
    }
}

/// Torque of the body's own rotation and of the wheels' spins on the body, principal frame.
#[inline(always)]
fn gyroscopic<L: Lane, V: Value<L>>(c: &Constants<V>, spin_momentum: Vec3<L>, rate: Vec3<L>) -> Vec3<L> {
    (rate.scaled_by(at3(c.body_inertia, rate.x)) - spin_momentum).cross(rate)
}

#[inline(always)]
fn moved<L: Lane, V: Value<L>>(c: &Constants<V>, pose: &Pose<L>, v: &Velocities<L>) -> Pose<L> {
    let (dt, half) = (c.sim_dt.at(v.ball.x), c.half_dt.at(v.ball.x));
    Pose {
        ball: pose.ball.plus(v.ball, dt),
        ball_quaternion: pose.ball_quaternion.turned(v.ball_rate * half),
        body: pose.body.plus(v.body, dt),
        body_quaternion: pose.body_quaternion.turned_in_own_frame(v.body_rate * half),
        wheel_angles: pose.wheel_angles.plus(encoder_rates(c, v), dt),
    }
}
