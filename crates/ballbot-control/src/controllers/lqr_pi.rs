//! The double loop: a regulator that commands wheel rates, above a PI of the measured rates.

use crate::parts::balance_frame::BalanceFrame;
use crate::parts::delayed::{DelayOptions, Delayed};
use crate::parts::joined::joined_fields;
use crate::parts::lean_observer::{self, LeanObserver};
use crate::parts::lean_planes::{LeanPlanes, Leaning, require_stable};
use crate::parts::outer::Outer;
use crate::parts::position_loop::SecondOrder;
use crate::parts::riccati;
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Constants, Law, Limited, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;
use nalgebra::{DMatrix, Vector3};

ballbot_base::fields! {
    /// Deviations of equal cost of the outer loop of [`LqrPi`], as in [`crate::LqrWeights`], and the inner loop. Frequencies of
    /// the inner loop are in units of λ, the rate at which the robot topples.
    #[derive(Copy)]
    pub struct LqrPiLoops {
        /// Deviation of the ball position.
        pub position: f64 = 0.15, "m", Limit::from(1e-6).to(1e6);
        /// Deviation of the ball velocity.
        pub velocity: f64 = 0.4, "m/s", Limit::from(1e-6).to(1e6);
        /// Tilt.
        pub tilt: f64 = 0.1, "rad", Limit::from(1e-6).to(1e6);
        /// Tilt rate.
        pub tilt_rate: f64 = 1.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Rate that the outer loop commands of the virtual wheel in a plane.
        pub wheel_rate: f64 = 10.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Crossover of the loop of the wheel rates, over λ.
        pub wheel_bandwidth: f64 = 4.1, "", Limit::from(1e-3).to(1e3);
        /// Zero of the PI of the wheel rates, its integral gain over the proportional one, over λ.
        pub wheel_integral: f64 = 1.0, "", Limit::above(0.0).to(1e3);
        /// Natural frequency of the heading.
        pub yaw_bandwidth: f64 = 4.0, "rad/s", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the heading.
        pub yaw_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// Not a cost: the largest lean that deviations of position and velocity may command.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
        /// Rate at which the lean in equilibrium is estimated, which a slope, a force and a wrong center of mass
        /// change; 0 for no estimate.
        pub lean_observer: f64 = 0.0, "1/s", lean_observer::LIMIT;
    }
}

joined_fields! {
    /// Options of [`LqrPi`]: the loops, and the delay of the motors.
    pub struct LqrPiOptions {
        /// Both loops and the estimate.
        pub loops: LqrPiLoops,
        /// Delay of the prediction.
        pub delay: DelayOptions,
    }
}

/// The loops in one plane, with x = (y, θ, ẏ, θ̇).
#[derive(Clone, Copy, Debug)]
struct Loops {
    /// Rate of the virtual wheel, per rates of the wheels.
    wheels: Wheels<f64>,
    /// Rate of the virtual wheel per (ẏ, θ̇): ẏ/r_w − (r_k/r_w) θ̇.
    moving: [f64; 2],
    /// Acceleration of the lean per error of the rate and per integral of the error.
    proportional: f64,
    integral: f64,
    /// Wheel rate commands of the outer loop are −k (x, ξ).
    k: [f64; 5],
}

