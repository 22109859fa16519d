//! Initial states of episodes, sampled by all tasks: near the equilibrium, rolling without slip.

use ballbot_base::error::{Result, check};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::MAX_RATE;
use ballbot_base::params::Params;
use ballbot_base::state::{State, attitude};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Options of a task, of the start of its episodes and of their end in a fall: `fall` and `tilt` are defaults in
/// degrees.
macro_rules! task_fields {
    (
        fall $fall:literal, tilt $tilt:literal;
        $(#[$meta:meta])*
        pub struct $name:ident { $($fields:tt)* }
    ) => {
        ::ballbot_base::fields! {
            $(#[$meta])*
            pub struct $name {
                $($fields)*
                /// Half angle of the cone about the equilibrium in which the initial tilt is sampled, uniform over its
                /// opening; below `fall_tilt`.
                pub reset_tilt: f64 = f64::to_radians($tilt), "rad", ::ballbot_base::fields::Limit::NOT_NEGATIVE;
                /// The initial yaw is uniform within ± this value.
                pub reset_yaw: f64 = ::std::f64::consts::PI, "rad",
                    ::ballbot_base::fields::Limit::from(0.0).to(::std::f64::consts::PI);
                /// Largest initial ball speed; uniform over the disc.
                pub reset_ball_speed: f64 = 0.1, "m/s", ::ballbot_base::fields::Limit::from(0.0).to(10.0);
                /// Largest initial tilt rate; uniform over the disc.
                pub reset_tilt_rate: f64 = 0.2, "rad/s", ::ballbot_base::fields::Limit::from(0.0).to(10.0);
                /// The initial rate about the mast is uniform within ± this value.
                pub reset_yaw_rate: f64 = 0.0, "rad/s", ::ballbot_base::fields::Limit::from(0.0).to(10.0);
                /// Tilt from the equilibrium above which the episode is terminated.
                pub fall_tilt: f64 = f64::to_radians($fall), "rad",
                    ::ballbot_base::fields::Limit::above(0.0).to(::std::f64::consts::PI);
            }
        }

        impl $name {
            /// Ranges of the initial states.
            fn starts(&self) -> $crate::start::Starts {
                $crate::start::Starts {
                    tilt: self.reset_tilt,
                    yaw: self.reset_yaw,
                    ball_speed: self.reset_ball_speed,
                    tilt_rate: self.reset_tilt_rate,
                    yaw_rate: self.reset_yaw_rate,
                    fall_tilt: self.fall_tilt,
                }
            }
        }
    };
}

pub(super) use task_fields;

/// What follows for a [`super::Task`] from the options of [`task_fields`]: initial states, and the end in a fall.
macro_rules! starts_and_falls {
    () => {
        const TERMINATIONS: &'static [(&'static str, &'static str)] = $crate::shared::FALLS;

        fn extreme_starts(&self, params: &::ballbot_base::params::Params) -> Vec<::ballbot_base::state::State> {
            self.starts().extremes(params)
        }

        fn start(
            &self,
            params: &::ballbot_base::params::Params,
            wheels: &::ballbot_base::kinematics::Omniwheels,
            rng: &mut ::rand_chacha::ChaCha8Rng,
        ) -> ::ballbot_base::state::State {
            self.starts().draw(params, wheels, rng)
        }

        #[inline(always)]
        fn terminate<L: ::ballbot_base::lanes::Lane>(&self, step: &$crate::Step<'_, L>) -> L {
            $crate::shared::fallen(step, self.fall_tilt)
        }
    };
}

pub(super) use starts_and_falls;

/// Ranges of the initial states.
pub(super) struct Starts {
    pub tilt: f64,
    pub yaw: f64,
    pub ball_speed: f64,
    pub tilt_rate: f64,
    pub yaw_rate: f64,
    pub fall_tilt: f64,
}

impl Starts {
    /// As [`super::Task::validate`].
    pub(super) fn validate(&self, params: &Params) -> Result<()> {
        let fall = self.fall_tilt;
        check("reset_tilt", self.tilt, format_args!("from 0 to below fall_tilt = {fall}"), |t| t < fall)?;
        let fastest =
            (self.ball_speed / params.ball_radius + self.tilt_rate + self.yaw_rate) * params.gear_ratio().max(1.0);
        check(
            "the fastest first wheel or ball rate, from reset_ball_speed, reset_tilt_rate and reset_yaw_rate,",
            fastest,
            format_args!("at most {} rad/s", 0.5 * MAX_RATE),
            |rate| rate <= 0.5 * MAX_RATE,
        )?;
        Ok(())
    }

    /// As [`super::Task::extreme_starts`].
    pub(super) fn extremes(&self, params: &Params) -> Vec<State> {
        let leaning = |azimuth: f64| {
            let about = Vector2::new(-azimuth.sin(), azimuth.cos());
            State::tilted_from_equilibrium(params, about * self.tilt, 0.0)
        };
        if params.body_com_offset == [0.0; 2] {
            return params.wheel_azimuths.into_iter().map(leaning).collect();
        }
        // A wheel is lowest when the robot tilts towards the wheel's side in equilibrium, and the body when it tilts
        // towards the mast.
        let equilibrium = params.equilibrium_attitude(0.0);
        let azimuth = |direction: &Vector3<f64>| {
            let v = equilibrium * direction;
            v.y.atan2(v.x)
        };
        let wheels = Omniwheels::new(params).contact_directions;
        wheels.iter().chain([&Vector3::z()]).map(|direction| leaning(azimuth(direction))).collect()
    }

    /// As [`super::Task::start`]: rolling without slip, the ball at the origin.
    pub(super) fn draw(&self, params: &Params, wheels: &Omniwheels, rng: &mut ChaCha8Rng) -> State {
        let tilt = in_disc(rng, self.tilt);
        let yaw = self.yaw * (2.0 * rng.random::<f64>() - 1.0);
        let velocity = in_disc(rng, self.ball_speed);
        let rate = in_disc(rng, self.tilt_rate);
        let attitude = attitude(tilt, yaw) * params.to_balance_frame();
        // Without spin, samples after the start stay the same as before this option existed.
        let spin = if self.yaw_rate > 0.0 { in_range(rng, [-self.yaw_rate, self.yaw_rate]) } else { 0.0 };
        let rate = Vector3::new(rate.x, rate.y, spin);
        State::rolling_on(
            params,
            wheels,
            velocity,
            0.0,
            attitude,
            params.to_balance_frame().inverse_transform_vector(&rate),
        )
    }
}

/// A point sampled uniformly from a disc.
pub(super) fn in_disc(rng: &mut ChaCha8Rng, radius: f64) -> Vector2<f64> {
    let radius = radius * rng.random::<f64>().sqrt();
    let angle = TAU * rng.random::<f64>();
    Vector2::new(angle.cos(), angle.sin()) * radius
}

/// Checks that the first of two numbers is not above the second.
pub(super) fn check_range(name: &str, [low, high]: [f64; 2]) -> Result<()> {
    check(format_args!("{name}[0]"), low, format_args!("at most {name}[1] = {high}"), |low| low <= high)?;
    Ok(())
}

/// A number sampled uniformly from a range.
pub(super) fn in_range(rng: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Control steps of a time sampled uniformly from a range, s; at least one.
pub(super) fn drawn_steps(seconds: [f64; 2], control_dt: f64, rng: &mut ChaCha8Rng) -> f64 {
    (in_range(rng, seconds) / control_dt).round().max(1.0)
}
