//! A discrete linear-quadratic regulator of position, tilt and heading, for any robot.

use super::balance_frame::BalanceFrame;
use super::riccati::{self, Regulator};
use super::{LaneSetpoint, Law, LimitOptions, Sampling, Setpoint, SetpointCells, TorqueLimits, check_control_dt};
use crate::error::{Error, Result, check};
use crate::fields::{Fields, Limit};
use crate::lane_state::{LaneState, StateCells};
use crate::lanes::{Heading, Lane, Memory, Scalar, wrapped_angle};
use crate::models::LinearModel;
use crate::models::linear::{INPUTS, STATES};
use crate::params::Params;
use crate::state::State;
use nalgebra::{DMatrix, SVector, SymmetricEigen};

crate::fields! {
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
        pub torque: f64 = 0.2, "N·m", Limit::from(1e-6).to(1e6);
        /// No deviation: the largest lean that those of position and velocity may ask for, which leaves torque to the
        /// balance.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(1e-6).to(1e6);
        /// No deviation: the largest speed that one of the position may ask for.
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

/// τ = −K x in the heading frame, scaled down together where a wheel would slip. The tilt is that from the equilibrium: of
/// the line from the ball's center to the body's center of mass. It is made for a level floor: on a slope the ball comes to
/// rest away from its setpoint.
#[derive(Clone, Debug)]
pub struct Lqr {
    regulator: Regulator,
    /// K, row by row.
    gain: [[f64; STATES]; INPUTS],
    frame: BalanceFrame,
    outer: Outer,
    sampling: Sampling,
    limits: TorqueLimits,
}

impl Lqr {
    /// A regulator with the default weights and [`LimitOptions::TRACTION`].
    ///
    /// # Errors
    /// As [`Lqr::with_weights`].
    pub fn new(params: &Params, control_dt: f64) -> Result<Self> {
        Self::with_weights(params, control_dt, &LqrWeights::default(), &LimitOptions::TRACTION)
    }

    /// A regulator from the linear model of `params`, discretized at `control_dt` (s).
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a number that is not positive, those of [`TorqueLimits::new`], [`crate::Error::Riccati`] if there is no solution.
    pub fn with_weights(params: &Params, control_dt: f64, weights: &LqrWeights, limits: &LimitOptions) -> Result<Self> {
        weights.check_limits()?;
        let (q, r) = weights.matrices();
        Self::with_costs(params, control_dt, [&q, &r], [weights.max_lean, weights.max_speed], limits)
    }

    /// [`Lqr::with_weights`] with Q (10 × 10) and R (3 × 3) of the cost Σ xᵀQx + uᵀRu, and the largest lean (rad) and
    /// speed (m/s) of [`LqrWeights`].
    ///
    /// # Errors
    /// As [`Lqr::with_weights`]; [`crate::Error::Length`] for matrices of another size; [`crate::Error::Inconsistent`] if one
    /// is not symmetric, or Q not positive semidefinite.
    pub fn with_costs(
        params: &Params,
        control_dt: f64,
        [q, r]: [&DMatrix<f64>; 2],
        largest: [f64; 2],
        limits: &LimitOptions,
    ) -> Result<Self> {
        params.validate()?;
        check_control_dt(control_dt)?;
        let limits = TorqueLimits::new(params, limits)?;
        check_cost("Q", q, STATES)?;
        check_cost("R", r, INPUTS)?;
        let (a, b) = LinearModel::new(params).discretize(control_dt);
        let a = DMatrix::from_column_slice(STATES, STATES, a.as_slice());
        let b = DMatrix::from_column_slice(STATES, INPUTS, b.as_slice());
        let regulator = riccati::solve(&a, &b, q, r)?;
        let gain = std::array::from_fn(|i| std::array::from_fn(|j| regulator.gain[(i, j)]));
        let frame = BalanceFrame::new(params);
        Ok(Self {
            outer: Outer::new(&regulator.gain, largest),
            gain,
            frame,
            regulator,
            sampling: Sampling::new(control_dt, <Self as Law>::MEMORY),
            limits,
        })
    }

    /// The Riccati solution behind the gains.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }

    /// Deviation from the setpoint in the linear model's coordinates.
    pub fn deviation(&self, state: &State, setpoint: &Setpoint) -> SVector<f64, STATES> {
        let mut cells = StateCells::default();
        LaneState::from(state).store(&mut cells);
        SVector::from(deviation(&self.frame, &cells.load(Scalar), &SetpointCells::from(setpoint).load(Scalar)))
    }
}

/// Largest element of a cost matrix.
const MAX_COST: f64 = 1e15;

/// Most steps of the search for the eigenvalues of a cost matrix; about two an eigenvalue are needed.
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

/// Deviation from the setpoint in the linear model's coordinates.
#[inline(always)]
fn deviation<L: Lane>(frame: &BalanceFrame, state: &LaneState<L>, setpoint: &LaneSetpoint<L>) -> [L; STATES] {
    let attitude = frame.attitude(state.body_quaternion);
    let heading = Heading::new(attitude);
    let (p, v) = (state.ball_position, state.ball_velocity);
    let [x, y] = heading.of(p.x - setpoint.position[0], p.y - setpoint.position[1]);
    let [vx, vy] = heading.of(v.x - setpoint.velocity[0], v.y - setpoint.velocity[1]);
    let [inertial_x, inertial_y] = attitude.tilt_components();
    let [tilt_x, tilt_y] = heading.of(inertial_x, inertial_y);
    let yaw = wrapped_angle(attitude.yaw() - setpoint.yaw);
    let rate = frame.of_body(state.body_angular_velocity);
    [x, y, tilt_x, tilt_y, yaw, vx, vy, rate.x, rate.y, rate.z]
}

impl Law for Lqr {
    const MEMORY: usize = 0;
    const PARTS: &'static [&'static str] = &["position", "velocity", "yaw"];

    fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    fn sampling_mut(&mut self) -> &mut Sampling {
        &mut self.sampling
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, state: &LaneState<L>, setpoint: &LaneSetpoint<L>, _: &mut Memory<'_, L>) -> [L; 3] {
        let mut x = deviation(&self.frame, state, setpoint);
        self.outer.clip(&mut x);
        let wanted = [product(&self.gain[0], &x), product(&self.gain[1], &x), product(&self.gain[2], &x)];
        self.limits.apply(wanted, state).torques
    }
}

