//! Rows, terms and terminations shared by tasks.

use super::{Row, Rows, Sensed, Step, Term, Terms};
use ballbot_base::lanes::{Heading, Lane};
use ballbot_base::wheels::Wheels;

/// Reasons for termination of all tasks that end in a fall, for [`fallen`].
pub(super) const FALLS: &[(&str, &str)] = &[
    ("tilt", "the tilt from the equilibrium exceeds `fall_tilt`"),
    ("bot_on_floor", "the body or a wheel touches the floor"),
];

/// Which of [`FALLS`] ends the episode, plus 1; 0 if none does.
#[inline(always)]
pub(super) fn fallen<L: Lane>(step: &Step<'_, L>, fall_tilt: f64) -> L {
    let zero = step.tilt.zero();
    let tilted = zero.splat(fall_tilt).lt(step.tilt);
    L::select(tilted, zero.splat(1.0), L::select(step.on_floor, zero.splat(2.0), zero))
}

/// Attitude without the heading, rates of body and wheels.
#[inline(always)]
pub(super) fn body_rows<L: Lane>(sensed: &Sensed<'_, L>, rows: &mut impl Rows<L>) {
    let state = sensed.state;
    let up = state.body_quaternion.rotation().rows[2];
    let rate = state.body_angular_velocity;
    let Wheels([w0, w1, w2]) = state.wheel_speeds;
    rows.row(Row::of_vertical("gravity direction, body x", 1.0, 0.1), -up.x);
    rows.row(Row::of_vertical("gravity direction, body y", 1.0, 0.1), -up.y);
    rows.row(Row::of_vertical("gravity direction, body z", 1.0, 0.1), -up.z);
    rows.row(Row::new("body rate about body x", "rad/s", 20.0, 1.0), rate.x);
    rows.row(Row::new("body rate about body y", "rad/s", 20.0, 1.0), rate.y);
    rows.row(Row::new("body rate about body z", "rad/s", 20.0, 1.0), rate.z);
    rows.row(Row::of_wheel("wheel speed 0", 200.0, 5.0), w0);
    rows.row(Row::of_wheel("wheel speed 1", 200.0, 5.0), w1);
    rows.row(Row::of_wheel("wheel speed 2", 200.0, 5.0), w2);
}

/// Velocity of the ball.
#[inline(always)]
pub(super) fn velocity_rows<L: Lane>(sensed: &Sensed<'_, L>, heading: &Heading<L>, rows: &mut impl Rows<L>) {
    let [vx, vy] = heading.of(sensed.state.ball_velocity.x, sensed.state.ball_velocity.y);
    rows.row(Row::new("ball velocity, heading x", "m/s", 10.0, 0.2), vx);
    rows.row(Row::new("ball velocity, heading y", "m/s", 10.0, 0.2), vy);
}

/// The last action.
#[inline(always)]
pub(super) fn action_rows<L: Lane>(sensed: &Sensed<'_, L>, rows: &mut impl Rows<L>) {
    let Wheels([a0, a1, a2]) = sensed.last_action;
    rows.row(Row::new("last action, wheel 0", "", 1.0, 0.5), a0);
    rows.row(Row::new("last action, wheel 1", "", 1.0, 0.5), a1);
    rows.row(Row::new("last action, wheel 2", "", 1.0, 0.5), a2);
}

/// The reward of a step without a fall.
#[inline(always)]
pub(super) fn alive<L: Lane>(terminated: L::Mask, scale: f64, like: L, terms: &mut impl Terms<L>) {
    let value = L::select(terminated, like.zero(), like.splat(1.0));
    terms.term(Term::reward("alive", scale, "1, unless the step ends in a fall"), value);
}

/// The costs of motion of the body and of actions.
#[inline(always)]
pub(super) fn effort<L: Lane>(step: &Step<'_, L>, terms: &mut impl Terms<L>) {
    let zero = step.tilt.zero();
    let rate = step.state.body_angular_velocity.norm_squared().min(zero.splat(100.0));
    terms.term(Term::cost("rate", 0.01, "squared body rate in rad/s, at most 100"), rate);
    terms.term(Term::cost("action", 0.02, "mean squared action"), mean_square(step.action));
    terms.term(
        Term::cost("action_change", 0.02, "mean squared change of the action"),
        mean_square(step.action - step.last_action),
    );
}

#[inline(always)]
fn mean_square<L: Lane>(Wheels([a, b, c]): Wheels<L>) -> L {
    (a.squared() + b.squared() + c.squared()) / 3.0
}

/// e² / (e² + s²): 0 without an error e, 1/2 where it is `scale`, never above 1.
#[inline(always)]
pub(super) fn bounded_error<L: Lane>(squared: L, scale: f64) -> L {
    squared / (squared + scale * scale)
}

/// x² + y².
#[inline(always)]
pub(super) fn squared_norm<L: Lane>([x, y]: [L; 2]) -> L {
    x.mul_add(x, y.squared())
}

/// A vector shortened to at most `length`.
#[inline(always)]
pub fn limited<L: Lane>([x, y]: [L; 2], length: f64) -> [L; 2] {
    let most = x.splat(length);
    let share = most / x.mul_add(x, y.squared()).sqrt().max(most);
    [x * share, y * share]
}
