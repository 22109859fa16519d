//! Hierarchical sliding mode of position and lean.

use crate::parts::lean_observer::{self, LeanObserver};
use crate::parts::lean_planes::{LeanPlane, Leaning};
use crate::parts::outer::Outer;
use crate::parts::position_loop::SecondOrder;
use crate::parts::switching_gain::SwitchingGain;
use crate::parts::tracking::{Deviation, Tracking};
use crate::{Constants, Law, LimitOptions, Limited, MOTION_PARTS, NamedLaw, Plant, Sample, Sampled};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

ballbot_base::fields! {
    /// The poles on the sliding surface of [`HierarchicalSlidingMode`], and the reaching law. The poles are in units of
    /// λ, the rate at which the robot topples, so that they suit robots of any size.
    #[derive(Copy)]
    pub struct SlidingModeOptions {
        /// Natural frequency of a pair of poles, over λ.
        pub pair_bandwidth: f64 = 0.25, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the pair.
        pub pair_damping: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// The third pole, over λ.
        pub real_pole: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// K_S, the rate at which S decays, over λ.
        pub reaching: f64 = 1.3, "", Limit::from(0.0).to(1e3);
        /// η, by which S decays faster outside of the boundary layer.
        pub switching: f64 = 1.0, "rad/s²", Limit::from(0.0).to(1e6);
        /// φ, the width of the boundary layer.
        pub layer: f64 = 0.2, "rad/s", Limit::from(1e-6).to(1e6);
        /// γ, by which η grows with the distance from the boundary layer; 0 for a fixed η.
        pub adaptation: f64 = 0.0, "1/s²", Limit::from(0.0).to(1e6);
        /// σ, the rate at which what η has grown by decays; with `adaptation` alone.
        pub leakage: f64 = 1.0, "1/s", Limit::from(0.0).to(1e3);
        /// The largest η that is adapted, above `switching`; with `adaptation` alone.
        pub max_switching: f64 = 5.0, "rad/s²", Limit::from(0.0).to(1e6);
        /// Natural frequency of the heading.
        pub yaw_bandwidth: f64 = 4.0, "rad/s", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the heading.
        pub yaw_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// The largest lean that deviations of position and velocity may command.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(1e-6).to(1e6), scaled;
        /// The largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
        /// Rate at which the lean in equilibrium is estimated, which a slope, a force and a wrong center of mass
        /// change; 0 for no estimate.
        pub lean_observer: f64 = 0.0, "1/s", lean_observer::LIMIT;
    }
}

impl SlidingModeOptions {
    /// Checks that the adaptation options are set only with adaptation, without which they have no effect.
    fn check_adaptation(&self) -> Result<()> {
        let Self { switching, adaptation, leakage, max_switching, .. } = *self;
        let usual = Self::default();
        if adaptation > 0.0 {
            let words = format_args!("above switching = {switching}, with adaptation = {adaptation}");
            check("max_switching", max_switching, words, |most| most > switching)?;
            return Ok(());
        }
        for (name, value, default) in
            [("leakage", leakage, usual.leakage), ("max_switching", max_switching, usual.max_switching)]
        {
            if value != default {
                return Err(Error::Inconsistent(format!("{name} = {value} changes nothing with adaptation = 0")));
            }
        }
        Ok(())
    }
}

/// S = α (c₁ y + ẏ) + c₂ θ + θ̇ of one vertical plane, θ leaning towards positive y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlidingSurface {
    /// α, rad/m.
    pub alpha: f64,
    /// c₁, 1/s.
    pub c1: f64,
    /// c₂, 1/s.
    pub c2: f64,
}

impl SlidingSurface {
    /// The surface on which the plane has the poles of the options, derived in `docs/laws.md`.
    fn new(plane: &LeanPlane, options: &SlidingModeOptions) -> Self {
        let LeanPlane { toppling, acceleration, lever } = *plane;
        let [product, sum] = SecondOrder::new(options.pair_bandwidth * toppling, options.pair_damping).gains();
        let real = options.real_pole * toppling;
        let [p2, p1, p0] = [sum + real, product + sum * real, product * real];
        let alpha = p1 / (acceleration + p1 * lever);
        let c1 = p0 / p1;
        Self { alpha, c1, c2: p2 * (1.0 - alpha * lever) + alpha * c1 * lever }
    }

