//! The linear model in each vertical plane of the heading frame, driven by angular accelerations of the body.

use crate::Constants;
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_models::LinearModel;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::{DMatrix, Schur};

/// One vertical plane, with the lean θ towards positive positions y and the lean acceleration u by the motors: θ̈ = λ²
/// θ + u and ÿ = g θ − ℓ θ̈.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LeanPlane {
    /// λ, the rate at which the robot topples, 1/s.
    pub(crate) toppling: f64,
    /// g, the acceleration per steady lean, m/(s²·rad).
    pub(crate) acceleration: f64,
    /// ℓ, the backward motion of the ball per lean, m.
    pub(crate) lever: f64,
}

impl LeanPlane {
    /// λ².
    pub(crate) fn toppling_squared(&self) -> f64 {
        self.toppling * self.toppling
    }
}

/// Indices of (y, θ, ẏ, θ̇) of the planes among the states of the linear model, and their signs: leaning towards y
/// turns about −x.
pub(crate) const PLACES: [[usize; 4]; 2] = [[0, 3, 5, 8], [1, 2, 6, 7]];
const SIGNS: [[f64; 4]; 2] = [[1.0; 4], [1.0, -1.0, 1.0, -1.0]];

/// The two planes of a robot, and the wheel torques for angular accelerations.
#[derive(Clone, Debug)]
pub(crate) struct LeanPlanes {
    /// The plane of x (tilt about y), and the plane of y (tilt about −x).
    pub(crate) planes: [LeanPlane; 2],
    /// Wheel torques per angular acceleration of the body about the axes of the heading frame, N·m·s².
    torques: Wheels<[f64; 3]>,
}

/// A deviation in the planes.
pub(crate) struct Leaning<L> {
    pub(crate) position: [L; 2],
    pub(crate) velocity: [L; 2],
    pub(crate) lean: [L; 2],
    pub(crate) rate: [L; 2],
}

impl<L: Lane> Leaning<L> {
    /// From a deviation in the linear model's coordinates.
    #[inline(always)]
    pub(crate) fn new(x: &[L; STATES]) -> Self {
        Self { position: [x[0], x[1]], velocity: [x[5], x[6]], lean: [x[3], -x[2]], rate: [x[8], -x[7]] }
    }
}

impl LeanPlanes {
    pub(crate) fn new(params: &Params) -> Self {
        let linear = LinearModel::new(params);
        let torques = linear.turning_torques();
        let LinearModel { a, b } = linear;
        let moving = b.fixed_view::<2, 3>(5, 0) * torques;
        let plane = |toppling_squared: f64, slope: f64, lever: f64| LeanPlane {
            toppling: toppling_squared.sqrt(),
            acceleration: slope + lever * toppling_squared,
            lever,
        };
        Self {
            planes: [plane(a[(8, 3)], a[(5, 3)], -moving[(0, 1)]), plane(a[(7, 2)], -a[(6, 2)], moving[(1, 0)])],
            torques: Wheels::from_fn(|i| std::array::from_fn(|j| torques[(i, j)])),
        }
    }

    /// λ, the mean of both planes, 1/s.
    pub(crate) fn toppling_rate(&self) -> f64 {
        let [x, y] = self.planes;
        0.5 * (x.toppling + y.toppling)
    }

