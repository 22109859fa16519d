//! Constants of the solver, computed from parameters and time step: shared by all lanes, or one set per lane.

use super::principal::PrincipalAxes;
use ballbot_base::collision_shape::{BodyShape, wheel_centers};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lanes::{Cell, EIGHT, Eight, Lane, LaneValue, Own, Quat, Registers, Value, Vec3, Wide, lane_struct};
use ballbot_base::params::Params;
use ballbot_base::payload::Payload;
use ballbot_base::state::wxyz;
use ballbot_base::wheels::Wheels;
use nalgebra::Vector3;
use std::borrow::Cow;

/// Recovery rate of an overlap (Baumgarte), 1/s. Chosen by experiment.
const RECOVERY_RATE: f64 = 100.0;
/// Largest fraction of an overlap that is removed in one step. Chosen by experiment.
const LARGEST_RECOVERY: f64 = 0.2;

lane_struct! {
    /// Constants in SI units; vectors in the principal frame of the body, from its CoM.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct Constants<T> {
        pub sim_dt: T,
        pub sim_dt_inverse: T,
        pub half_dt: T,
        /// Decrease of a velocity by gravity in a step. Zeros are positive: subtracting them keeps all bits.
        pub gravity_dt: [T; 3],
        pub ball_radius: T,
        pub ball_mass_inverse: T,
        /// Factor of viscous friction on the ball's horizontal velocity in a step.
        pub ball_drag: T,
        pub body_mass_inverse: T,
        /// Principal moments of inertia of the body.
        pub body_inertia: [T; 3],
        pub body_inertia_inverse: [T; 3],
        /// 1 if the principal axes of the body are not its body axes or its CoM is off the mast, else 0.
        pub general: T,
        /// Rotation from the principal frame to the body frame, `[w, x, y, z]`.
        pub principal_axes: [T; 4],
        /// The CoM from the origin of the body frame.
        pub com: [T; 3],
        /// Direction of the mast.
        pub mast: [T; 3],
        pub wheel_radius: T,
        /// Distance of the centers of a wheel and the ball in contact.
        pub contact_distance: T,
        /// 1 / M_b + 1 / M_k.
        pub relative_mass_inverse: T,
        /// Change of the tangential velocity of the ball on the floor per impulse, 1 / M_k + r_k² / J_k.
        pub floor_compliance: T,
        pub floor_compliance_inverse: T,
        pub ball_mass: T,
        pub drive_compliance: T,
        pub wheel_inertia: T,
        pub wheel_inertia_inverse: T,
        /// Change of a wheel's spin in a step per torque.
        pub wheel_dt_inverse_inertia: T,
        /// r_w / J_w.
        pub wheel_rim_ratio: T,
        /// Centers of the wheels.
        pub wheel_centers: Wheels<[T; 3]>,
        /// Vectors a_i; the axle of wheel i is −a_i.
        pub u: Wheels<[T; 3]>,
        pub wheel_static_friction: T,
        pub wheel_dynamic_friction: T,
        pub floor_static_friction: T,
        pub floor_dynamic_friction: T,
        /// 1 / (critical velocity of the Stribeck law)².
        pub critical_velocity_inverse_squared: T,
        /// Largest angular impulse of dry friction of a wheel joint in a step.
        pub joint_dry_impulse: T,
        /// Angular impulse of viscous friction of a wheel joint in a step per rad/s.
        pub joint_viscous_impulse: T,
        /// Recovery rate of an overlap, 1/s.
        pub recovery: T,
        /// Radius of the body cylinder.
        pub body_radius: T,
        /// Centers of the lower and the upper end of the body cylinder.
        pub body_ends: [[T; 3]; 2],
        /// Height of the lower end of the body cylinder along the mast, from the CoM.
        pub body_bottom: T,
        /// Height of the upper end of the body cylinder along the mast, from the CoM.
        pub body_top: T,
        /// Radius of a sphere about the CoM that contains the bot.
        pub reach: T,
        /// Upper bound of the speed of any point of the bot per angular impulse.
        pub reach_inverse_inertia: T,
        /// r_k² / J_k.
        pub ball_surface_compliance: T,
        /// r_k / J_k.
        pub ball_rim_ratio: T,
        /// r_w² / J_w.
        pub wheel_surface_compliance: T,
        /// Load of each wheel in equilibrium.
        pub wheel_loads: Wheels<T>,
        /// The largest wheel load.
        pub static_wheel_load: T,
        /// Load of the floor at rest.
        pub static_floor_load: T,
        /// Load of the floor below a ball at rest without the bot.
        pub static_ball_load: T,
        /// Largest fraction of a speed that its loss removes in a step; 0 for a robot without losses.
        pub loss_share: T,
        /// c_r / J_k: change of the ball's rolling rate per impulse of the floor.
        pub rolling_loss: T,
        /// c_s / J_k: change of the ball's spinning rate per impulse of the floor.
        pub spinning_loss: T,
        pub roller_friction: T,
        pub roller_friction_slope: T,
        /// 1 for a robot with losses, with a ripple or with inclined rollers, else 0.
        pub has_losses_or_rollers: T,
        /// 1 for a robot with a preload of the wheels, else 0.
        pub has_preload: T,
        /// Impulse of the preload on the ball in a step, along the mast.
        pub preload_impulse: T,
        /// Half the ripple of the wheels' rims.
        pub ripple_amplitude: T,
        /// Ripples per turn of a wheel.
        pub roller_count: T,
        pub roller_phases: Wheels<T>,
        /// 1 for a robot whose rollers are inclined, else 0.
        pub inclined: T,
        /// Cosine and sine of the rollers' angle.
        pub roller_axis: [T; 2],
        pub payloads: [Payload<T>; 2],
    }
}

