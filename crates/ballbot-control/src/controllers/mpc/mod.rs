//! Linear model predictive control: the regulator plus inputs that keep its predicted torques within the limits.

mod plane;
mod prediction;

use crate::parts::balance_frame::Pose;
use crate::parts::lean_observer::{self, LeanObserver};
use crate::parts::lean_planes::{Leaning, product};
use crate::parts::limits::ROWS;
use crate::parts::outer::Outer;
use crate::parts::riccati::{self, dynamic, rows};
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Law, Limited, LqrWeights, MOTION_PARTS, NamedLaw, Plant, Sample, Sampled, Setpoint};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Memory, Scalar};
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;
use ballbot_models::LinearModel;
use ballbot_models::linear::{INPUTS, STATES};
use plane::Plane;
use prediction::{Prediction, STAGES, Start, load, store};

ballbot_base::fields! {
    /// Deviations of equal cost, as in [`LqrWeights`], and the horizon and iterations of [`Mpc`].
    #[derive(Copy)]
    pub struct MpcOptions {
        /// Deviation of the ball position.
        pub position: f64 = 0.15, "m", Limit::from(1e-6).to(1e6);
        /// Deviation of the ball velocity.
        pub velocity: f64 = 0.4, "m/s", Limit::from(1e-6).to(1e6);
        /// Tilt.
        pub tilt: f64 = 0.1, "rad", Limit::from(1e-6).to(1e6);
        /// Tilt rate.
        pub tilt_rate: f64 = 1.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Deviation of the heading.
        pub yaw: f64 = 0.5, "rad", Limit::from(1e-6).to(1e6);
        /// Rate of the heading.
        pub yaw_rate: f64 = 2.0, "rad/s", Limit::from(1e-6).to(1e6);
        /// Wheel torque.
        pub torque: f64 = 0.2, "N·m", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest lean that deviations of position and velocity may command.
        pub max_lean: f64 = 0.226_892_802_759_262_85, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
        /// Violation of a limit at one stage: of a load or traction as a fraction of the wheel's load in equilibrium, of a
        /// torque as a fraction of the largest.
        pub violation: f64 = 0.05, "", Limit::from(1e-3).to(1e3);
        /// How far is looked ahead in 25 stages, over 1/λ. A stage is the multiple of the sampling time, at least one,
        /// that is nearest.
        pub horizon: f64 = 3.0, "", Limit::from(1e-3).to(10.0);
        /// Iterations a call, rounded.
        pub iterations: f64 = 10.0, "", Limit::from(1.0).to(10_000.0);
        /// Rate at which the lean in equilibrium is estimated, which a slope, a force and a wrong center of mass
        /// change; 0 for no estimate.
        pub lean_observer: f64 = 0.0, "1/s", lean_observer::LIMIT;
    }
}

impl MpcOptions {
    /// The weights of the regulator.
    pub fn weights(&self) -> LqrWeights {
        let Self { position, velocity, tilt, tilt_rate, yaw, yaw_rate, torque, max_lean, max_speed, .. } = *self;
        LqrWeights { position, velocity, tilt, tilt_rate, yaw, yaw_rate, torque, max_lean, max_speed }
    }
}

/// τ = τ_ref − K x + v₀ in the heading frame, with the gain of [`crate::Lqr`] sampled once per stage, and the first of
/// the inputs v of least cost over the next stages. With the cost of the regulator's infinite horizon, Σ xᵀQx + uᵀRu is
/// xᵀPx + Σ |v|² in suitable units, so v is zero where the regulator keeps the limits; elsewhere the squared violations
/// at each stage are added to the cost. The limits are the limits of [`crate::TorqueLimits`] at the predicted lean, linear in
/// lean and torques.
///
/// Both planes are predicted together, because a wheel's limits depend on both. The problem is solved by a fixed number
/// of accelerated gradient steps from the plan of the last call. Derived in `docs/laws.md`.
#[derive(Clone, Debug)]
pub struct Mpc {
    /// K, row by row.
    gain: [[f64; STATES]; INPUTS],
    prediction: Prediction,
    tracking: Tracking,
    outer: Outer,
    observer: LeanObserver,
    /// Time between two stages, s.
    stage: f64,
}

impl NamedLaw for Mpc {
    const NAME: &'static str = "mpc";
    const SUMMARY: &'static str =
        "Model predictive control: the regulator with limits of traction and torque looked ahead.";
    const LABEL: &'static str = "MPC";
    type Options = MpcOptions;