    /// Adds the wheel torques per angular acceleration of the body (3 × 3).
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        constants.matrix("torques_of_acceleration", &self.torques.0)
    }

    /// ℓ/g, the mean of both planes, s².
    pub(crate) fn lag(&self) -> f64 {
        let [x, y] = self.planes.map(|plane| plane.lever / plane.acceleration);
        0.5 * (x + y)
    }

    /// Wheel torques for the accelerations of the leans and of the yaw, N·m.
    #[inline(always)]
    pub(crate) fn wheel_torques<L: Lane>(&self, [x, y]: [L; 2], yaw: L) -> Wheels<L> {
        let turning = [y, -x, -yaw];
        let [a, b, c] = &self.torques.0;
        Wheels([product(a, &turning), product(b, &turning), product(c, &turning)])
    }

    /// Wheel torques per acceleration of the lean in the plane of x (`axis` 0) or y, N·m·s².
    pub(crate) fn driven(&self, axis: usize) -> Wheels<f64> {
        self.wheel_torques(if axis == 0 { [1.0, 0.0] } else { [0.0, 1.0] }, 0.0)
    }

    /// A and b of x⁺ = A x + b u with x = (y, θ, ẏ, θ̇) in the plane of x (`axis` 0) or y, sampled every `dt` seconds,
    /// including viscous friction.
    pub(crate) fn sampled(&self, axis: usize, params: &Params, dt: f64) -> (DMatrix<f64>, DMatrix<f64>) {
        let (a, b) = LinearModel::new(params).discretize(dt);
        let (places, signs) = (PLACES[axis], SIGNS[axis]);
        let driven = b * self.driven(axis).column();
        (
            DMatrix::from_fn(4, 4, |i, j| signs[i] * signs[j] * a[(places[i], places[j])]),
            DMatrix::from_fn(4, 1, |i, _| signs[i] * driven[places[i]]),
        )
    }

    /// K of τ = −K x for accelerations −k (y, θ, ẏ, θ̇) of the lean in each plane, and −k (ψ, ψ̇) of the yaw.
    pub(crate) fn gain(&self, planes: [[f64; 4]; 2], yaw: [f64; 2]) -> DMatrix<f64> {
        let mut accelerations = DMatrix::zeros(3, STATES);
        for (place, k) in [0, 3, 5, 8].into_iter().zip(planes[0]) {
            accelerations[(1, place)] = k;
        }
        for (place, k) in [1, 2, 6, 7].into_iter().zip(planes[1]) {
            // The acceleration about x is −u; tilt and tilt rate also change sign.
            accelerations[(0, place)] = if matches!(place, 2 | 7) { k } else { -k };
        }
        (accelerations[(2, 4)], accelerations[(2, 9)]) = (yaw[0], yaw[1]);
        DMatrix::from_fn(INPUTS, 3, |i, j| self.torques[i][j]) * accelerations
    }

    /// K of τ = −K x for zero angular acceleration of the body in the linear model.
    pub(crate) fn cancelling(&self, linear: &LinearModel) -> DMatrix<f64> {
        let turning = DMatrix::from_fn(3, STATES, |i, j| linear.a[(7 + i, j)]);
        DMatrix::from_fn(INPUTS, 3, |i, j| self.torques[i][j]) * turning
    }
}

/// −row · x.
#[inline(always)]
pub(crate) fn product<L: Lane, const N: usize>(row: &[f64; N], x: &[L; N]) -> L {
    let mut sum = x[0] * -row[0];
    for j in 1..N {
        sum = x[j].mul_add_all(-row[j], sum);
    }
    sum
}

/// Largest number of steps of the pole search; each pole needs about two.
const MAX_POLE_STEPS: usize = 10_000;

/// Magnitudes of the eigenvalues of a real Schur form. Equal poles of two planes are blocks whose discriminant may have
/// either sign by rounding; nalgebra returns NaN for positive ones.
fn magnitudes(form: &DMatrix<f64>) -> Vec<f64> {
    let mut found = Vec::with_capacity(form.nrows());
    let mut k = 0;
    while k < form.nrows() {
        if k + 1 == form.nrows() || form[(k + 1, k)] == 0.0 {
            found.push(form[(k, k)].abs());
            k += 1;
            continue;
        }
        let half = 0.5 * (form[(k, k)] + form[(k + 1, k + 1)]);
        let determinant = form[(k, k)] * form[(k + 1, k + 1)] - form[(k, k + 1)] * form[(k + 1, k)];
        let discriminant = half * half - determinant;
        found.push(if discriminant < 0.0 { determinant.sqrt() } else { half.abs() + discriminant.sqrt() });
        k += 2;
    }
    found
}

/// Checks that the poles of a sampled closed loop are within the unit circle.
pub(crate) fn require_stable(closed_loop: DMatrix<f64>, control_dt: f64) -> Result<()> {
    let schur = Schur::try_new(closed_loop, f64::EPSILON, MAX_POLE_STEPS)
        .ok_or_else(|| Error::Inconsistent("the poles of the closed loop were not found".into()))?;
    let poles = magnitudes(&schur.unpack().1);
    if poles.iter().all(|pole| *pole < 1.0) {
        return Ok(());
    }
    let pole = poles.into_iter().fold(0.0, f64::max);
    Err(Error::Inconsistent(format!(
        "sampled every control_dt = {control_dt} s, the closed loop of the linear model has a pole of magnitude {pole}: \
         it must be below 1"
    )))
}
