//! Sliding mode of the attitude.

use crate::parts::attitude_loop::AttitudeLoop;
use crate::parts::position_loop::SecondOrder;
use crate::parts::tracking::Tracking;
use crate::{Law, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::wheels::Wheels;

ballbot_base::fields! {
    /// Surface, switching and boundary layer of [`SlidingMode`], and the poles of the position. Quantities of the lean
    /// are in units of λ, the rate at which the robot topples, so that they suit robots of any size.
    #[derive(Copy)]
    pub struct AttitudeSlidingOptions {
        /// K, the rate at which the lean's error decays on the surface, over λ.
        pub surface: f64 = 1.8, "", Limit::from(1e-3).to(1e3);
        /// η, the rate at which S decays outside of the boundary layer, over λ².
        pub switching: f64 = 0.24, "", Limit::from(1e-6).to(1e6);
        /// ε, the width of the boundary layer, over λ.
        pub layer: f64 = 0.16, "", Limit::from(1e-6).to(1e6);
        /// K of the heading.
        pub yaw_surface: f64 = 4.0, "1/s", Limit::from(1e-3).to(1e3);
        /// η of the heading.
        pub yaw_switching: f64 = 2.0, "1/s²", Limit::from(1e-6).to(1e6);
        /// ε of the heading.
        pub yaw_layer: f64 = 0.5, "1/s", Limit::from(1e-6).to(1e6);
        /// Natural frequency of the two poles of the position, over λ.
        pub position_bandwidth: f64 = 0.25, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the two poles of the position.
        pub position_damping: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// The largest lean that the position may command; 0 for an attitude without a position.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(0.0).to(1e6), scaled;
        /// The largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
    }
}

/// Surface, switching and layer about an axis: K (1/s), η (1/s²) and ε (1/s).
#[derive(Clone, Copy, Debug)]
struct Sliding {
    surface: f64,
    switching: f64,
    layer: f64,
}

impl Sliding {
    /// The error's dynamics within the layer: v̈ + (K + η/ε) v̇ + (K η/ε) v = 0.
    fn within_layer(&self) -> SecondOrder {
        let reaching = self.switching / self.layer;
        SecondOrder { damping: self.surface + reaching, stiffness: self.surface * reaching }
    }
}

/// Sliding mode of the attitude (Jespersen, Aalborg University 2019: the robot Kugle).
///
/// With v = vec(q_e), the vector part of the attitude's error q_e = q_ref* ∘ q, the surface is S = v̇ + K v. The
/// equivalent control holds S in the exact equations of motion without slip ([`ballbot_models::InverseDynamics`]), the
/// rest makes Ṡ = −η S / max(|S|, ε), with the horizontal axes as one vector. Within the layer this is
/// [`PdInverseDynamics`](crate::PdInverseDynamics) with ω² = K η/ε and 2ζω = K + η/ε; outside it commands at most 2η of
/// angular acceleration to reach the surface. The reference is the same as in
/// [`PdInverseDynamics`](crate::PdInverseDynamics).
#[derive(Clone, Debug)]
pub struct SlidingMode {
    attitude: AttitudeLoop,
    lean: Sliding,
    yaw: Sliding,
}

impl NamedLaw for SlidingMode {
    const NAME: &'static str = "sliding_mode";
    const SUMMARY: &'static str =
        "Sliding mode of the attitude with the robot's dynamics cancelled, below a PD of the position.";
    const LABEL: &'static str = "attitude sliding mode";
    type Options = AttitudeSlidingOptions;

    fn design(plant: &Plant<'_>, options: &AttitudeSlidingOptions) -> Result<Self> {
        let tracking = Tracking::new(plant.params);
        let rate = tracking.planes.toppling_rate();
        let lean = Sliding {
            surface: options.surface * rate,
            switching: options.switching * rate * rate,
            layer: options.layer * rate,
        };
        let yaw = Sliding { surface: options.yaw_surface, switching: options.yaw_switching, layer: options.yaw_layer };
        let poles = [options.position_bandwidth, options.position_damping];
        let largest = [options.max_lean, options.max_speed];
        let within = [lean.within_layer(), yaw.within_layer()];
        Ok(Self { attitude: AttitudeLoop::new(plant, tracking, within, poles, largest)?, lean, yaw })
    }
}

impl Law for SlidingMode {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let error = self.attitude.error(sample);
        let (v, rate) = (error.error, error.rate);
        let (lean, yaw) = (&self.lean, &self.yaw);
        let x = v.x.mul_add_all(lean.surface, rate.x);
        let y = v.y.mul_add_all(lean.surface, rate.y);
        let z = v.z.mul_add_all(yaw.surface, rate.z);
        let tilting = decay(x.mul_add(x, y.squared()).sqrt(), lean);
        let turning = decay(z.abs(), yaw);
        // v̈ for which Ṡ = v̈ + K v̇ is −S times the decay.
        let desired = Vec3::new(
            x.neg_mul_add(tilting, rate.x * -lean.surface),
            y.neg_mul_add(tilting, rate.y * -lean.surface),
            z.neg_mul_add(turning, rate.z * -yaw.surface),
        );
        sample.limited(self.attitude.torques(&error, desired)).torques
    }
}

/// η / max(|S|, ε).
#[inline(always)]
fn decay<L: Lane>(length: L, sliding: &Sliding) -> L {
    length.splat(sliding.switching) / length.max(length.splat(sliding.layer))
}
