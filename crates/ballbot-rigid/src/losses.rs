//! Rolling and spinning friction of the ball on the floor, and friction of the rollers, as in the contact model.

use super::bot::{Coordinates, join, split};
use super::robot::Robot;
use super::rows::{Motion, WheelContact};
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;

/// Impulses of a step, body axes.
pub struct Losses {
    /// Generalized impulse on the bot.
    pub on_bot: Coordinates,
    /// Impulse and angular impulse on the ball.
    pub on_ball: [Vector3<f64>; 2],
}

impl Losses {
    pub fn none() -> Self {
        Self { on_bot: Coordinates::zeros(), on_ball: [Vector3::zeros(); 2] }
    }
}

impl Robot {
    /// The losses of a step, with the loads of the previous step. Each removes at most the fraction of its speed that
    /// all together can remove without adding energy.
    pub fn losses(&self, motion: &Motion, contacts: &Wheels<WheelContact>) -> Losses {
        let (p, parts) = (&self.params, &self.parts);
        let share = p.loss_share();
        let floor_load = (motion.floor_normal.dot(&Vector3::from(self.sim_state.floor_force)) * self.dt).max(0.0);
        let [ball_velocity, ball_rate] = motion.velocities.ball;
        let [_, _, up] = motion.floor_axes;
        let spinning = up * up.dot(&ball_rate);
        let rolling = ball_rate - spinning;
        let braked = |rate: Vector3<f64>, lever: f64| {
            let speed = rate.norm().max(f64::MIN_POSITIVE);
            rate * -(lever * floor_load / speed).min(share * parts.ball_inertia)
        };
        let mut losses = Losses::none();
        losses.on_ball[1] = braked(rolling, p.floor_rolling_friction) + braked(spinning, p.floor_spinning_friction);

        let [velocity, rate, joints] = split(&motion.velocities.bot);
        for (i, contact) in contacts.iter().enumerate() {
            let direction = contact.normal.cross(&contact.drive);
            let point = self.bot.centers[i] - contact.normal * parts.wheel_radius;
            // A wheel with inclined rollers also moves along their free direction where it turns.
            let on_bot = join(&[direction, point.cross(&direction), Vector3::ith(i, contact.free_rim)]);
            let on_ball = contact.drive * parts.ball_radius;
            let of_spin = contact.free_rim * joints[i];
            let speed =
                direction.dot(&(velocity + rate.cross(&point) - ball_velocity)) + on_ball.dot(&ball_rate) + of_spin;
            let compliance = on_bot.dot(&(self.bot.mass_inverse * on_bot))
                + direction.norm_squared() / parts.ball_mass
                + on_ball.norm_squared() / parts.ball_inertia;
            if compliance == 0.0 {
                // A wheel whose axle points at the ball has no drive direction.
                continue;
            }
            let friction = p.roller_friction_slope.mul_add(speed.abs(), p.roller_friction);
            let most = friction.min(p.wheel_dynamic_friction) * self.sim_state.impulses[i].max(0.0);
            let amount = speed * -(most / speed.abs().max(f64::MIN_POSITIVE)).min(share / compliance);
            losses.on_bot += on_bot * amount;
            losses.on_ball[0] -= direction * amount;
            losses.on_ball[1] += on_ball * amount;
        }
        losses
    }
}