impl Constants<f64> {
    /// Constants of valid `params` and a time step `sim_dt`.
    pub fn new(params: &Params, sim_dt: f64) -> Self {
        Self::in_axes(params, sim_dt, &PrincipalAxes::new(&params.without_payloads()))
    }

    /// [`Constants::new`] with given principal axes.
    pub fn in_axes(params: &Params, sim_dt: f64, principal: &PrincipalAxes) -> Self {
        let wheels = Omniwheels::new(params);
        let shape = BodyShape::new(params);
        let alone = params.without_payloads();
        let com = alone.body_com();
        let of_body = |vector: Vector3<f64>| <[f64; 3]>::from(principal.of_body(&vector));
        let centers = wheel_centers(params, &wheels).map(|center| center - com);
        let row = |i: usize| of_body(wheels.axles.row(i).transpose());
        let inclined = params.has_inclined_rollers();
        let (bottom, top) = (shape.bottom - com.z, shape.top - com.z);
        let off_mast = com.xy().norm();
        let distance = |center: &Vector3<f64>| center.iter().map(|x| x * x).sum::<f64>().sqrt();
        let wheel_reach = centers.iter().map(distance).fold(0.0, f64::max) + params.wheel_radius;
        let reach = (shape.radius + off_mast).hypot(bottom.abs().max(top.abs())).max(wheel_reach);
        let body_inertia_inverse = principal.moments.map(f64::recip);
        let critical_velocity_inverse = params.friction_critical_velocity.recip();
        let ball_mass_inverse = params.ball_mass.recip();
        let ball_surface_compliance = params.ball_radius * params.ball_radius / params.ball_inertia;
        let body_mass_inverse = alone.body_mass.recip();
        let floor_compliance = ball_mass_inverse + ball_surface_compliance;
        let wheel_loads = params.equilibrium_wheel_loads();
        Self {
            sim_dt,
            sim_dt_inverse: sim_dt.recip(),
            half_dt: 0.5 * sim_dt,
            gravity_dt: (params.up() * (params.gravity * sim_dt)).into(),
            ball_radius: params.ball_radius,
            ball_mass_inverse,
            ball_drag: 1.0 - sim_dt * params.ball_viscous_friction * ball_mass_inverse,
            body_mass_inverse,
            body_inertia: principal.moments,
            body_inertia_inverse,
            general: if principal.turned() || off_mast > 0.0 { 1.0 } else { 0.0 },
            principal_axes: wxyz(&principal.rotation()),
            com: of_body(com),
            mast: of_body(Vector3::z()),
            wheel_radius: params.wheel_radius,
            contact_distance: params.ball_radius + params.wheel_radius,
            relative_mass_inverse: body_mass_inverse + ball_mass_inverse,
            floor_compliance,
            floor_compliance_inverse: floor_compliance.recip(),
            ball_mass: ball_mass_inverse.recip(),
            drive_compliance: body_mass_inverse + ball_mass_inverse + ball_surface_compliance,
            wheel_inertia: params.wheel_inertia,
            wheel_inertia_inverse: params.wheel_inertia.recip(),
            wheel_dt_inverse_inertia: sim_dt / params.wheel_inertia,
            wheel_rim_ratio: params.wheel_radius / params.wheel_inertia,
            wheel_centers: centers.map(of_body),
            u: Wheels::from_fn(row),
            wheel_static_friction: params.wheel_static_friction,
            wheel_dynamic_friction: params.wheel_dynamic_friction,
            floor_static_friction: params.floor_static_friction,
            floor_dynamic_friction: params.floor_dynamic_friction,
            critical_velocity_inverse_squared: critical_velocity_inverse * critical_velocity_inverse,
            joint_dry_impulse: params.wheel_coulomb_friction * sim_dt,
            joint_viscous_impulse: params.wheel_viscous_friction * sim_dt,
            recovery: (LARGEST_RECOVERY / sim_dt).min(RECOVERY_RATE),
            body_radius: shape.radius,
            body_ends: [bottom, top].map(|end| of_body(Vector3::new(0.0 - com.x, 0.0 - com.y, end))),
            body_bottom: bottom,
            body_top: top,
            reach,
            reach_inverse_inertia: body_inertia_inverse.iter().copied().fold(0.0, f64::max) * reach,
            ball_surface_compliance,
            ball_rim_ratio: ball_surface_compliance / params.ball_radius,
            wheel_surface_compliance: params.wheel_radius * params.wheel_radius / params.wheel_inertia,
            wheel_loads,
            static_wheel_load: wheel_loads.into_iter().fold(0.0, f64::max),
            static_floor_load: (params.body_mass + params.ball_mass) * (params.gravity * params.up().z),
            static_ball_load: params.ball_mass * (params.gravity * params.up().z),
            loss_share: params.loss_share(),
            rolling_loss: params.floor_rolling_friction / params.ball_inertia,
            spinning_loss: params.floor_spinning_friction / params.ball_inertia,
            roller_friction: params.roller_friction,
            roller_friction_slope: params.roller_friction_slope,
            has_losses_or_rollers: if params.has_losses() || params.has_ripple() || inclined { 1.0 } else { 0.0 },
            has_preload: if params.has_preload() { 1.0 } else { 0.0 },
            preload_impulse: params.wheel_preload * sim_dt,
            ripple_amplitude: 0.5 * params.roller_ripple,
            roller_count: params.roller_count,
            roller_phases: Wheels(params.roller_phases),
            inclined: if inclined { 1.0 } else { 0.0 },
            roller_axis: [params.roller_angle.cos(), params.roller_angle.sin()],
            payloads: Payload::of(params),
        }
    }

