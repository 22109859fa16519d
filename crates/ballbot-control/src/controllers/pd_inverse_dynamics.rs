//! Computed torque on the attitude: a PD of its error, with cancellation of the robot's dynamics.

use crate::parts::attitude_loop::AttitudeLoop;
use crate::parts::position_loop::SecondOrder;
use crate::parts::tracking::Tracking;
use crate::{Law, MOTION_PARTS, NamedLaw, Plant, Sample};
use ballbot_base::error::Result;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Lane, Vec3};
use ballbot_base::wheels::Wheels;

ballbot_base::fields! {
    /// Error dynamics of the attitude under [`PdInverseDynamics`], and the poles of the position. Frequencies of lean
    /// and position are in units of λ, the rate at which the robot topples, so that they suit robots of any size.
    #[derive(Copy)]
    pub struct InverseDynamicsOptions {
        /// Natural frequency of the lean's error, over λ.
        pub lean_bandwidth: f64 = 1.6, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the lean's error.
        pub lean_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// Natural frequency of the two poles of the position, over λ.
        pub position_bandwidth: f64 = 0.25, "", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the two poles of the position.
        pub position_damping: f64 = 0.8, "", Limit::from(1e-3).to(1e3);
        /// Natural frequency of the heading.
        pub yaw_bandwidth: f64 = 4.0, "rad/s", Limit::from(1e-3).to(1e3);
        /// Damping ratio of the heading.
        pub yaw_damping: f64 = 1.0, "", Limit::from(1e-3).to(1e3);
        /// The largest lean that the position may command; 0 for an attitude without a position.
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(0.0).to(1e6), scaled;
        /// The largest speed that a deviation of the position may command.
        pub max_speed: f64 = 1.0, "m/s", Limit::from(1e-6).to(1e6);
    }
}

/// PD with inverse dynamics (computed torque, partial feedback linearization; for a ballbot İnal, Morgül and Saranlı,
/// IROS 2012) for tilt and heading together.
///
/// With v = vec(q_e), the vector part of the attitude's error q_e = q_ref* ∘ q, the wheels are driven so that v̈ + 2ζω
/// v̇ + ω² v = 0 in the exact equations of the motion without slip ([`ballbot_models::InverseDynamics`]). The reference
/// lean is the lean of the setpoint's motion plus the command of a PD of the position, limited as a vector. Derived in
/// `docs/laws.md`. The design is for a level floor.
#[derive(Clone, Debug)]
pub struct PdInverseDynamics {
    attitude: AttitudeLoop,
    lean: SecondOrder,
    yaw: SecondOrder,
}

impl NamedLaw for PdInverseDynamics {
    const NAME: &'static str = "pd_inverse_dynamics";
    const SUMMARY: &'static str = "PD of the attitude with the robot's dynamics cancelled, below a PD of the position.";
    const LABEL: &'static str = "computed torque";
    type Options = InverseDynamicsOptions;

    fn design(plant: &Plant<'_>, options: &InverseDynamicsOptions) -> Result<Self> {
        let tracking = Tracking::new(plant.params);
        let lean = SecondOrder::new(options.lean_bandwidth * tracking.planes.toppling_rate(), options.lean_damping);
        let yaw = SecondOrder::new(options.yaw_bandwidth, options.yaw_damping);
        let poles = [options.position_bandwidth, options.position_damping];
        let largest = [options.max_lean, options.max_speed];
        Ok(Self { attitude: AttitudeLoop::new(plant, tracking, [lean, yaw], poles, largest)?, lean, yaw })
    }
}

impl Law for PdInverseDynamics {
    const PARTS: &'static [&'static str] = MOTION_PARTS;

    #[inline(always)]
    fn torques<L: Lane>(&self, sample: &mut Sample<'_, L>) -> Wheels<L> {
        let error = self.attitude.error(sample);
        let (v, rate) = (error.error, error.rate);
        let desired = Vec3::new(
            self.lean.returning(v.x, rate.x),
            self.lean.returning(v.y, rate.y),
            self.yaw.returning(v.z, rate.z),
        );
        sample.limited(self.attitude.torques(&error, desired)).torques
    }
}
