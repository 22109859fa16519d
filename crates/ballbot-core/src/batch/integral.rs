//! Integral action of a policy, in what it observes.

use super::config::EnvConfig;
use crate::task::{Task, TaskDescription, limited};
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::Lane;
use ballbot_models::Scale;

/// Names of the rows in question, for x and y.
const POSITION: [&str; 2] =
    ["ball position from the setpoint, heading x", "ball position from the setpoint, heading y"];
const VELOCITY: [&str; 2] = ["ball velocity, heading x", "ball velocity, heading y"];

/// Speed of the ball at which the integral grows half as fast as at rest. Otherwise it would grow while a robot returns
/// from far away, and the robot would pass the setpoint.
const SLOW: f64 = 0.15;

/// Largest error that is integrated, and largest integral. All limits are of vectors, alike in all directions.
const LARGEST_ERROR: f64 = 2.0;
const LARGEST: f64 = 3.0;

/// Largest error that is observed. From farther away a policy that has seldom been there returns too fast to stop.
const LARGEST_SHOWN: f64 = 4.0;

/// Adds its integral to the position error that a policy observes, and limits the sum. The integral turns with the
/// heading, as the offset of a center of mass does. All numbers are multiples of the rows' typical magnitudes, as scaled
/// observations are.
#[derive(Clone, Debug)]
pub struct Integral {
    /// Growth in a control step per error.
    rate: f64,
    /// Places of the rows.
    position: [usize; 2],
    velocity: [usize; 2],
}

impl Integral {
    /// The integral of an environment, if it has one.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a task without the rows, or for observations that are not scaled.
    pub(super) fn of<T: Task>(config: &EnvConfig<T>, description: &TaskDescription) -> Result<Option<Self>> {
        let rate = config.integral_rate;
        if rate == 0.0 {
            return Ok(None);
        }
        let place = |name: &str| {
            description.rows.iter().position(|row| row.name == name).ok_or_else(|| {
                Error::Inconsistent(format!("integral_rate = {rate}: the task {} does not observe the {name}", T::NAME))
            })
        };
        let places = |[x, y]: [&str; 2]| Ok::<_, Error>([place(x)?, place(y)?]);
        let (position, velocity) = (places(POSITION)?, places(VELOCITY)?);
        if !config.scale_observations {
            return Err(Error::Inconsistent(format!("integral_rate = {rate} needs scale_observations")));
        }
        let time = if config.scale_by_robot { Scale::of(&config.params).time } else { 1.0 };
        Ok(Some(Self { rate: rate * config.control_dt / time, position, velocity }))
    }

    /// Its numbers by name, for implementations elsewhere: the growth in a control step per error at rest, the speed of the
    /// ball at which it is half as large, the largest error that is integrated, the largest integral, and the largest error
    /// that is observed.
    pub fn numbers(&self) -> [(&'static str, f64); 5] {
        [
            ("rate", self.rate),
            ("slow", SLOW),
            ("largest_error", LARGEST_ERROR),
            ("largest", LARGEST),
            ("largest_shown", LARGEST_SHOWN),
        ]
    }

    /// The rows of the position error.
    pub(super) fn places(&self) -> [usize; 2] {
        self.position
    }

    /// The integral after a step with these rows of an observation.
    #[inline(always)]
    pub(super) fn next<L: Lane>(&self, integral: [L; 2], row: impl Fn(usize) -> L) -> [L; 2] {
        let [vx, vy] = [row(self.velocity[0]), row(self.velocity[1])];
        let one = vx.splat(1.0);
        let share = one / (one + (vx * vx + vy * vy) * SLOW.powi(-2)) * self.rate;
        let [x, y] = limited([row(self.position[0]), row(self.position[1])], LARGEST_ERROR);
        let [at_x, at_y] = integral;
        limited([at_x + x * share, at_y + y * share], LARGEST)
    }

    /// The position error that is observed.
    #[inline(always)]
    pub(super) fn shown<L: Lane>([x, y]: [L; 2], [at_x, at_y]: [L; 2]) -> [L; 2] {
        limited([x + at_x, y + at_y], LARGEST_SHOWN)
    }

    /// Adds the integral to the rows of an observation, which it takes a step further if `steps`.
    #[inline(always)]
    pub(super) fn apply<L: Lane>(
        &self,
        token: L::Token,
        rows: &mut [L::Cell],
        integral: &mut [L::Cell; 2],
        steps: bool,
    ) {
        let mut now = [L::load(token, &integral[0]), L::load(token, &integral[1])];
        if steps {
            now = self.next(
                now,
                #[inline(always)]
                |place| L::load(token, &rows[place]),
            );
        }
        let [x, y] = self.position;
        let shown = Self::shown([L::load(token, &rows[x]), L::load(token, &rows[y])], now);
        for i in 0..2 {
            shown[i].store(&mut rows[self.position[i]]);
            now[i].store(&mut integral[i]);
        }
    }
}
