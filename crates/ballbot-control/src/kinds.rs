//! Controllers by name: the controllers of this crate and controllers registered by other crates.

use super::{
    AttitudeSlidingOptions, CascadePid, CascadePidOptions, Controller, FuzzyMamdani, FuzzyOptions,
    HierarchicalSlidingMode, InverseDynamicsOptions, Law, LimitOptions, Lqi, LqiOptions, Lqr, LqrOptions, LqrPi,
    LqrPiOptions, LqrWeights, Mpc, MpcOptions, PdInverseDynamics, Pid, PidGains, SETPOINT_PARTS, SlidingMode,
    SlidingModeOptions, TakagiSugeno,
};
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::{Fields, OptionDescription, describe_options};
use ballbot_base::kinematics::TorqueMap;
use ballbot_base::params::Params;
use std::sync::{PoisonError, RwLock};

/// A controller known by its name.
#[derive(Clone, Debug)]
pub struct ControllerKind {
    /// Its name, as in `lqr`.
    pub name: &'static str,
    /// Description in one sentence.
    pub summary: &'static str,
    /// The sampling time of its design, s; `None` for a controller designed for any sampling time.
    pub control_dt: Option<f64>,
    /// The parts of a setpoint that it follows.
    pub parts: &'static [&'static str],
    /// Default limits of its torques.
    pub limits: LimitOptions,
    /// Its options.
    pub options: fn() -> Vec<OptionDescription>,
    /// Constructor.
    pub make: MakeController,
}

/// Makes a controller for `params`, sampled every `control_dt` seconds, with limited torques, from options by name.
pub type MakeController = fn(
    params: &Params,
    control_dt: f64,
    limits: &LimitOptions,
    options: &[(&str, &[f64])],
) -> Result<Box<dyn Controller>>;

/// A struct of fields with some values changed, all within their limits.
///
/// # Errors
/// As [`Fields::set`] and [`Fields::check_limits`].
pub fn fields_with<F: Fields>(options: &[(&str, &[f64])]) -> Result<F> {
    let mut fields = F::default();
    options.iter().try_for_each(|(name, values)| fields.set(name, values))?;
    fields.check_limits()?;
    Ok(fields)
}

/// The controllers of this crate.
static CONTROLLERS: [ControllerKind; 11] = [
    ControllerKind {
        name: "lqr",
        summary: "Linear-quadratic regulator of position, tilt and heading.",
        control_dt: None,
        parts: <Lqr as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<LqrOptions>,
        make: |params, control_dt, limits, options| {
            let LqrOptions { weights, delay, observer } = fields_with(options)?;
            let lqr = Lqr::with_weights(params, control_dt, &weights, limits)?;
            let lqr = lqr.with_delay(params, delay.delay)?;
            Ok(Box::new(lqr.with_lean_observer(params, observer.lean_observer)?))
        },
    },
    ControllerKind {
        name: "pid",
        summary: "The paper's PID of the tilt; nothing holds the ball's position or the heading.",
        control_dt: Some(Pid::PAPER_CONTROL_DT),
        parts: <Pid as Law>::PARTS,
        limits: LimitOptions::CAP,
        options: describe_options::<PidGains>,
        make: |params, control_dt, limits, options| {
            let pid = Pid::new(params, control_dt, &fields_with(options)?, TorqueMap::Consistent)?;
            Ok(Box::new(pid.with_limits(params, limits)?))
        },
    },
    ControllerKind {
        name: "lqi",
        summary: "The regulator with an integral of the position: constant disturbances up to a limit leave no offset.",
        control_dt: None,
        parts: <Lqi as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<LqiOptions>,
        make: |params, control_dt, limits, options| {
            let LqiOptions { weights, delay } = fields_with(options)?;
            Ok(Box::new(Lqi::with_weights(params, control_dt, &weights, limits)?.with_delay(params, delay.delay)?))
        },
    },
    ControllerKind {
        name: "lqr_pi",
        summary: "Double loop: a regulator that asks for wheel rates, above a PI of the measured ones.",
        control_dt: None,
        parts: <LqrPi as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<LqrPiOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(LqrPi::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "mpc",
        summary: "Model predictive control: the regulator with limits of traction and torque looked ahead.",
        control_dt: None,
        parts: <Mpc as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<MpcOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(Mpc::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "cascade_pid",
        summary: "PD of the position above a PID of the tilt, by the poles of the closed loop.",
        control_dt: None,
        parts: <CascadePid as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<CascadePidOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(CascadePid::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "hierarchical_sliding_mode",
        summary: "Sliding mode on a sum of the surfaces of position and lean.",
        control_dt: None,
        parts: <HierarchicalSlidingMode as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<SlidingModeOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(HierarchicalSlidingMode::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "pd_inverse_dynamics",
        summary: "PD of the attitude with the robot's dynamics cancelled, below a PD of the position.",
        control_dt: None,
        parts: <PdInverseDynamics as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<InverseDynamicsOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(PdInverseDynamics::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "sliding_mode",
        summary: "Sliding mode of the attitude with the robot's dynamics cancelled, below a PD of the position.",
        control_dt: None,
        parts: <SlidingMode as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<AttitudeSlidingOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(SlidingMode::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "fuzzy_mamdani",
        summary: "Fuzzy rules on the lean's error and its rate, below a PD of the position.",
        control_dt: None,
        parts: <FuzzyMamdani as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<FuzzyOptions>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(FuzzyMamdani::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
    ControllerKind {
        name: "takagi_sugeno",
        summary: "Regulators for leans of 0, 15 and 30 deg, blended by the lean.",
        control_dt: None,
        parts: <TakagiSugeno as Law>::PARTS,
        limits: LimitOptions::TRACTION,
        options: describe_options::<LqrWeights>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(TakagiSugeno::with_weights(params, control_dt, &fields_with(options)?, limits)?))
        },
    },
];

/// The controllers of other crates.
static REGISTERED: RwLock<Vec<ControllerKind>> = RwLock::new(Vec::new());

/// Registers a controller by its name, like the controllers of this crate; [`Law`] has an example.
///
/// # Errors
/// [`Error::Inconsistent`] if its name is taken; [`Error::UnknownName`] if it follows a part that a setpoint does not
/// have.
pub fn register_controller(kind: ControllerKind) -> Result<()> {
    if controller_kinds().iter().any(|known| known.name == kind.name) {
        return Err(Error::Inconsistent(format!("there is a controller '{}' already", kind.name)));
    }
    if let Some(part) = kind.parts.iter().find(|part| !SETPOINT_PARTS.contains(part)) {
        return Err(Error::unknown("part of a setpoint", part, &SETPOINT_PARTS));
    }
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(kind);
    Ok(())
}

/// All controllers.
pub fn controller_kinds() -> Vec<ControllerKind> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    CONTROLLERS.iter().chain(registered.iter()).cloned().collect()
}

/// A controller by its name.
///
/// # Errors
/// [`Error::UnknownName`] if it does not exist.
pub fn controller_kind(name: &str) -> Result<ControllerKind> {
    let kinds = controller_kinds();
    let names: Vec<_> = kinds.iter().map(|kind| kind.name).collect();
    let found = kinds.iter().find(|kind| kind.name == name).cloned();
    found.ok_or_else(|| Error::unknown("controller", name, &names))
}
