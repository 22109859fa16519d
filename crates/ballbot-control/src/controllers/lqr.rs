//! A discrete linear-quadratic regulator of position, tilt and heading, for any robot.

use crate::parts::delayed::{DelayOptions, Delayed};
use crate::parts::joined::joined_fields;
use crate::parts::lean_observer::{LeanObserver, ObserverOptions};
use crate::parts::lean_planes::product;
use crate::parts::outer::Outer;
use crate::parts::riccati::{self, Regulator, dynamic, rows};
use crate::parts::tracking::{Deviation, Tracking};
use crate::{
    Constants, LaneSetpoint, Law, LimitOptions, Limited, MOTION_PARTS, NamedLaw, Plant, Sample, Sampled, Setpoint,
};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::wheels::Wheels;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::{DMatrix, SVector, SymmetricEigen};

ballbot_base::fields! {
    /// Deviations of equal cost (Bryson's rule): each state and input is weighted by one over its square.
    #[derive(Copy)]
    pub struct LqrWeights {
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
        /// Not a cost: the largest lean that deviations of position and velocity may command; it leaves torque to the
        /// balance.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// Not a cost: the largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
    }
}

impl LqrWeights {
    /// Q and R of the cost Σ xᵀQx + uᵀRu, in the order of the linear model's states and inputs.
    pub fn matrices(&self) -> (DMatrix<f64>, DMatrix<f64>) {
        let w = self;
        let (position, velocity) = ([w.position; 2], [w.velocity; 2]);
        let deviations = [position, [w.tilt; 2]].concat().into_iter().chain([w.yaw]).chain(velocity);
        let deviations: Vec<_> = deviations.chain([w.tilt_rate; 2]).chain([w.yaw_rate]).collect();
        let q = DMatrix::from_fn(STATES, STATES, |i, j| if i == j { deviations[i].powi(-2) } else { 0.0 });
        (q, DMatrix::identity(INPUTS, INPUTS) * w.torque.powi(-2))
    }
}

joined_fields! {
    /// Options of [`Lqr`]: the weights, the delay of the motors, and the estimate.
    pub struct LqrOptions {
        /// Deviations of equal cost.
        pub weights: LqrWeights,
        /// Delay of the prediction.
        pub delay: DelayOptions,
        /// Estimate of the lean in equilibrium.
        pub observer: ObserverOptions,
    }
}

/// τ = τ_ref − K x in the heading frame, with the torques τ_ref of the setpoint's motion, scaled down together where a
/// wheel would slip. The tilt is relative to the equilibrium: the tilt of the line from the ball's center to the body's
/// center of mass. The design is for a level floor: on a slope the ball comes to rest away from its setpoint, unless
/// the lean in equilibrium is estimated: a constant force, a slope or a wrong center of mass then leaves no offset. With
/// a delay x is the state predicted for the time at which the torque acts: with the pending torques as additional
/// states, the regulator is K times that state, since an input delay does not change the gain.
#[derive(Clone, Debug)]
pub struct Lqr {
    regulator: Regulator,
    /// K, row by row.
    gain: [[f64; STATES]; INPUTS],
    tracking: Tracking,
    outer: Outer,
    delayed: Delayed,
    observer: LeanObserver,
}

impl NamedLaw for Lqr {
    const NAME: &'static str = "lqr";
    const SUMMARY: &'static str = "Linear-quadratic regulator of position, tilt and heading.";
    const LABEL: &'static str = "LQR";
    type Options = LqrOptions;

    fn design(plant: &Plant<'_>, options: &LqrOptions) -> Result<Self> {
        let (q, r) = options.weights.matrices();
        Self::of_costs(plant, [&q, &r], options)
    }
}

impl Lqr {
    /// A regulator with the default weights and [`LimitOptions::TRACTION`].
    ///
    /// # Errors
    /// As [`Lqr::with_weights`].
    pub fn new(params: &Params, control_dt: f64) -> Result<Sampled<Self>> {
        Self::with_defaults(params, control_dt)
    }

    /// A regulator with the weights `weights`.
    ///
    /// # Errors
    /// [`ballbot_base::Error::Riccati`] if there is no solution; errors of [`Sampled::new`].
    pub fn with_weights(
        params: &Params,
        control_dt: f64,
        weights: &LqrWeights,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        let options = LqrOptions { weights: *weights, ..LqrOptions::default() };
        Self::with_options(params, control_dt, &options, limits)
    }

    /// A regulator with Q (10 × 10) and R (3 × 3) of the cost Σ xᵀQx + uᵀRu, in place of the costs in the weights.
    ///
    /// # Errors
    /// As [`Lqr::with_weights`]; [`ballbot_base::Error::Inconsistent`] for a matrix of another size, a matrix that is
    /// not symmetric, or Q not positive semidefinite, for a delay that is not a multiple of the sampling time, or
    /// samples that are too long for observation.
    pub fn with_costs(
        params: &Params,
        control_dt: f64,
        costs: [&DMatrix<f64>; 2],
        options: &LqrOptions,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        Sampled::new(params, control_dt, options, limits, |plant, options| Self::of_costs(plant, costs, options))
    }

