//! Fuzzy rules on the lean's error and its rate.

use crate::parts::lean_planes::{LeanPlane, Leaning};
use crate::parts::position_loop::{PositionLoop, SecondOrder};
use crate::parts::rule_table::RuleTable;
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Law, LimitOptions, MOTION_PARTS, NamedLaw, Plant, Sample, Sampled};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;
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
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(0.0).to(1e6), scaled;
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
}

impl NamedLaw for FuzzyMamdani {
    const NAME: &'static str = "fuzzy_mamdani";
    const SUMMARY: &'static str = "Fuzzy rules on the lean's error and its rate, below a PD of the position.";
    const LABEL: &'static str = "fuzzy rules";
    type Options = FuzzyOptions;

    fn design(plant: &Plant<'_>, options: &FuzzyOptions) -> Result<Self> {
        Self::of_rules(plant, options, &RuleTable::default())
    }
}

impl FuzzyMamdani {
    /// A controller with custom rules, scaled like the default rules.
    ///
    /// # Errors
    /// As [`Sampled::new`]; [`ballbot_base::Error::Inconsistent`] if the sampled loop of the linear model with the
    /// rules' slopes in the middle is not stable.
    pub fn with_rules(
        params: &Params,
        control_dt: f64,
        rules: RuleTable,
        options: &FuzzyOptions,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        Sampled::new(params, control_dt, options, limits, |plant, options| Self::of_rules(plant, options, &rules))
    }

    fn of_rules(plant: &Plant<'_>, options: &FuzzyOptions, rules: &RuleTable) -> Result<Self> {
        let tracking = Tracking::new(plant.params);
        let planes = &tracking.planes;
        let lean = SecondOrder::new(options.lean_bandwidth * planes.toppling_rate(), options.lean_damping);
        let poles = [options.position_bandwidth, options.position_damping];
        let law = Self {
            rules: *rules,
            ranges: planes.planes.each_ref().map(|plane| Ranges::new(plane, &lean, options.range)),
            position: PositionLoop::new(planes, lean, poles, [options.max_lean, options.max_speed]),
            yaw: SecondOrder::new(options.yaw_bandwidth, options.yaw_damping),
            tracking,
        };
        plant.require_stable(&law.gain())?;
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
        self.tracking.planes.gain(planes, self.yaw.gains())
    }
}

impl Law for FuzzyMamdani {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let Deviation { x, forward, pose } = self.tracking.deviation(sample.state, sample.setpoint);
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
        let desired = self.tracking.planes.wheel_torques(accelerations, self.yaw.returning(x[4], x[9]));
        sample.limited_at(desired, &pose).torques
    }
}