impl Loops {
    fn new(axis: usize, plant: &Plant<'_>, planes: &LeanPlanes, options: &LqrPiLoops) -> Result<Self> {
        let Plant { params, control_dt: dt, .. } = *plant;
        let plane = &planes.planes[axis];
        // The wheels turn with the ball relative to the body; leaning towards y turns about −x.
        let axis_in_body = BalanceFrame::new(params).in_body(&if axis == 0 { Vector3::y() } else { -Vector3::x() });
        let inverse = Omniwheels::new(params).u.try_inverse().expect("the wheels drive the ball about every axis");
        let wheels = Wheels::of_column(inverse.transpose() * axis_in_body);
        let moving = [params.wheel_radius.recip(), -params.ball_radius / params.wheel_radius];
        let gain = moving[1] - moving[0] * plane.lever;
        let proportional = options.wheel_bandwidth * plane.toppling / gain;
        let integral = proportional * options.wheel_integral * plane.toppling;
        let loops = Self { wheels, moving, proportional, integral, k: [0.0; 5] };
        let (a, b) = planes.sampled(axis, params, dt);
        let c = DMatrix::from_row_slice(1, 4, &[0.0, 0.0, moving[0], moving[1]]);
        let mut augmented = DMatrix::identity(5, 5);
        augmented.view_mut((0, 0), (4, 4)).copy_from(&(a - &b * &c * proportional));
        augmented.view_mut((0, 4), (4, 1)).copy_from(&(&b * integral));
        augmented.view_mut((4, 0), (1, 4)).copy_from(&(&c * -dt));
        let mut driven = DMatrix::from_element(5, 1, dt);
        driven.view_mut((0, 0), (4, 1)).copy_from(&(b * proportional));
        let costs = [options.position, options.tilt, options.velocity, options.tilt_rate].map(|w| w.powi(-2));
        let q = DMatrix::from_fn(5, 5, |i, j| if i == j && i < 4 { costs[i] } else { 0.0 });
        let r = DMatrix::from_element(1, 1, options.wheel_rate.powi(-2));
        let regulator = riccati::solve(&augmented, &driven, &q, &r)?;
        Ok(Self { k: std::array::from_fn(|i| regulator.gain[i]), ..loops })
    }
}

/// The double loop of Lauwers, Kantor and Hollis (ICRA 2006) and Pham, Kim and Lee (IEEE Control Systems 38(2), 2018)
/// in each vertical plane of the heading frame, with a PD of the heading: a linear-quadratic regulator commands the
/// rate of a virtual wheel, which a PI of the encoder rates tracks.
///
/// The integral compensates dry friction. The regulator is designed for the sampled plane under the PI, with the
/// integral as fifth state. The speed and lean commands of the position are limited as vectors; the integral is held
/// while the torques are limited. With a delay the states, including the measured rates, are predicted for the time at
/// which the torque acts. Derived in `docs/laws.md`.
#[derive(Clone, Debug)]
pub struct LqrPi {
    loops: [Loops; 2],
    yaw: SecondOrder,
    tracking: Tracking,
    delayed: Delayed,
    outer: Outer,
    observer: LeanObserver,
}

impl NamedLaw for LqrPi {
    const NAME: &'static str = "lqr_pi";
    const SUMMARY: &'static str = "Double loop: a regulator commands wheel rates, which a PI controller tracks.";
    const LABEL: &'static str = "LQR + PI";
    type Options = LqrPiOptions;

    fn design(plant: &Plant<'_>, LqrPiOptions { loops: options, delay }: &LqrPiOptions) -> Result<Self> {
        let tracking = Tracking::new(plant.params);
        let delayed = Delayed::new(plant, delay.delay)?;
        let yaw = SecondOrder::new(options.yaw_bandwidth, options.yaw_damping);
        // The heading is a double integrator; the planes are stabilized by their regulators.
        let ([k, d], dt, half) = (yaw.gains(), plant.control_dt, 0.5 * plant.control_dt * plant.control_dt);
        let heading = [1.0 - half * k, dt - half * d, -dt * k, 1.0 - dt * d];
        require_stable(DMatrix::from_row_slice(2, 2, &heading), dt)?;
        let observer = LeanObserver::new(plant, &tracking, options.lean_observer)?;
        let planes = &tracking.planes;
        let loops = [Loops::new(0, plant, planes, options)?, Loops::new(1, plant, planes, options)?];
        let commanded = loops.map(|Loops { proportional, moving, k, .. }| {
            [k[0], k[1], k[2] + moving[0], k[3] + moving[1]].map(|gain| proportional * gain)
        });
        Ok(Self {
            loops,
            yaw,
            outer: Outer::new(&planes.gain(commanded, yaw.gains()), [options.max_lean, options.max_speed]),
            tracking,
            delayed,
            observer,
        })
    }
}

impl LqrPi {
    /// Gains of the outer loop's command −k (y, θ, ẏ, θ̇, ξ) in the planes of x and y: k in rad/s per unit.
    pub fn outer_gains(&self) -> [[f64; 5]; 2] {
        self.loops.map(|loops| loops.k)
    }

