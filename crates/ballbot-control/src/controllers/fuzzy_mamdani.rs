//! Fuzzy rules on the lean's error and its rate.

use crate::parts::lean_planes::{LeanPlane, Leaning, require_stable};
use crate::parts::position_loop::{PositionLoop, PositionOptions, SecondOrder};
use crate::parts::rule_table::RuleTable;
use crate::parts::tracking::{Deviation, Tracking};
use crate::{LaneSetpoint, Law, LimitOptions, MOTION_PARTS, NamedLaw, Sampling, TorqueLimits, check_control_dt};
use ballbot_base::error::Result;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
use ballbot_models::LinearModel;
use ballbot_models::linear::STATES;
use nalgebra::DMatrix;

ballbot_base::fields! {
    /// Slopes and range of the rules of [`FuzzyMamdani`], and the poles of the position. Frequencies of lean and position
    /// are in units of λ, the rate at which the robot topples, so that they suit robots of any size.
    #[derive(Copy)]
    pub struct FuzzyOptions {
        /// Natural frequency of the lean's error where the default rules are not at their ends, over λ.
        pub lean_bandwidth: f64 = 1.6, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the lean's error there.
        pub lean_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// E, the error of the lean from which it belongs to the last set.
        pub range: f64 = 0.349_065_850_398_865_9, "rad", Limit::from(1e-6).to(1e6);
        /// Natural frequency of the two poles of the position, over λ.
        pub position_bandwidth: f64 = 0.25, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the two poles of the position.
        pub position_damping: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// Natural frequency of the heading.
        pub yaw_bandwidth: f64 = 4.0, "rad/s", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the heading.
        pub yaw_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// The largest lean that the position may command.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(0.0).to(1e6);
        /// The largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
    }
}

/// Scaling of the rules in a plane.
#[derive(Clone, Copy, Debug)]
struct Ranges {
    /// 1 / E and 1 / Ė.
    inputs: [f64; 2],
    /// U, the acceleration of the lean by the motors at an output of 1.
    output: f64,
}

impl Ranges {
    /// Scaling that gives the default rules the slopes λ² + σ and δ in the middle.
    fn new(plane: &LeanPlane, lean: &SecondOrder, range: f64) -> Self {
        let output = (plane.toppling_squared() + lean.stiffness) * range;
        Self { inputs: [range.recip(), lean.damping / output], output }
    }
}

/// Mamdani's fuzzy control of the lean (for a ballbot Navabi et al., Advances in Fuzzy Systems 2017, 2651976) in each
/// vertical plane of the heading frame, with a PD of the heading.
///
/// With the error e = θ_ref − θ the motors accelerate the lean by U Φ(e/E, ė/Ė) − λ² θ_ref, where Φ is a [`RuleTable`].
/// E is an option; Ė and U give the default rules the slopes of a PD with gravity compensation in the middle, (s² + 2ζω
/// s + ω²) e = 0. Towards its ends the table gives less. The reference is the same as in
/// [`PdInverseDynamics`](crate::PdInverseDynamics). Derived in `docs/laws.md`.
#[derive(Clone, Debug)]
pub struct FuzzyMamdani {
    rules: RuleTable,
    ranges: [Ranges; 2],
    position: PositionLoop,
    yaw: SecondOrder,
    tracking: Tracking,
    sampling: Sampling,
    limits: TorqueLimits,
}

impl NamedLaw for FuzzyMamdani {
    const NAME: &'static str = "fuzzy_mamdani";
    const SUMMARY: &'static str = "Fuzzy rules on the lean's error and its rate, below a PD of the position.";
    const LABEL: &'static str = "fuzzy rules";
    type Options = FuzzyOptions;

    /// A controller for `params` with the default rules, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// As [`FuzzyMamdani::with_rules`].
    fn with_options(params: &Params, control_dt: f64, options: &FuzzyOptions, limits: &LimitOptions) -> Result<Self> {
        Self::with_rules(params, control_dt, RuleTable::default(), options, limits)
    }
}