    fn of_costs(plant: &Plant<'_>, [q, r]: [&DMatrix<f64>; 2], options: &LqrOptions) -> Result<Self> {
        let LqrOptions { weights, delay, observer } = options;
        check_cost("Q", q, STATES)?;
        check_cost("R", r, INPUTS)?;
        let (a, b) = plant.sampled();
        let regulator = riccati::solve(&dynamic(&a), &dynamic(&b), q, r)?;
        let tracking = Tracking::new(plant.params);
        Ok(Self {
            outer: Outer::new(&regulator.gain, [weights.max_lean, weights.max_speed]),
            gain: rows(&regulator.gain, 0),
            regulator,
            delayed: Delayed::of(&a, &b, plant.control_dt, delay.delay)?,
            observer: LeanObserver::new(plant, &tracking, observer.lean_observer)?,
            tracking,
        })
    }

    /// As [`LeanObserver::force_per_torque`].
    pub(crate) fn force_per_torque(&self) -> Option<[Wheels<f64>; 2]> {
        self.observer.force_per_torque()
    }

    /// The Riccati solution behind the gains.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }

    /// [`Lqr::deviation`] over lanes, and the torques of the setpoint's motion, N·m.
    #[inline(always)]
    pub fn lane_deviation<L: Lane>(
        &self,
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
    ) -> ([L; STATES], Wheels<L>) {
        let Deviation { x, forward, .. } = self.tracking.deviation(state, setpoint);
        (x, self.tracking.planes.wheel_torques(forward, x[0].zero()))
    }

    /// The setpoint, or if its position or velocity is farther than the law's largest lean and speed allow, one nearer.
    pub fn within_reach(&self, state: &State, setpoint: &Setpoint) -> Setpoint {
        let [position, velocity] = self.outer.clip(&mut self.tracking.deviation(&state.into(), &setpoint.into()).x);
        let (here, moving) = (state.ball_position.xy(), state.ball_velocity.xy());
        Setpoint {
            position: here + (setpoint.position - here) * position,
            velocity: moving + (setpoint.velocity - moving) * velocity,
            ..*setpoint
        }
    }

    /// ℓ/g, s²: the ball of a motion is at z − (ℓ/g) z̈.
    pub fn lag(&self) -> f64 {
        self.tracking.planes.lag()
    }

    /// Deviation from the setpoint in the linear model's coordinates.
    pub fn deviation(&self, state: &State, setpoint: &Setpoint) -> SVector<f64, STATES> {
        SVector::from(self.tracking.deviation(&state.into(), &setpoint.into()).x)
    }
}

/// Largest element of a cost matrix.
const MAX_COST: f64 = 1e15;

/// Largest number of steps of the search for the eigenvalues of a cost matrix; each eigenvalue needs about two.
const MAX_EIGENVALUE_STEPS: usize = 1000;

/// Checks the size and symmetry of a cost matrix, and that it is positive semidefinite.
fn check_cost(name: &str, matrix: &DMatrix<f64>, size: usize) -> Result<()> {
    if matrix.shape() != (size, size) {
        return Err(Error::Inconsistent(format!("{name} has shape {:?}, expected ({size}, {size})", matrix.shape())));
    }
    for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
        let limit = format_args!("within ±{MAX_COST:e}");
        check(format_args!("{name}[{i}, {j}]"), matrix[(i, j)], limit, |cost| cost.abs() <= MAX_COST)?;
    }
    let asymmetry = (matrix - matrix.transpose()).amax();
    if asymmetry > 1e-12 * matrix.amax() {
        return Err(Error::Inconsistent(format!(
            "{name} is not symmetric: it differs from its transpose by {asymmetry}"
        )));
    }
    let largest = matrix.amax();
    if largest == 0.0 {
        return Ok(());
    }
    let eigenvalues = SymmetricEigen::try_new(matrix / largest, f64::EPSILON, MAX_EIGENVALUE_STEPS)
        .ok_or_else(|| Error::Inconsistent(format!("the eigenvalues of {name} were not found")))?
        .eigenvalues;
    let smallest = eigenvalues.min() * largest;
    if smallest < -1e-12 * largest {
        return Err(Error::Inconsistent(format!(
            "{name} is not positive semidefinite: it has the eigenvalue {smallest}"
        )));
    }
    Ok(())
}

impl Law for Lqr {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn constants(&self) -> Option<Constants> {
        let constants = self.tracking.add_to(Constants::default()).matrix("gain", &self.gain);
        Some(self.outer.add_to(constants))
    }

    fn kept(&self) -> usize {
        self.delayed.kept() + self.observer.kept()
    }

    fn force_index(&self) -> Option<usize> {
        self.observer.force_index(self.delayed.kept())
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.observer.force_deviation(noise)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let delays = self.delayed.kept();
        let (Deviation { x, forward, pose }, equilibrium) = self.observer.deviation(&self.tracking, sample, delays);
        let mut x = self.delayed.state(x, &sample.memory);
        self.outer.clip(&mut x);
        let motion_now = self.tracking.planes.wheel_torques(forward, x[0].zero());
        let motion_then = match delays {
            0 => motion_now,
            // A torque acts on the motion after the delay.
            _ => {
                let later = self.tracking.forward_after(&pose.heading, sample.setpoint, self.delayed.seconds());
                self.tracking.planes.wheel_torques(equilibrium.forward(later), x[0].zero())
            }
        };
        let mut desired = motion_then;
        for (row, torque) in self.gain.iter().zip(&mut desired) {
            *torque += product(row, &x);
        }
        let Limited { torques, share, .. } = sample.limited_at(desired, &pose);
        let acting = self.delayed.acting(torques, motion_then, motion_now, &mut sample.memory);
        self.observer.predict(sample, delays, &pose, acting, share);
        torques
    }
}
