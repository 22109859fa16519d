//! A PD of the position that commands a lean, with an inner PID of the lean.

use crate::parts::lean_observer::{self, LeanObserver};
use crate::parts::lean_planes::{LeanPlane, Leaning, require_stable};
use crate::parts::outer::share_within;
use crate::parts::position_loop::SecondOrder;
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Constants, Law, Limited, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;
use ballbot_models::linear::STATES;
use nalgebra::DMatrix;

ballbot_base::fields! {
    /// Poles of [`CascadePid`]. The poles of a plane are in units of λ, the rate at which the robot topples, so that
    /// they suit robots of any size.
    #[derive(Copy)]
    pub struct CascadePidOptions {
        /// Natural frequency of the two poles of the lean, over λ.
        pub lean_bandwidth: f64 = 1.5, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the two poles of the lean.
        pub lean_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// Natural frequency of the two poles of the position, over λ; at most a quarter of the lean's frequency is
        /// usual.
        pub position_bandwidth: f64 = 0.25, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the two poles of the position.
        pub position_damping: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// Pole of the integral of the lean's error, over λ; 0 for no integral.
        pub integral_bandwidth: f64 = 0.1, "", Limit::from(0.0).to(1e3);
        /// Natural frequency of the heading.
        pub yaw_bandwidth: f64 = 4.0, "rad/s", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the heading.
        pub yaw_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// The largest lean that the position may command.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// The largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
        /// Rate at which the lean in equilibrium is estimated, which a slope, a force and a wrong center of mass
        /// change; 0 for no estimate.
        pub lean_observer: f64 = 0.0, "1/s", lean_observer::LIMIT;
    }
}

/// Gains in one plane: θ_ref = −(`position` y + `velocity` ẏ), and the acceleration of the lean by the motors
/// u = `reference` θ_ref − `lean` θ − `rate` θ̇ + `integral` ∫(θ_ref − θ).
#[derive(Clone, Copy, Debug)]
struct Gains {
    position: f64,
    velocity: f64,
    reference: f64,
    lean: f64,
    rate: f64,
    integral: f64,
}

impl Gains {
    /// Gains that place the five poles of the options in the plane, derived in `docs/laws.md`.
    fn new(plane: &LeanPlane, options: &CascadePidOptions) -> Self {
        let LeanPlane { toppling, acceleration, lever } = *plane;
        let [b0, b1] = SecondOrder::new(options.lean_bandwidth * toppling, options.lean_damping).gains();
        let [c0, c1] = SecondOrder::new(options.position_bandwidth * toppling, options.position_damping).gains();
        // (s² + b1 s + b0)(s² + c1 s + c0)
        let [a3, a2, a1, a0] = [b1 + c1, b0 + c0 + b1 * c1, b1 * c0 + b0 * c1, b0 * c0];
        let stiffness = a2 + lever * a0 / acceleration;
        let damping = a3 + lever * a1 / acceleration;
        let pole = options.integral_bandwidth * toppling;
        Self {
            position: a0 / (stiffness * acceleration),
            velocity: a1 / (stiffness * acceleration),
            reference: stiffness,
            lean: plane.toppling_squared() + stiffness + damping * pole,
            rate: damping + pole,
            integral: stiffness * pole,
        }
    }

    /// k of u = −k (y, θ, ẏ, θ̇) without the integral.
    fn feedback(&self) -> [f64; 4] {
        [self.reference * self.position, self.lean, self.reference * self.velocity, self.rate]
    }
}

/// The cascade of Nagarajan, Kantor and Hollis (IJRR 33(6), 2014) in each vertical plane of the heading frame, with a
/// PD of the heading: a PD of the position commands a lean, which a PID with its derivative on the measured tilt rate
/// tracks.
///
/// Its gains place the poles of the linear model. The proportional part weights the reference so that it does not
/// excite the pole of the integral (derived in `docs/laws.md`). The speed and lean commands of the position are limited
/// as vectors; the integral is held while the torques are limited.
#[derive(Clone, Debug)]
pub struct CascadePid {
    gains: [Gains; 2],
    yaw: SecondOrder,
    max_lean: f64,
    max_speed: f64,
    tracking: Tracking,
    observer: LeanObserver,
}

impl NamedLaw for CascadePid {
    const NAME: &'static str = "cascade_pid";
    const SUMMARY: &'static str = "PD of the position above a PID of the tilt, by the poles of the closed loop.";
    const LABEL: &'static str = "cascade";
    type Options = CascadePidOptions;

