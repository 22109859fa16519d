//! The regulator of position, tilt and heading with an integral of the position.

use crate::parts::delayed::{DelayOptions, Delayed};
use crate::parts::joined::joined_fields;
use crate::parts::lean_planes::product;
use crate::parts::outer::{Outer, equal_torques, share_within};
use crate::parts::riccati::{self, Regulator};
use crate::parts::tracking::{Deviation, Tracking};
use crate::{
    Constants, LaneSetpoint, Law, LimitOptions, LqrWeights, MOTION_PARTS, NamedLaw, Sampling, TorqueLimits,
    check_control_dt,
};
use ballbot_base::error::Result;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_models::LinearModel;
use ballbot_models::linear::{INPUTS, STATES};
use nalgebra::{DMatrix, SMatrix};

ballbot_base::fields! {
    /// Options of [`Lqi`] in addition to [`LqrWeights`].
    #[derive(Copy)]
    pub struct IntegralWeights {
        /// Integral of the deviation of the ball position.
        pub integral: f64 = 0.5, "m·s", Limit::from(1e-6).to(1e6);
        /// Not a cost: the largest lean that the integral may command.
        pub max_integral_lean: f64 = 0.069_813_170_079_773_18, "rad", Limit::from(1e-6).to(1e6);
    }
}

/// Deviations of equal cost, as in [`LqrWeights`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LqiWeights {
    /// Weights of the states and inputs of [`crate::Lqr`].
    pub lqr: LqrWeights,
    /// Weights of the integral.
    pub integral: IntegralWeights,
}

joined_fields!(LqiWeights: lqr LqrWeights, integral IntegralWeights);

/// Options of [`Lqi`]: the weights, and the delay of the motors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LqiOptions {
    /// Deviations of equal cost.
    pub weights: LqiWeights,
    /// Delay of the prediction.
    pub delay: DelayOptions,
}

joined_fields!(LqiOptions: weights LqiWeights, delay DelayOptions);

/// Number of states with the integral.
const SIZE: usize = STATES + 2;

/// τ = −K (x, z) with the integral z of the position's deviation, by the Riccati equation of the linear model with two
/// more states, z⁺ = z + T (x, y) (derived in `docs/laws.md`). A constant force, a slope or a wrong center of mass
/// leaves no offset if it requires no more lean than the integral may command; a larger disturbance leaves the offset
/// of [`crate::Lqr`], reduced by the integral.
///
/// z is stored in the inertial frame, so that a turning robot does not wind it up, and rotated into the heading frame.
/// It is limited as a vector so that it commands at most the lean `max_integral_lean`. It is held while the torques are
/// limited, while speed or lean are limited as in [`crate::Lqr`], and while the position deviation commands a larger
/// lean than z may: no disturbance that z can compensate leaves such an offset. With a delay ([`Lqi::with_delay`]) x
/// and z are predicted for the time at which the torque acts; a held z is not predicted.
#[derive(Clone, Debug)]
pub struct Lqi {
    regulator: Regulator,
    /// K of the linear model's states, row by row.
    gain: [[f64; STATES]; INPUTS],
    /// K of the integral.
    integral_gain: [[f64; 2]; INPUTS],
    /// Lean about x and y with the same torques as an integral.
    lean: [[f64; 2]; 2],
    /// Lean about x and y with the same torques as a position deviation.
    position_lean: [[f64; 2]; 2],
    max_integral_lean: f64,
    tracking: Tracking,
    delayed: Delayed<SIZE>,
    outer: Outer,
    sampling: Sampling,
    limits: TorqueLimits,
}

impl NamedLaw for Lqi {
    const NAME: &'static str = "lqi";
    const SUMMARY: &'static str =
        "The regulator with an integral of the position: constant disturbances up to a limit leave no offset.";
    const LABEL: &'static str = "LQI";
    type Options = LqiOptions;

    /// As [`Lqi::with_weights`], with [`Lqi::with_delay`].
    fn with_options(params: &Params, control_dt: f64, options: &LqiOptions, limits: &LimitOptions) -> Result<Self> {
        Self::with_weights(params, control_dt, &options.weights, limits)?.with_delay(params, options.delay.delay)
    }
}

impl Lqi {
    /// A regulator from the linear model of `params`, discretized at `control_dt` (s).
    ///
    /// # Errors
    /// As [`crate::Lqr::with_weights`].
    pub fn with_weights(params: &Params, control_dt: f64, weights: &LqiWeights, limits: &LimitOptions) -> Result<Self> {
        weights.check_limits()?;
        params.validate()?;
        check_control_dt(control_dt)?;
        let limits = TorqueLimits::new(params, limits)?;
        let (a, b) = model(params, control_dt);
        let (cost, r) = weights.lqr.matrices();
        let mut q = DMatrix::zeros(SIZE, SIZE);
        q.view_mut((0, 0), (STATES, STATES)).copy_from(&cost);
        for axis in 0..2 {
            q[(STATES + axis, STATES + axis)] = weights.integral.integral.powi(-2);
        }
        let a = DMatrix::from_column_slice(SIZE, SIZE, a.as_slice());
        let b = DMatrix::from_column_slice(SIZE, INPUTS, b.as_slice());
        let regulator = riccati::solve(&a, &b, &q, &r)?;
        let k = &regulator.gain;
        let lean_of = |first: usize| {
            let lean = equal_torques(k.columns(2, 2).into_owned(), &k.columns(first, 2).into_owned());
            std::array::from_fn(|i| std::array::from_fn(|j| lean[(i, j)]))
        };
        Ok(Self {
            gain: std::array::from_fn(|i| std::array::from_fn(|j| k[(i, j)])),
            integral_gain: std::array::from_fn(|i| std::array::from_fn(|j| k[(i, STATES + j)])),
            lean: lean_of(STATES),
            position_lean: lean_of(0),
            max_integral_lean: weights.integral.max_integral_lean,
            outer: Outer::new(k, [weights.lqr.max_lean, weights.lqr.max_speed]),
            tracking: Tracking::new(params),
            delayed: Delayed::default(),
            regulator,
            sampling: Sampling::new(control_dt, <Self as Law>::MEMORY),
            limits,
        })
    }

