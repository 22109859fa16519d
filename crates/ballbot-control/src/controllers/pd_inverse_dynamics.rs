//! Computed torque on the attitude: a PD of its error, with cancellation of the robot's dynamics.

use crate::parts::attitude_loop::AttitudeLoop;
use crate::parts::position_loop::{PositionOptions, SecondOrder};
use crate::parts::tracking::Tracking;
use crate::{LaneSetpoint, Law, LimitOptions, MOTION_PARTS, NamedLaw, Sampling, TorqueLimits};
use ballbot_base::error::Result;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory, Vec3};
use ballbot_base::params::Params;
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
        pub max_lean: f64 = 0.174_532_925_199_432_95, "rad", Limit::from(0.0).to(1e6);
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
    sampling: Sampling,
    limits: TorqueLimits,
}

impl NamedLaw for PdInverseDynamics {
    const NAME: &'static str = "pd_inverse_dynamics";
    const SUMMARY: &'static str = "PD of the attitude with the robot's dynamics cancelled, below a PD of the position.";
    const LABEL: &'static str = "computed torque";
    type Options = InverseDynamicsOptions;

    /// A controller for `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for an option out of range, errors of [`TorqueLimits::new`],
    /// [`ballbot_base::Error::Inconsistent`] if the sampled loop of the linear model is not stable.
    fn with_options(
        params: &Params,
        control_dt: f64,
        options: &InverseDynamicsOptions,
        limits: &LimitOptions,
    ) -> Result<Self> {
        params.validate()?;
        options.check_limits()?;
        let limits = TorqueLimits::new(params, limits)?;
        let tracking = Tracking::new(params);
        let lean = SecondOrder::new(options.lean_bandwidth * tracking.planes.toppling_rate(), options.lean_damping);
        let yaw = SecondOrder::new(options.yaw_bandwidth, options.yaw_damping);
        let position = PositionOptions {
            bandwidth: options.position_bandwidth,
            damping: options.position_damping,
            max_lean: options.max_lean,
            max_speed: options.max_speed,
        };
        Ok(Self {
            attitude: AttitudeLoop::new(params, control_dt, tracking, [lean, yaw], &position)?,
            lean,
            yaw,
            sampling: Sampling::new(control_dt, <Self as Law>::MEMORY),
            limits,
        })
    }
}

impl Law for PdInverseDynamics {
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
        let error = self.attitude.error(state, setpoint);
        let (v, rate) = (error.error, error.rate);
        let desired = Vec3::new(
            returning(v.x, rate.x, &self.lean),
            returning(v.y, rate.y, &self.lean),
            returning(v.z, rate.z, &self.yaw),
        );
        self.limits.apply(self.attitude.torques(&error, desired), state, largest).torques
    }
}

/// −δ ẋ − σ x.
#[inline(always)]
fn returning<L: Lane>(x: L, rate: L, dynamics: &SecondOrder) -> L {
    x.mul_add_all(-dynamics.stiffness, rate * -dynamics.damping)
}