/// The outer loop of a gain: deviations of position ask for a speed, those of position and velocity for a lean. Both are
/// cut as vectors.
#[derive(Clone, Copy, Debug)]
struct Outer {
    /// Speed that has the torques of a deviation of the position.
    speed: [[f64; 2]; 2],
    /// Lean about x and y that has the torques of deviations of position and velocity (x, y, v_x, v_y).
    lean: [[f64; 4]; 2],
    max_lean: f64,
    max_speed: f64,
}

/// Places of position and velocity among the states.
const MOVING: [usize; 4] = [0, 1, 5, 6];

impl Outer {
    fn new(gain: &DMatrix<f64>, [max_lean, max_speed]: [f64; 2]) -> Self {
        let columns = |first: usize| gain.columns(first, 2).into_owned();
        let moving = DMatrix::from_fn(INPUTS, 4, |i, j| gain[(i, MOVING[j])]);
        let (lean, speed) = (equal_torques(columns(2), &moving), equal_torques(columns(5), &columns(0)));
        Self {
            speed: std::array::from_fn(|i| std::array::from_fn(|j| speed[(i, j)])),
            lean: std::array::from_fn(|i| std::array::from_fn(|j| lean[(i, j)])),
            max_lean,
            max_speed,
        }
    }

    /// Cuts the deviations of position and velocity.
    #[inline(always)]
    fn clip<L: Lane>(&self, x: &mut [L; STATES]) {
        let [[a, b], [c, d]] = self.speed;
        let speeds = [x[1].mul_add_all(b, x[0] * a), x[1].mul_add_all(d, x[0] * c)];
        let slower = share_within(speeds, self.max_speed);
        x[0] = x[0] * slower;
        x[1] = x[1] * slower;
        let leans = [lean(&self.lean[0], x), lean(&self.lean[1], x)];
        let less = share_within(leans, self.max_lean);
        for place in MOVING {
            x[place] = x[place] * less;
        }
    }
}

/// The lean about an axis that deviations of position and velocity ask for.
#[inline(always)]
fn lean<L: Lane>(row: &[f64; 4], x: &[L; STATES]) -> L {
    let [a, b, c, d] = MOVING;
    x[d].mul_add_all(row[3], x[c].mul_add_all(row[2], x[b].mul_add_all(row[1], x[a] * row[0])))
}

/// The deviations that have the torques of others: of `gain` those of `other`, in the sense of least squares.
fn equal_torques(gain: DMatrix<f64>, other: &DMatrix<f64>) -> DMatrix<f64> {
    let size = (gain.ncols(), other.ncols());
    // A gain of zero asks for nothing.
    gain.svd(true, true).solve(other, f64::MIN_POSITIVE).unwrap_or_else(|_| DMatrix::zeros(size.0, size.1))
}

/// The share of a vector that is of length `longest`, at most 1.
#[inline(always)]
fn share_within<L: Lane>([x, y]: [L; 2], longest: f64) -> L {
    let (bound, length) = (x.splat(longest), x.mul_add(x, y.squared()).sqrt());
    L::select(bound.lt(length), bound / length, x.splat(1.0))
}

/// −row · x.
#[inline(always)]
fn product<L: Lane>(row: &[f64; STATES], x: &[L; STATES]) -> L {
    let mut sum = x[0] * -row[0];
    for j in 1..STATES {
        sum = x[j].mul_add_all(-row[j], sum);
    }
    sum
}