    /// For motors whose torque acts `delay` seconds after its command, as [`crate::Lqr::with_delay`].
    ///
    /// # Errors
    /// As [`crate::Lqr::with_delay`].
    pub fn with_delay(mut self, params: &Params, delay: f64) -> Result<Self> {
        let control_dt = self.sampling.control_dt;
        let (a, b) = model(params, control_dt);
        self.delayed = Delayed::of(&a, &b, control_dt, delay)?;
        self.sampling = Sampling::new(control_dt, self.kept());
        Ok(self)
    }

    /// The Riccati solution behind the gains; the last two columns of K belong to the integral.
    pub fn regulator(&self) -> &Regulator {
        &self.regulator
    }

    /// Torque of a wheel before any limit, N·m.
    #[inline(always)]
    fn torque<L: Lane>(&self, wheel: usize, x: &[L; STATES], z: &[L; 2]) -> L {
        product(&self.gain[wheel], x) + product(&self.integral_gain[wheel], z)
    }
}

/// A and B of the sampled linear model with the integral of the position.
fn model(params: &Params, control_dt: f64) -> (SMatrix<f64, SIZE, SIZE>, SMatrix<f64, SIZE, INPUTS>) {
    let (model_a, model_b) = LinearModel::new(params).discretize(control_dt);
    let mut a = SMatrix::<f64, SIZE, SIZE>::identity();
    let mut b = SMatrix::<f64, SIZE, INPUTS>::zeros();
    a.view_mut((0, 0), (STATES, STATES)).copy_from(&model_a);
    b.view_mut((0, 0), (STATES, INPUTS)).copy_from(&model_b);
    (a[(STATES, 0)], a[(STATES + 1, 1)]) = (control_dt, control_dt);
    (a, b)
}

impl Law for Lqi {
    const MEMORY: usize = 2;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    fn sampling_mut(&mut self) -> &mut Sampling {
        &mut self.sampling
    }

    fn kept(&self) -> usize {
        Self::MEMORY + self.delayed.kept()
    }

    fn constants(&self) -> Option<Constants> {
        if self.delayed.kept() > 0 {
            return None;
        }
        let constants = self.tracking.add_to(Constants::default()).matrix("gain", &self.gain);
        let constants = constants
            .matrix("integral_gain", &self.integral_gain)
            .matrix("lean_per_integral", &self.lean)
            .matrix("lean_per_position", &self.position_lean)
            .number("max_integral_lean", self.max_integral_lean);
        Some(self.limits.add_to(self.outer.add_to(constants)))
    }

    #[inline(always)]
    fn torques<L: Lane>(
        &self,
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        largest: f64,
        memory: &mut Memory<'_, L>,
    ) -> Wheels<L> {
        let Deviation { mut x, forward, pose } = self.tracking.deviation(state, setpoint);
        let heading = pose.heading;
        let integral = [memory.get(0), memory.get(1)];
        let z = heading.of(integral[0], integral[1]);
        let (zero, one) = (x[0].zero(), x[0].splat(1.0));
        let delays = self.delayed.kept();
        let (mut forward, mut later) = (forward, z);
        if delays > 0 {
            let mut both = [zero; SIZE];
            both[..STATES].copy_from_slice(&x);
            both[STATES..].copy_from_slice(&z);
            let both = self.delayed.state(both, &memory.after(Self::MEMORY));
            x.copy_from_slice(&both[..STATES]);
            later.copy_from_slice(&both[STATES..]);
            forward = self.tracking.forward_after(&heading, setpoint, self.delayed.seconds());
        }
        let left = self.outer.clip(&mut x);
        let near = turned(&self.position_lean, [x[0], x[1]]);
        let far = left.lt(one) | share_within(near, self.max_integral_lean).lt(one);
        let mut used = z;
        if delays > 0 {
            let within = share_within(turned(&self.lean, later), self.max_integral_lean);
            used = [L::select(far, z[0], later[0] * within), L::select(far, z[1], later[1] * within)];
        }
        let reference = self.tracking.planes.wheel_torques(forward, zero);
        let mut desired = reference;
        for (wheel, torque) in desired.iter_mut().enumerate() {
            *torque += self.torque(wheel, &x, &used);
        }
        let limited = self.limits.apply_at(desired, state, &pose, largest);
        self.delayed.keep(limited.torques - reference, &mut memory.after(Self::MEMORY));
        let held = far | limited.share.lt(one);
        let (p, dt) = (state.ball_position, self.sampling.control_dt);
        let next = [
            (p.x - setpoint.position[0]).mul_add_all(dt, integral[0]),
            (p.y - setpoint.position[1]).mul_add_all(dt, integral[1]),
        ];
        // The length of the lean does not depend on the heading for a robot that is symmetric in all directions.
        let lean = turned(&self.lean, heading.of(next[0], next[1]));
        let share = share_within(lean, self.max_integral_lean);
        for axis in 0..2 {
            memory.set(axis, L::select(held, integral[axis], next[axis] * share));
        }
        limited.torques
    }
}

/// A matrix times a vector.
#[inline(always)]
fn turned<L: Lane>([[a, b], [c, d]]: &[[f64; 2]; 2], [x, y]: [L; 2]) -> [L; 2] {
    [y.mul_add_all(*b, x * *a), y.mul_add_all(*d, x * *c)]
}
