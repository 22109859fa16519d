//! Takagi-Sugeno fuzzy control: regulators for several leans, blended by the lean.

use crate::parts::common_lyapunov::common_lyapunov;
use crate::parts::lean_planes::{LeanPlanes, Leaning, product};
use crate::parts::outer::Outer;
use crate::parts::position_loop::SecondOrder;
use crate::parts::riccati::{self, Regulator, dynamic};
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Law, LqrWeights, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::Lane;
use ballbot_base::wheels::Wheels;
use ballbot_models::{LeaningPlane, LinearModel};
use nalgebra::{DMatrix, Matrix2, Matrix4, SMatrix, Vector2, Vector3, Vector4};

/// Number of rules.
const RULES: usize = 3;

/// Lean between two rules, rad: they are at 0, 15 and 30 deg.
const LEAN_STEP: f64 = std::f64::consts::PI / 12.0;

/// A sampled plane at a rule's lean, with one input: the acceleration of the lean that the motors would produce in an
/// upright robot.
#[derive(Clone, Debug)]
struct Rule {
    a: Matrix4<f64>,
    b: Vector4<f64>,
    k: Vector4<f64>,
}

/// Parallel distributed compensation of a Takagi-Sugeno model (for a ballbot Chiu and Peng, Sustainability 11(14), 2019)
/// in each vertical plane of the heading frame, with a regulator of the heading.
///
/// The rules are regulators with the weights of [`LqrWeights`] for the robot at leans of 0, 15 and 30 deg. Each is
/// weighted by its membership, a triangle over the tilt angle; beyond 30 deg only the last applies. The constructor
/// proves the fuzzy model stable with a common Lyapunov function of all its blends: the cost of rule 0 if it qualifies,
/// else a function found by the ellipsoid method. For the upright robot the controller equals [`Lqr`](crate::Lqr). The
/// speed and lean commands of the position are limited as vectors.
#[derive(Clone, Debug)]
pub struct TakagiSugeno {
    /// k of u = −k (y, θ, ẏ, θ̇) of each rule in each plane.
    gains: [[[f64; 4]; RULES]; 2],
    yaw: SecondOrder,
    decay: [f64; 2],
    outer: Outer,
    tracking: Tracking,
}

impl NamedLaw for TakagiSugeno {
    const NAME: &'static str = "takagi_sugeno";
    const SUMMARY: &'static str = "Regulators for leans of 0, 15 and 30 deg, blended by the lean.";
    const LABEL: &'static str = "Takagi-Sugeno";
    type Options = LqrWeights;

    fn design(plant: &Plant<'_>, weights: &LqrWeights) -> Result<Self> {
        let Plant { params, control_dt, .. } = *plant;
        let tracking = Tracking::new(params);
        let planes = &tracking.planes;
        let (mut gains, mut decay) = ([[[0.0; 4]; RULES]; 2], [0.0; 2]);
        for axis in 0..2 {
            let torques = planes.driven(axis).column();
            let mut rules = Vec::with_capacity(RULES);
            let mut cost = Matrix4::zeros();
            for (number, gains) in gains[axis].iter_mut().enumerate() {
                let plane = LeaningPlane::new(params, axis, number as f64 * LEAN_STEP);
                let (a, b) = sampled(&plane.a, &(plane.b * torques), control_dt);
                let w = weights;
                let regulator = regulated(&a, &b, [w.position, w.tilt, w.velocity, w.tilt_rate], &torques, w.torque)?;
                if number == 0 {
                    cost = Matrix4::from_fn(|i, j| regulator.cost[(i, j)]);
                }
                let k = Vector4::from_fn(|i, _| regulator.gain[(0, i)]);
                *gains = k.into();
                rules.push(Rule { a, b, k });
            }
            decay[axis] = certified(&rules, &cost)?;
        }
        let yaw = yaw_dynamics(plant, planes, weights)?;
        let gain = planes.gain([gains[0][0], gains[1][0]], yaw.gains());
        plant.require_stable(&gain)?;
        Ok(Self { gains, yaw, decay, outer: Outer::new(&gain, [weights.max_lean, weights.max_speed]), tracking })
    }
}

impl TakagiSugeno {
    /// k of u = −k (y, θ, ẏ, θ̇) of the rules at 0, 15 and 30 deg in the planes of x and y; u is the acceleration of
    /// the lean that the motors would produce in the upright robot.
    pub fn gains(&self) -> &[[[f64; 4]; 3]; 2] {
        &self.gains
    }

    /// The largest ratio by which xᵀPx changes per step of the fuzzy model, in the planes of x and y; below 1.
    pub fn decay(&self) -> [f64; 2] {
        self.decay
    }
}