    /// Whether the wheels have a ripple, or their rollers are inclined.
    pub fn has_rollers(&self) -> bool {
        self.ripple_amplitude > 0.0 || self.inclined > 0.0
    }
}

impl<V> Constants<V> {
    /// The constants in memory, one set per robot.
    #[inline(always)]
    pub fn stored<L: Lane>(&self, like: L) -> Constants<L::Cell>
    where
        V: Value<L>,
    {
        self.map(
            #[inline(always)]
            |value| {
                let mut cell = L::Cell::default();
                value.at(like).store(&mut cell);
                cell
            },
        )
    }
}

impl<T: Cell> Constants<T> {
    /// The constants of the robots in lanes.
    #[inline(always)]
    pub fn owned<L: Lane<Cell = T>>(&self, token: L::Token) -> Constants<Own<L>> {
        self.map(
            #[inline(always)]
            |cell| Own(L::load(token, cell)),
        )
    }
}

impl<V: Copy> Constants<V> {
    /// a_i as a vector in the lanes of `like`.
    #[inline(always)]
    pub fn u<L: Lane>(&self, i: usize, like: L) -> Vec3<L>
    where
        V: Value<L>,
    {
        at3(self.u[i], like).into()
    }

    /// Center of wheel `i` from the CoM, in the lanes of `like`.
    #[inline(always)]
    pub fn wheel_center<L: Lane>(&self, i: usize, like: L) -> Vec3<L>
    where
        V: Value<L>,
    {
        at3(self.wheel_centers[i], like).into()
    }

