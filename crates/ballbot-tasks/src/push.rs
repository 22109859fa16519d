//! The push task: balance and withstand pushes.

use super::start::{check_range, starts_and_falls, task_fields};
use super::{Balance, Geometry, Metric, Metrics, Pushes, Rows, Sensed, Step, Task, Terms};
use ballbot_base::error::{Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::setpoint::Setpoint;
use ballbot_models::capture_impulse;
use std::f64::consts::PI;

task_fields! {
    fall 50.0, tilt 5.0;
    /// Options of the push task. SI units and radians. Tilts are from the equilibrium.
    pub struct Push {
        /// Smallest and largest impulse at the body's center of mass, uniform, in any direction: as fractions of the
        /// largest impulse that the nominal robot withstands within its traction.
        pub push: [f64; 2] = [0.0, 1.0], "", Limit::from(0.0).to(10.0);
        /// Shortest and longest time from one push to the next, uniform.
        pub push_seconds: [f64; 2] = [2.0, 5.0], "s", Limit::from(0.1).to(1e9), scaled;
        /// Time over which a push is spread, at most `push_seconds[0]`.
        pub push_duration: f64 = 0.1, "s", Limit::from(0.0).to(1e9), scaled;
        /// Where the ball should be.
        pub setpoint: [f64; 2] = [0.0; 2], "m", Limit::from(-1e4).to(1e4);
        /// Distance of the ball from the setpoint that costs half.
        pub position_scale: f64 = 0.1, "m", Limit::from(1e-12).to(1e6), scaled;
    }
}

/// Memory: the memory of the balance task, the sum of the squared distances from the setpoint, and the steps.
const DISTANCES: usize = Balance::MEMORY;
const STEPS: usize = Balance::MEMORY + 1;

impl Push {
    /// The same task without pushes.
    #[inline(always)]
    fn balance(&self) -> Balance {
        Balance {
            setpoint: self.setpoint,
            success_window: 0.0,
            success_tilt: PI,
            success_radius: self.position_scale,
            reset_tilt: self.reset_tilt,
            reset_yaw: self.reset_yaw,
            reset_ball_speed: self.reset_ball_speed,
            reset_tilt_rate: self.reset_tilt_rate,
            reset_yaw_rate: self.reset_yaw_rate,
            fall_tilt: self.fall_tilt,
        }
    }
}

impl Task for Push {
    const NAME: &'static str = "push";
    const ID: &'static str = "ballbot/Push-v0";
    const SUMMARY: &'static str = "Keep a ballbot upright with its ball at the setpoint while it is pushed.";
    const GEOMETRY: Option<Geometry> = Some(Geometry::Impulse);
    const SUCCESS: &'static str = "not terminated";
    const MEMORY: usize = STEPS + 1;

    fn validate(&self, params: &Params) -> Result<()> {
        check_range("push", self.push)?;
        check_range("push_seconds", self.push_seconds)?;
        let shortest = self.push_seconds[0];
        check("push_duration", self.push_duration, format_args!("at most push_seconds[0] = {shortest}"), |duration| {
            duration <= shortest
        })?;
        self.starts().validate(params)
    }

    starts_and_falls!();

    fn pushes(&self, params: &Params) -> Option<Pushes> {
        let most = capture_impulse(params);
        let impulse = self.push.map(|share| share * most);
        Some(Pushes { impulse, every: self.push_seconds, duration: self.push_duration })
    }

    fn setpoint(&self, memory: &[f64]) -> Setpoint {
        self.balance().setpoint(memory)
    }

    #[inline(always)]
    fn observe<L: Lane>(&self, sensed: &Sensed<'_, L>, memory: &Memory<'_, L>, rows: &mut impl Rows<L>) {
        self.balance().observe(sensed, memory, rows);
    }

    #[inline(always)]
    fn advance<L: Lane>(&self, step: &Step<'_, L>, memory: &mut Memory<'_, L>) {
        memory.set(DISTANCES, memory.get(DISTANCES) + self.balance().distance_squared(step));
        memory.set(STEPS, memory.get(STEPS) + 1.0);
    }

    #[inline(always)]
    fn success<L: Lane>(&self, _: &Step<'_, L>, terminated: L::Mask, _: &mut Memory<'_, L>) -> L::Mask {
        !terminated
    }

    #[inline(always)]
    fn reward<L: Lane>(&self, step: &Step<'_, L>, terminated: L::Mask, _: &Memory<'_, L>, terms: &mut impl Terms<L>) {
        let position = "d² / (d² + position_scale²), d the distance of the ball from the setpoint";
        self.balance().reward_of(step, terminated, position, terms);
    }

    fn measure(&self, memory: &[f64], _: f64, metrics: &mut impl Metrics) {
        metrics.metric(
            Metric::new("distance", "m", "root mean square of the distance of the ball from the setpoint"),
            (memory[DISTANCES] / memory[STEPS]).sqrt(),
        );
    }
}