    /// Checks that the plane is stable on the surface: Routh criterion for (1 − αℓ) s³ + (c₂ − α c₁ ℓ) s² + α g s + α
    /// c₁ g.
    fn check(&self, plane: &LeanPlane) -> Result<()> {
        let Self { alpha, c1, c2 } = *self;
        let most = plane.lever.recip();
        if alpha > 0.0 && alpha < most && c1 > 0.0 && c2 > c1 && c2.is_finite() {
            return Ok(());
        }
        Err(Error::Inconsistent(format!(
            "the robot falls or runs away on the surface with alpha = {alpha} rad/m, c1 = {c1} 1/s, c2 = {c2} 1/s: \
             it needs 0 < alpha < {most} rad/m and 0 < c1 < c2"
        )))
    }
}

/// The gains of one plane.
#[derive(Clone, Copy, Debug)]
struct Gains {
    surface: SlidingSurface,
    /// k of the equivalent control, u = −k (θ, ẏ, θ̇).
    equivalent: [f64; 3],
    /// 1 / (1 − αℓ): the acceleration by the motors per unit of Ṡ.
    per_rate: f64,
}

impl Gains {
    fn new(plane: &LeanPlane, surface: SlidingSurface) -> Result<Self> {
        surface.check(plane)?;
        let SlidingSurface { alpha, c1, c2 } = surface;
        let per_rate = (1.0 - alpha * plane.lever).recip();
        let toppling = plane.toppling_squared();
        // Terms of Ṡ without motors: ÿ = (g − ℓ λ²) θ, θ̈ = λ² θ.
        let of_lean = alpha * (plane.acceleration - plane.lever * toppling) + toppling;
        Ok(Self { surface, equivalent: [of_lean * per_rate, alpha * c1 * per_rate, c2 * per_rate], per_rate })
    }

    /// k of u = −k (y, θ, ẏ, θ̇) with S decaying at `rate`.
    fn feedback(&self, rate: f64) -> [f64; 4] {
        let (SlidingSurface { alpha, c1, c2 }, [lean, velocity, lean_rate]) = (self.surface, self.equivalent);
        let reaching = rate * self.per_rate;
        [reaching * alpha * c1, lean + reaching * c2, velocity + reaching * alpha, lean_rate + reaching]
    }
}

/// Aggregated hierarchical sliding mode (Pham, Lee, Bui, Truong, IntechOpen 2022, doi 10.5772/intechopen.101855) in
/// each vertical plane of the heading frame, with a PD of the heading.
///
/// With y the deviation of the position and θ the lean towards it, S = α (c₁ y + ẏ) + c₂ θ + θ̇. The equivalent control
/// of the linear model holds S; the rest makes Ṡ = −K_S S − η S / max(|S|, φ), where S is the vector of both planes.
/// The decay of S does not imply decay of y and θ, which obey a cubic on S = 0: its poles are the options, and α, c₁,
/// c₂ follow from them (derived in `docs/laws.md`). With `adaptation` η grows outside the layer, up to `max_switching`,
/// and leaks. The speed and lean commands of the position are limited as vectors.
#[derive(Clone, Debug)]
pub struct HierarchicalSlidingMode {
    tracking: Tracking,
    gains: [Gains; 2],
    /// K_S, 1/s.
    reaching: f64,
    switching: SwitchingGain,
    layer: f64,
    yaw: SecondOrder,
    outer: Outer,
    observer: LeanObserver,
}

impl NamedLaw for HierarchicalSlidingMode {
    const NAME: &'static str = "hierarchical_sliding_mode";
    const SUMMARY: &'static str = "Sliding mode on a sum of the surfaces of position and lean.";
    const LABEL: &'static str = "sliding mode";
    type Options = SlidingModeOptions;

    fn design(plant: &Plant<'_>, options: &SlidingModeOptions) -> Result<Self> {
        Self::of_surfaces(plant, options, |_, plane| SlidingSurface::new(plane, options))
    }
}

impl HierarchicalSlidingMode {
    /// A controller with custom surfaces in the planes of x and y; the poles of the options are not used.
    ///
    /// # Errors
    /// As [`NamedLaw::with_options`], and [`Error::Inconsistent`] for a surface on which the robot is unstable, with
    /// its numbers and their limits.
    pub fn with_surfaces(
        params: &Params,
        control_dt: f64,
        surfaces: [SlidingSurface; 2],
        options: &SlidingModeOptions,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        Sampled::new(params, control_dt, options, limits, |plant, options| {
            Self::of_surfaces(plant, options, |axis, _| surfaces[axis])
        })
    }