    /// The CoM from the origin of the body frame, in the lanes of `like`.
    #[inline(always)]
    pub fn com<L: Lane>(&self, like: L) -> Vec3<L>
    where
        V: Value<L>,
    {
        at3(self.com, like).into()
    }

    /// Rotation from the principal frame to the body frame, in the lanes of `like`.
    #[inline(always)]
    pub fn principal_axes<L: Lane>(&self, like: L) -> Quat<L>
    where
        V: Value<L>,
    {
        let [w, x, y, z] = self.principal_axes;
        Quat { w: w.at(like), v: at3([x, y, z], like).into() }
    }
}

/// Storage of the constants of eight robots: shared (`f64`) or one set per robot ([`Eight`]).
pub trait InLanes: LaneValue {
    /// Runs `f` with the constants in the lanes of a vector register.
    fn with<S: Registers, R>(constants: &Constants<Self>, simd: S, f: impl FnOnce(&Constants<Self::Wide<S>>) -> R)
    -> R;
}

impl InLanes for f64 {
    #[inline(always)]
    fn with<S: Registers, R>(constants: &Constants<f64>, _: S, f: impl FnOnce(&Constants<f64>) -> R) -> R {
        f(constants)
    }
}

impl InLanes for Eight {
    #[inline(always)]
    fn with<S: Registers, R>(constants: &Constants<Eight>, simd: S, f: impl FnOnce(&Constants<Wide<S>>) -> R) -> R {
        f(&constants.map(
            #[inline(always)]
            |value| value.wide(simd),
        ))
    }
}

/// Three constants in the lanes of `like`.
#[inline(always)]
pub fn at3<L: Lane, V: Value<L>>([a, b, c]: [V; 3], like: L) -> [L; 3] {
    [a.at(like), b.at(like), c.at(like)]
}

/// The constants of eight robots.
#[derive(Clone, Debug)]
pub enum LaneConstants {
    /// One set for all.
    Shared(Box<Constants<f64>>),
    /// One set per lane.
    PerLane(Box<Constants<Eight>>),
}

impl LaneConstants {
    /// The same constants in every lane. Robots with a ripple or with inclined rollers have one set per lane, so that the
    /// step of shared constants is compiled without.
    pub fn of_all(constants: Constants<f64>) -> Self {
        if constants.has_rollers() { Self::PerLane(each(&constants)) } else { Self::Shared(Box::new(constants)) }
    }

    /// The constants of one robot.
    pub fn lane(&self, index: usize) -> Cow<'_, Constants<f64>> {
        match self {
            Self::Shared(constants) => Cow::Borrowed(constants),
            Self::PerLane(constants) => Cow::Owned(constants.lane(index)),
        }
    }

    /// Replaces the constants of one robot; lanes whose constants are all equal share them again.
    pub fn set_lane(&mut self, index: usize, one: &Constants<f64>) {
        if let Self::Shared(all) = self {
            if **all == *one {
                return;
            }
            *self = Self::PerLane(each(all));
        }
        if let Self::PerLane(each) = self {
            each.set_lane(index, one);
            if !one.has_rollers() && (0..EIGHT).all(|i| each.lane(i) == *one) {
                *self = Self::of_all(one.clone());
            }
        }
    }
}

fn each(all: &Constants<f64>) -> Box<Constants<Eight>> {
    Box::new(all.map(|number| Eight([*number; EIGHT])))
}