    /// Gains of the inner loop in the planes of x and y: acceleration of the lean per error of the rate of the virtual
    /// wheel (1/s), and per integral of the error (1/s²).
    pub fn inner_gains(&self) -> [[f64; 2]; 2] {
        self.loops.map(|loops| [loops.proportional, loops.integral])
    }

    /// Rate of the virtual wheel per (ẏ, θ̇) in the planes of x and y, 1/m and 1.
    pub fn wheel_rates(&self) -> [[f64; 2]; 2] {
        self.loops.map(|loops| loops.moving)
    }
}

impl Law for LqrPi {
    const MEMORY: usize = 2;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn constants(&self) -> Option<Constants> {
        let constants = self
            .tracking
            .add_to(Constants::default())
            .matrix("virtual_wheel", &self.loops.map(|loops| loops.wheels.0))
            .matrix("wheel_rates", &self.wheel_rates())
            .matrix("outer_gains", &self.outer_gains())
            .matrix("inner_gains", &self.inner_gains())
            .vector("yaw_gains", &self.yaw.gains());
        Some(self.outer.add_to(constants))
    }

    fn kept(&self) -> usize {
        Self::MEMORY + self.delayed.kept() + self.observer.kept()
    }

    fn force_index(&self) -> Option<usize> {
        self.observer.force_index(Self::MEMORY + self.delayed.kept())
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.observer.force_deviation(noise)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Sample { state, setpoint, .. } = *sample;
        let delays = self.delayed.kept();
        let observed = Self::MEMORY + delays;
        let (deviation, equilibrium) = self.observer.deviation(&self.tracking, sample, observed);
        let Deviation { x: now, forward, pose } = deviation;
        let Leaning { velocity, rate, .. } = Leaning::new(&now);
        let mut x = self.delayed.state(now, &sample.memory.after(Self::MEMORY));
        let Leaning { velocity: later_velocity, rate: later_rate, .. } = Leaning::new(&x);
        let forward_then = match delays {
            0 => forward,
            // A torque acts on the motion after the delay.
            _ => equilibrium.forward(self.tracking.forward_after(&pose.heading, setpoint, self.delayed.seconds())),
        };
        // The setpoint's motion accounts for part of the wheel rates.
        let moving = pose.heading.of(state.ball_velocity.x, state.ball_velocity.y);
        let leaning = [pose.rate.y, -pose.rate.x];
        self.outer.clip(&mut x);
        let clipped = Leaning::new(&x);
        let zero = x[0].zero();
        let (mut accelerations, mut errors) = (forward_then, [zero; 2]);
        for axis in 0..2 {
            let Loops { wheels, moving: [per_speed, per_rate], proportional, integral, k } = &self.loops[axis];
            let kept = sample.memory.get(axis);
            let reference =
                (moving[axis] - velocity[axis]).mul_add_all(*per_speed, (leaning[axis] - rate[axis]) * *per_rate);
            let Wheels([a, b, c]) = state.wheel_speeds;
            let mut measured = c.mul_add_all(wheels[2], b.mul_add_all(wheels[1], a * wheels[0])) - reference;
            if delays > 0 {
                let (gained, leaned) = (later_velocity[axis] - velocity[axis], later_rate[axis] - rate[axis]);
                measured += gained.mul_add_all(*per_speed, leaned * *per_rate);
            }
            let position = clipped.position[axis].mul_add_all(-k[0], clipped.velocity[axis] * -k[2]);
            let lean = clipped.lean[axis].mul_add_all(-k[1], clipped.rate[axis] * -k[3]);
            let commanded = kept.mul_add_all(-k[4], position + lean);
            errors[axis] = commanded - measured;
            let driven = errors[axis].mul_add_all(*proportional, kept * *integral);
            accelerations[axis] += driven;
        }
        let planes = &self.tracking.planes;
        let desired = planes.wheel_torques(accelerations, self.yaw.returning(x[4], x[9]));
        let Limited { torques, share, .. } = sample.limited_at(desired, &pose);
        sample.integrate(errors, share);
        let (motion_then, motion_now) = (planes.wheel_torques(forward_then, zero), planes.wheel_torques(forward, zero));
        let acting = self.delayed.acting(torques, motion_then, motion_now, &mut sample.memory.after(Self::MEMORY));
        self.observer.predict(sample, observed, &pose, acting, share);
        torques
    }
}