    fn of_surfaces(
        plant: &Plant<'_>,
        options: &SlidingModeOptions,
        surface: impl Fn(usize, &LeanPlane) -> SlidingSurface,
    ) -> Result<Self> {
        options.check_adaptation()?;
        let tracking = Tracking::new(plant.params);
        let observer = LeanObserver::new(plant, &tracking, options.lean_observer)?;
        let planes = &tracking.planes;
        let [x, y] = planes.planes;
        let gains = [Gains::new(&x, surface(0, &x))?, Gains::new(&y, surface(1, &y))?];
        let yaw = SecondOrder::new(options.yaw_bandwidth, options.yaw_damping);
        let reaching = options.reaching * 0.5 * (x.toppling + y.toppling);
        let gains_of = [options.switching, options.max_switching];
        let switching = SwitchingGain::new(gains_of, options.adaptation, options.leakage, plant.control_dt);
        let gain_of = |switching: f64| {
            let rate = reaching + switching / options.layer;
            planes.gain(gains.map(|gains| gains.feedback(rate)), yaw.gains())
        };
        let within_layer = gain_of(switching.fixed());
        plant.require_stable(&within_layer)?;
        plant.require_stable(&gain_of(switching.largest()))?;
        Ok(Self {
            // Uses the gains within the layer, where they are largest.
            outer: Outer::new(&within_layer, [options.max_lean, options.max_speed]),
            gains,
            reaching,
            switching,
            layer: options.layer,
            yaw,
            tracking,
            observer,
        })
    }

    /// The surfaces in the planes of x and y.
    pub fn surfaces(&self) -> [SlidingSurface; 2] {
        self.gains.map(|gains| gains.surface)
    }
}

impl Law for HierarchicalSlidingMode {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    fn constants(&self) -> Option<Constants> {
        let [x, y] = &self.gains;
        let constants = self
            .tracking
            .add_to(Constants::default())
            .vector("alpha", &[x.surface.alpha, y.surface.alpha])
            .vector("c1", &[x.surface.c1, y.surface.c1])
            .vector("c2", &[x.surface.c2, y.surface.c2])
            .vector("lean_gains", &[x.equivalent[0], y.equivalent[0]])
            .vector("velocity_gains", &[x.equivalent[1], y.equivalent[1]])
            .vector("rate_gains", &[x.equivalent[2], y.equivalent[2]])
            .vector("per_rate", &[x.per_rate, y.per_rate])
            .number("reaching", self.reaching)
            .number("switching", self.switching.fixed())
            .number("layer", self.layer)
            .vector("yaw_gains", &self.yaw.gains());
        Some(self.outer.add_to(constants))
    }

    fn kept(&self) -> usize {
        self.switching.kept() + self.observer.kept()
    }

    fn force_index(&self) -> Option<usize> {
        self.observer.force_index(self.switching.kept())
    }

    fn force_deviation(&self, noise: &[f64; 3]) -> Option<[f64; 2]> {
        self.observer.force_deviation(noise)
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let adapted = self.switching.kept();
        let (Deviation { mut x, forward, pose }, _) = self.observer.deviation(&self.tracking, sample, adapted);
        self.outer.clip(&mut x);
        let Leaning { position, velocity, lean, rate } = Leaning::new(&x);
        let (mut s, mut accelerations) = ([x[0]; 2], [x[0]; 2]);
        for axis in 0..2 {
            let Gains {
                surface: SlidingSurface { alpha, c1, c2 }, equivalent: [of_lean, of_velocity, of_rate], ..
            } = self.gains[axis];
            let moving = position[axis].mul_add_all(c1, velocity[axis]);
            s[axis] = moving.mul_add_all(alpha, lean[axis].mul_add_all(c2, rate[axis]));
            let turning = lean[axis].mul_add_all(-of_lean, rate[axis] * -of_rate);
            accelerations[axis] = velocity[axis].mul_add_all(-of_velocity, turning);
        }
        let length = s[0].mul_add(s[0], s[1].squared()).sqrt();
        let layer = length.splat(self.layer);
        let decay = self.switching.now(length, &sample.memory) / length.max(layer) + self.reaching;
        for axis in 0..2 {
            accelerations[axis] =
                (s[axis] * decay).mul_add_all(-self.gains[axis].per_rate, accelerations[axis] + forward[axis]);
        }
        let desired = self.tracking.planes.wheel_torques(accelerations, self.yaw.returning(x[4], x[9]));
        let Limited { torques, share, .. } = sample.limited_at(desired, &pose);
        self.switching.adapt(length - layer, share, &mut sample.memory);
        self.observer.predict(sample, adapted, &pose, torques, share);
        torques
    }
}