    fn design(plant: &Plant<'_>, options: &CascadePidOptions) -> Result<Self> {
        let tracking = Tracking::new(plant.params);
        let law = Self {
            gains: tracking.planes.planes.each_ref().map(|plane| Gains::new(plane, options)),
            yaw: SecondOrder::new(options.yaw_bandwidth, options.yaw_damping),
            max_lean: options.max_lean,
            max_speed: options.max_speed,
            observer: LeanObserver::new(plant, &tracking, options.lean_observer)?,
            tracking,
        };
        require_stable(law.closed_loop(plant), plant.control_dt)?;
        Ok(law)
    }
}

impl CascadePid {
    /// The sampled closed loop of the linear model: its states, and the integral of each plane that has an integral.
    fn closed_loop(&self, plant: &Plant<'_>) -> DMatrix<f64> {
        let dt = plant.control_dt;
        let (a, b) = plant.sampled();
        let size = STATES + 2;
        let [x, y] = &self.gains;
        let gain = self.tracking.planes.gain([x.feedback(), y.feedback()], self.yaw.gains());
        let mut closed = DMatrix::identity(size, size);
        closed.view_mut((0, 0), (STATES, STATES)).copy_from(&(a - b * gain));
        for (axis, g) in self.gains.iter().enumerate() {
            // An integral that drives nothing is not a pole of the loop.
            if g.integral == 0.0 {
                closed[(STATES + axis, STATES + axis)] = 0.0;
                continue;
            }
            let mut unit = [[0.0; 4]; 2];
            unit[axis][0] = -g.integral;
            let column = b * self.tracking.planes.gain(unit, [0.0; 2]).column(axis);
            closed.view_mut((0, STATES + axis), (STATES, 1)).copy_from(&-column);
            // θ_ref − θ, with the tilt about −x in the plane of y.
            let (lean, sign) = if axis == 0 { (3, 1.0) } else { (2, -1.0) };
            closed[(STATES + axis, axis)] = -dt * g.position;
            closed[(STATES + axis, 5 + axis)] = -dt * g.velocity;
            closed[(STATES + axis, lean)] = -dt * sign;
        }
        closed
    }
}

impl Law for CascadePid {
    const MEMORY: usize = 2;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn constants(&self) -> Option<Constants> {
        let [x, y] = &self.gains;
        let constants = self
            .tracking
            .add_to(Constants::default())
            .vector("position_gains", &[x.position, y.position])
            .vector("velocity_gains", &[x.velocity, y.velocity])
            .vector("reference_gains", &[x.reference, y.reference])
            .vector("lean_gains", &[x.lean, y.lean])
            .vector("rate_gains", &[x.rate, y.rate])
            .vector("integral_gains", &[x.integral, y.integral])
            .vector("yaw_gains", &self.yaw.gains())
            .number("max_lean", self.max_lean)
            .number("max_speed", self.max_speed);
        Some(constants)
    }

    fn kept(&self) -> usize {
        Self::MEMORY + self.observer.kept()
    }

    fn force_index(&self) -> Option<usize> {
        self.observer.force_index(Self::MEMORY)
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.observer.force_deviation(noise)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let (Deviation { x, forward, pose }, _) = self.observer.deviation(&self.tracking, sample, Self::MEMORY);
        let Leaning { position, velocity, lean, rate } = Leaning::new(&x);
        let [gx, gy] = &self.gains;
        let speeds = [position[0] * (gx.position / gx.velocity), position[1] * (gy.position / gy.velocity)];
        let slower = share_within(speeds, self.max_speed);
        let commanded = [
            (speeds[0].mul_add(slower, velocity[0])) * -gx.velocity,
            (speeds[1].mul_add(slower, velocity[1])) * -gy.velocity,
        ];
        let less = share_within(commanded, self.max_lean);
        let (mut accelerations, mut errors) = ([less; 2], [less; 2]);
        for axis in 0..2 {
            let g = &self.gains[axis];
            let reference = commanded[axis] * less;
            errors[axis] = reference - lean[axis];
            let held = lean[axis].mul_add_all(-g.lean, rate[axis] * -g.rate);
            let driven = reference.mul_add_all(g.reference, sample.memory.get(axis) * g.integral);
            accelerations[axis] = driven + held + forward[axis];
        }
        let desired = self.tracking.planes.wheel_torques(accelerations, self.yaw.returning(x[4], x[9]));
        let Limited { torques, share, .. } = sample.limited_at(desired, &pose);
        sample.integrate(errors, share);
        self.observer.predict(sample, Self::MEMORY, &pose, torques, share);
        torques
    }
}