impl FuzzyMamdani {
    /// A controller with custom rules, scaled like the default rules.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for an option out of range, errors of [`TorqueLimits::new`],
    /// [`ballbot_base::Error::Inconsistent`] if the sampled loop of the linear model with the rules' slopes in the middle is
    /// not stable.
    pub fn with_rules(
        params: &Params,
        control_dt: f64,
        rules: RuleTable,
        options: &FuzzyOptions,
        limits: &LimitOptions,
    ) -> Result<Self> {
        params.validate()?;
        check_control_dt(control_dt)?;
        options.check_limits()?;
        let limits = TorqueLimits::new(params, limits)?;
        let tracking = Tracking::new(params);
        let planes = &tracking.planes.planes;
        let rate = tracking.planes.toppling_rate();
        let lean = SecondOrder::new(options.lean_bandwidth * rate, options.lean_damping);
        let position = PositionOptions {
            bandwidth: options.position_bandwidth,
            damping: options.position_damping,
            max_lean: options.max_lean,
            max_speed: options.max_speed,
        };
        let law = Self {
            rules,
            ranges: [Ranges::new(&planes[0], &lean, options.range), Ranges::new(&planes[1], &lean, options.range)],
            position: PositionLoop::new(&tracking.planes, lean, &position),
            yaw: SecondOrder::new(options.yaw_bandwidth, options.yaw_damping),
            tracking,
            sampling: Sampling::new(control_dt, <Self as Law>::MEMORY),
            limits,
        };
        let (a, b) = LinearModel::new(params).discretize(control_dt);
        let closed = a - b * law.gain();
        require_stable(DMatrix::from_column_slice(STATES, STATES, closed.as_slice()), control_dt)?;
        Ok(law)
    }

    /// K of τ = −K x with the slopes of the rules in the middle.
    fn gain(&self) -> DMatrix<f64> {
        let slopes = self.rules.slopes();
        let mut planes = [[0.0; 4]; 2];
        for (axis, k) in planes.iter_mut().enumerate() {
            let Ranges { inputs, output } = self.ranges[axis];
            let [error, rate] = [slopes[0] * inputs[0] * output, slopes[1] * inputs[1] * output];
            let reference = error - self.tracking.planes.planes[axis].toppling_squared();
            *k = self.position.feedback(axis).map(|commanded| commanded * reference);
            k[1] += error;
            k[3] += rate;
        }
        self.tracking.planes.gain(planes, [self.yaw.stiffness, self.yaw.damping])
    }
}

impl Law for FuzzyMamdani {
    const MEMORY: usize = 0;
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    fn sampling_mut(&mut self) -> &mut Sampling {
        &mut self.sampling
    }

    #[inline(always)]
    fn torques<L: Lane>(
        &self,
        state: &LaneState<L>,
        setpoint: &LaneSetpoint<L>,
        largest: f64,
        _: &mut Memory<'_, L>,
    ) -> Wheels<L> {
        let Deviation { x, forward, pose } = self.tracking.deviation(state, setpoint);
        let leaning = Leaning::new(&x);
        let commanded = self.position.lean(&leaning);
        let mut accelerations = forward;
        for axis in 0..2 {
            let Ranges { inputs, output } = self.ranges[axis];
            let (error, rate) = (commanded[axis] - leaning.lean[axis], -leaning.rate[axis]);
            let driven = self.rules.output(error * inputs[0], rate * inputs[1]);
            let toppling = self.tracking.planes.planes[axis].toppling_squared();
            accelerations[axis] += driven.mul_add_all(output, commanded[axis] * -toppling);
        }
        let turning = x[4].mul_add_all(-self.yaw.stiffness, x[9] * -self.yaw.damping);
        let desired = self.tracking.planes.wheel_torques(accelerations, turning);
        self.limits.apply_at(desired, state, &pose, largest).torques
    }
}
