//! The estimator of one robot, with its memory.

use super::{Estimate, Estimator};
use crate::sensor::{Readings, SensorOptions};
use ballbot_base::error::{Error, Result, bounded};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Memory, Scalar, Vec3, run_one};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::{WHEELS, Wheels};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// An [`Estimator`] on the readings of one robot, as they arrive: it has the estimates of
/// [`Onboard`](crate::sensor::Onboard), bit for bit.
#[derive(Clone, Debug)]
pub struct Tracker {
    estimator: Estimator,
    memory: [f64; Estimator::MEMORY],
    /// Where a robot is believed to begin of which nothing is known, but for its attitude.
    upright: State,
    is_attitude_known: bool,
    /// Readings after the first that repeat it, as none of a later time has arrived.
    latency: usize,
    /// Readings of the episode so far.
    count: usize,
    wheel_angles: Wheels<f64>,
    wheel_rates: Wheels<f64>,
    state: State,
}

impl Tracker {
    /// The estimator of the robot of `params` with these sensors, which are read every `control_dt` (s). It begins as
    /// after [`Tracker::reset`] without a state.
    ///
    /// # Errors
    /// The errors of [`SensorOptions::check`] and [`Estimator::new`].
    pub fn new(params: &Params, sensors: &SensorOptions, control_dt: f64) -> Result<Self> {
        sensors.check(control_dt, true)?;
        let estimator = Estimator::of(params, sensors, control_dt)?;
        let upright = State::upright(params);
        let mut tracker = Self {
            estimator,
            memory: [0.0; Estimator::MEMORY],
            is_attitude_known: false,
            latency: sensors.latency_steps(control_dt)?,
            count: 0,
            wheel_angles: Wheels([0.0; WHEELS]),
            wheel_rates: Wheels([0.0; WHEELS]),
            state: upright.clone(),
            upright,
        };
        tracker.reset(None);
        Ok(tracker)
    }

    /// Begins an episode in a state; `None` is at rest at the origin with yaw 0, in the attitude that the accelerometer
    /// measures in the first readings.
    pub fn reset(&mut self, start: Option<&State>) {
        self.is_attitude_known = start.is_some();
        self.count = 0;
        self.wheel_rates = Wheels([0.0; WHEELS]);
        let start = start.unwrap_or(&self.upright).clone();
        self.begin(start);
    }

    fn begin(&mut self, start: State) {
        let Self { estimator, memory, .. } = self;
        let state = LaneState::from(&start);
        memory.fill(0.0);
        run_one(
            #[inline(always)]
            || estimator.begin(&state, &mut Memory::<f64>::new(Scalar, memory)),
        );
        self.state = start;
    }

    /// Rates of the wheels, rad/s, from their angles (rad) in the next readings: the change since the last readings, over
    /// the time of a step; 0 in the first readings, and what they were in repetitions of them.
    pub fn wheel_rates(&self, angles: Wheels<f64>) -> Wheels<f64> {
        if self.count <= self.latency {
            return self.wheel_rates;
        }
        let rate = 1.0 / self.estimator.dt;
        Wheels::from_fn(|i| (angles[i] - self.wheel_angles[i]) * rate)
    }

    /// The state after the first readings of an episode, or after readings one step later.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for readings or estimates that are not finite or far beyond any robot, and
    /// [`Error::Inconsistent`] for first readings from which no attitude follows. Nothing has changed then.
    pub fn update(&mut self, readings: &Readings<f64>) -> Result<&State> {
        let Readings { gyro, specific_force, wheel_angles, wheel_rates } = readings;
        bounded("gyro", &components(*gyro))?;
        bounded("specific_force", &components(*specific_force))?;
        bounded("wheel_angles", wheel_angles.as_slice())?;
        bounded("wheel_rates", wheel_rates.as_slice())?;
        let before = (self.memory, self.state.clone());
        if self.count == 0 && !self.is_attitude_known {
            let body_quaternion = attitude_at_rest(*specific_force)?;
            self.begin(State { body_quaternion, ..self.upright.clone() });
        }
        let Self { estimator, memory, .. } = self;
        let repeats = self.count < self.latency;
        let found: State = run_one(
            #[inline(always)]
            || {
                let mut memory = Memory::<f64>::new(Scalar, memory);
                let state = estimator.update(readings, &mut memory);
                estimator.wait(repeats, &mut memory);
                state
            },
        )
        .into();
        if let Err(error) = found.validate() {
            (self.memory, self.state) = before;
            return Err(error.of_option("estimate"));
        }
        self.count += 1;
        self.wheel_angles = *wheel_angles;
        self.wheel_rates = *wheel_rates;
        self.state = found;
        Ok(&self.state)
    }

    /// The state after the last readings; before them, the state in which the episode is believed to begin.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The last state with its attitude rotated back by the lean bias, as [`Estimator::balanced`].
    pub fn balanced(&mut self) -> State {
        let Self { estimator, memory, state, .. } = self;
        let state = LaneState::from(&*state);
        run_one(
            #[inline(always)]
            || estimator.balanced(&state, &Memory::<f64>::new(Scalar, memory)),
        )
        .into()
    }

    /// Estimates in addition to the state.
    pub fn estimate(&mut self) -> Estimate<f64> {
        let Self { estimator, memory, .. } = self;
        run_one(
            #[inline(always)]
            || estimator.estimate(&Memory::<f64>::new(Scalar, memory)),
        )
    }
}

fn components(v: Vec3<f64>) -> [f64; 3] {
    [v.x, v.y, v.z]
}

/// The shortest rotation from a specific force at rest to the vertical, which is the attitude with yaw 0.
fn attitude_at_rest(force: Vec3<f64>) -> Result<UnitQuaternion<f64>> {
    let force = Vector3::from(components(force));
    let size = force.norm();
    let up = force / size;
    if size == 0.0 || up.z <= -1.0 {
        let [x, y, z] = force.into();
        return Err(Error::Inconsistent(format!(
            "specific_force = [{x}, {y}, {z}] m/s²: no attitude at rest follows from it"
        )));
    }
    Ok(UnitQuaternion::new_normalize(Quaternion::new(1.0 + up.z, up.y, -up.x, 0.0)))
}