/// Exact discretization for an input held constant over `dt` seconds.
fn sampled(a: &Matrix4<f64>, b: &Vector4<f64>, dt: f64) -> (Matrix4<f64>, Vector4<f64>) {
    let mut block = SMatrix::<f64, 5, 5>::zeros();
    block.fixed_view_mut::<4, 4>(0, 0).copy_from(&(a * dt));
    block.fixed_view_mut::<4, 1>(0, 4).copy_from(&(b * dt));
    let exponential = block.exp();
    (exponential.fixed_view::<4, 4>(0, 0).into_owned(), exponential.fixed_view::<4, 1>(0, 4).into_owned())
}

/// The regulator with deviations of equal cost (Bryson's rule), where the input multiplies the wheel torques `torques`.
fn regulated<const N: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, 1>,
    deviations: [f64; N],
    torques: &Vector3<f64>,
    torque: f64,
) -> Result<Regulator> {
    let q = DMatrix::from_fn(N, N, |i, j| if i == j { deviations[i].powi(-2) } else { 0.0 });
    let r = DMatrix::from_element(1, 1, torques.norm_squared() * torque.powi(-2));
    riccati::solve(&dynamic(a), &dynamic(b), &q, &r)
}

/// Dynamics of the heading under its regulator.
fn yaw_dynamics(plant: &Plant<'_>, planes: &LeanPlanes, weights: &LqrWeights) -> Result<SecondOrder> {
    let dt = plant.control_dt;
    let gain = planes.gain([[0.0; 4]; 2], [0.0, 1.0]);
    let torques = Vector3::from_fn(|i, _| gain[(i, 9)]);
    let drag = LinearModel::new(plant.params).a[(9, 9)];
    let mut block = SMatrix::<f64, 3, 3>::zeros();
    (block[(0, 1)], block[(1, 1)], block[(1, 2)]) = (dt, drag * dt, dt);
    let exponential = block.exp();
    let a: Matrix2<f64> = exponential.fixed_view::<2, 2>(0, 0).into_owned();
    let b: Vector2<f64> = exponential.fixed_view::<2, 1>(0, 2).into_owned();
    let regulator = regulated(&a, &b, [weights.yaw, weights.yaw_rate], &torques, weights.torque)?;
    Ok(SecondOrder { stiffness: regulator.gain[(0, 0)], damping: regulator.gain[(0, 1)] })
}

/// The largest ratio xᵀGᵀPGx / xᵀPx, with a P for which it is below 1 for all G = ½ (A_i − B_i k_j + A_j − B_j k_i) of
/// one rule or of two neighbors; only neighbors are active together. This makes xᵀPx a Lyapunov function of the blended
/// model (Tanaka & Wang, Fuzzy Control Systems Design and Analysis, 2001, ch. 2).
fn certified(rules: &[Rule], cost: &Matrix4<f64>) -> Result<f64> {
    let blends = (0..rules.len()).flat_map(|i| [i, i + 1].map(|j| (i, j))).filter(|(_, j)| *j < rules.len());
    let steps: Vec<_> = blends
        .map(|(i, j)| {
            let (first, second) = (&rules[i], &rules[j]);
            (first.a - first.b * second.k.transpose() + second.a - second.b * first.k.transpose()) * 0.5
        })
        .collect();
    common_lyapunov(&steps, cost).map(|(_, ratio)| ratio).ok_or_else(|| {
        Error::Inconsistent(
            "no proof that the fuzzy model is stable: its rules at 0, 15 and 30 deg have no common Lyapunov function"
                .into(),
        )
    })
}

/// Memberships of the tilt `tilt` (rad, not negative) in the rules.
#[inline(always)]
fn memberships<L: Lane>(tilt: L) -> [L; RULES] {
    let one = tilt.splat(1.0);
    let scaled = tilt * (1.0 / LEAN_STEP);
    let last = one + one;
    let scaled = L::select(last.lt(scaled), last, scaled);
    let far = one.lt(scaled);
    let (zero, above) = (one.zero(), scaled - one);
    [L::select(far, zero, -above), L::select(far, last - scaled, scaled), L::select(far, above, zero)]
}

impl Law for TakagiSugeno {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Deviation { mut x, forward, pose } = self.tracking.deviation(sample.state, sample.setpoint);
        self.outer.clip(&mut x);
        let Leaning { position, velocity, lean, rate } = Leaning::new(&x);
        let [tilt_x, tilt_y] = self.tracking.frame.attitude(sample.state.body_quaternion).tilt_components();
        let weights = memberships(tilt_x.mul_add(tilt_x, tilt_y.squared()).sqrt());
        let mut accelerations = forward;
        for axis in 0..2 {
            let deviation = [position[axis], lean[axis], velocity[axis], rate[axis]];
            for (gains, weight) in self.gains[axis].iter().zip(weights) {
                accelerations[axis] = weight.mul_add(product(gains, &deviation), accelerations[axis]);
            }
        }
        let desired = self.tracking.planes.wheel_torques(accelerations, self.yaw.returning(x[4], x[9]));
        sample.limited_at(desired, &pose).torques
    }
}