    fn design(plant: &Plant<'_>, options: &MpcOptions) -> Result<Self> {
        let Plant { params, control_dt, limits, .. } = *plant;
        let weights = options.weights();
        let tracking = Tracking::new(params);
        let planes = &tracking.planes;
        let toppling = planes.planes[0].toppling.max(planes.planes[1].toppling);
        let samples = (options.horizon / (toppling * STAGES as f64 * control_dt)).round().max(1.0);
        let stage = samples * control_dt;
        let (a, b) = LinearModel::new(params).discretize(stage);
        let (q, r) = weights.matrices();
        let gain = riccati::solve(&dynamic(&a), &dynamic(&b), &q, &r)?.gain;
        let plane = |axis: usize| Plane::new(axis, params, planes, stage, [&q, &r]);
        let [x, y] = [planes.driven(0), planes.driven(1)];
        let prediction = Prediction::new(
            [plane(0)?, plane(1)?],
            &limits.lean_rows(planes),
            Wheels::from_fn(|i| [x[i], y[i]]),
            options.violation.powi(-2),
            options.iterations.round() as usize,
        )?;
        Ok(Self {
            outer: Outer::new(&gain, [weights.max_lean, weights.max_speed]),
            gain: rows(&gain, 0),
            prediction,
            observer: LeanObserver::new(plant, &tracking, options.lean_observer)?,
            tracking,
            stage,
        })
    }
}

impl Mpc {
    /// Time between two stages, s.
    pub fn stage(&self) -> f64 {
        self.stage
    }

    #[inline(always)]
    fn desired_torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> (Wheels<L>, Pose<L>) {
        let (deviation, _) = self.observer.deviation(&self.tracking, sample, Self::MEMORY);
        let Deviation { mut x, forward, pose } = deviation;
        self.outer.clip(&mut x);
        let planes = &self.tracking.planes;
        let zero = x[0].zero();
        let mut desired = planes.wheel_torques(forward, zero);
        let start = self.start(&pose, &x, forward, desired, sample.max_torque());
        for (row, torque) in self.gain.iter().zip(&mut desired) {
            *torque += product(row, &x);
        }
        let limited = self.prediction.is_limited(&start);
        let mut plan = load(&sample.memory, sample.control_dt / self.stage);
        if L::any(limited) {
            self.prediction.improve(&start, &mut plan);
        }
        for [x, y] in &mut plan {
            // Zero is the optimum where the regulator keeps the limits.
            (*x, *y) = (L::select(limited, *x, zero), L::select(limited, *y, zero));
        }
        store(&plan, &mut sample.memory);
        let [x, y] = &self.prediction.planes;
        let [first, ..] = plan;
        let added = planes.wheel_torques([first[0] * x.scale, first[1] * y.scale], zero);
        (desired + added, pose)
    }

    /// Initial values of the prediction. The setpoint's lean and the tilt rate of the rows are held constant.
    #[inline(always)]
    fn start<L: Lane>(
        &self,
        &Pose { tilt: [tilt_x, tilt_y], rate: turning, .. }: &Pose<L>,
        x: &[L; STATES],
        forward: [L; 2],
        torques: Wheels<L>,
        max_torque: f64,
    ) -> Start<L> {
        let Leaning { position, velocity, lean, rate } = Leaning::new(x);
        let reference = [tilt_y - lean[0], -tilt_x - lean[1]];
        let squared = turning.x.mul_add(turning.x, turning.y.squared());
        let mut rows = [squared; ROWS];
        for (row, constant) in self.prediction.rows.iter().zip(&mut rows) {
            let resting = squared.mul_add_all(row.per_rate_squared, squared.splat(row.at_rest));
            *constant = row.value(resting, reference, forward);
        }
        let per_acceleration = squared.splat(max_torque.recip());
        Start {
            x: [[position[0], lean[0], velocity[0], rate[0]], [position[1], lean[1], velocity[1], rate[1]]],
            rows,
            torques: torques * per_acceleration,
            per_acceleration,
        }
    }
}

impl Sampled<Mpc> {
    /// The desired wheel torques of a robot without history, before the limits, N·m.
    pub fn desired(&self, state: &State, setpoint: &Setpoint) -> Wheels<f64> {
        let (desired, _) = self.desired_torques(&mut Sample {
            state: &state.into(),
            setpoint: &setpoint.into(),
            memory: Memory::<f64>::new(Scalar, &mut vec![0.0; self.kept()]),
            control_dt: self.control_dt,
            limits: &self.limits,
            largest: f64::INFINITY,
        });
        desired
    }
}

impl Law for Mpc {
    const MEMORY: usize = 2 * STAGES;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

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
        let (desired, pose) = self.desired_torques(sample);
        let Limited { torques, share, .. } = sample.limited_at(desired, &pose);
        self.observer.predict(sample, Self::MEMORY, &pose, torques, share);
        torques
    }
}
