//! The last stage of every controller: torques that the wheels can transmit.

use super::balance_frame::{BalanceFrame, Pose};
use super::barrier::Barrier;
use super::lean_planes::LeanPlanes;
use crate::{Constants, check_max_torque, default_max_torque};
use ballbot_base::error::{Result, check};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::Lane;
use ballbot_base::params::Params;
use ballbot_base::wheels::{WHEELS, Wheels};
use ballbot_models::{LoadMap, WheelLoad};
use nalgebra::Vector3;

/// Least load that a wheel keeps, as a fraction of its load in equilibrium: below it the body is about to lift off the
/// ball.
pub const LEAST_LOAD: f64 = 0.3;

/// Default fraction of the friction limit: the rest is a margin for effects that the maps neglect.
pub const DEFAULT_TRACTION: f64 = 0.9;

/// Slip speed of a wheel above which the maps do not hold, m/s.
const SLIPPING: f64 = 0.1;

/// Time constant with which a slipping wheel without friction would return to the speed of the ball, s. At its full torque
/// a wheel whose load has dropped keeps slipping, until the robot falls; less time holds less drive where rims are rough.
const GRIP_TIME: f64 = 0.06;

/// Least distance of a row from its bound, N. It keeps quotients finite; a row beyond its bound does not allow torques
/// that raise it.
const LEAST_MARGIN: f64 = 1e-9;

/// Most projections of torques onto all conditions.
const PROJECTIONS: usize = 20;

/// Limits of a controller's torques.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitOptions {
    /// Largest torque of a wheel, N·m. `None` is the motors' limit with traction scaling, and [`default_max_torque`]
    /// without it.
    pub max_torque: Option<f64>,
    /// Fraction of the friction limit that the wheels may use, from 0.01 to 1; `None` for no traction scaling.
    pub traction: Option<f64>,
    /// Largest speed of the ball over the floor, m/s, from 0.01; `None` for no barrier. `docs/safety.md` has what is
    /// guaranteed.
    pub speed_limit: Option<f64>,
    /// Least and largest x, then y, of the ball's center in the inertial frame, m; `None` for no barrier.
    pub boundary: Option<[f64; 4]>,
}

impl LimitOptions {
    /// Traction scaling at 0.9 of the friction limit.
    pub const TRACTION: Self = Self { traction: Some(DEFAULT_TRACTION), ..Self::CAP };

    /// Only a largest torque.
    pub const CAP: Self = Self { max_torque: None, traction: None, speed_limit: None, boundary: None };

    /// Only a largest torque (N·m).
    pub const fn capped(max_torque: f64) -> Self {
        Self { max_torque: Some(max_torque), ..Self::CAP }
    }
}

/// Torques within the limits.
#[derive(Clone, Copy, Debug)]
pub struct Limited<L> {
    /// Wheel torques, N·m.
    pub torques: Wheels<L>,
    /// Fraction of the desired tilt torque in them, from 0 to 1, and 0 where a barrier changes it; a controller with an
    /// integral holds it below 1.
    pub share: L,
    /// Fraction of the desired yaw torque in them, from 0 to 1.
    pub yaw_share: L,
}

/// Limits of the wheel torques of one robot.
///
/// Without traction scaling the torques are scaled down together to the largest torque. Traction scaling applies the
/// largest fraction of the desired torques for which no wheel slips (|f_i| ≤ ρ μ N_i) or lifts (N_i ≥ 0.3 of the load
/// in equilibrium) and no motor exceeds its torque; loads and tractions are from [`LoadMap`]. The floor is assumed to
/// grip. The yaw torque is reduced first, because it does not balance the robot. The maps hold while all wheels grip:
/// if a wheel slips by more than 0.1 m/s, as after a push that lifts it, the torques are scaled down together to
/// [`default_max_torque`], and a torque that drives a wheel into slip is reduced further. Derived in
/// `docs/controllers.md`.
#[derive(Clone, Debug)]
pub struct TorqueLimits {
    max_torque: f64,
    traction: Option<Traction>,
    barrier: Option<Box<Guarded>>,
}

/// A barrier, and the frame in which it measures the tilt.
#[derive(Clone, Debug)]
struct Guarded {
    barrier: Barrier,
    frame: BalanceFrame,
}

/// Conditions on the torques of one robot, c + g·τ ≤ 0 each.
#[derive(Clone, Debug)]
struct Traction {
    rows: [Row; ROWS],
    /// Load of each wheel in equilibrium, N.
    loads: Wheels<f64>,
    frame: BalanceFrame,
    /// The yaw torque of wheel torques τ is `turning` (`yaw` · τ).
    yaw: Wheels<f64>,
    turning: Wheels<f64>,
    /// Rows u_i r_k: displacement of a wheel's contact as the ball turns relative to the body.
    surface: Wheels<[f64; 3]>,
    wheel_radius: f64,
    /// Largest torque while a wheel slips, N·m.
    slipping_torque: f64,
    /// Reduction of a torque that drives a wheel into slip, per slip speed, N·s.
    grip: f64,
}

/// Two rows for slip and one row for the load of each wheel.
pub(crate) const ROWS: usize = 9;

/// c = `at_rest` + `per_tilt` · ϑ + `per_rate_squared` |Ω|², g = `per_torque`.
type Row = WheelLoad;

/// A condition on leans and their accelerations by the motors in the vertical planes, c + l·θ + g·u <= 0, as a fraction
/// of a wheel's load in equilibrium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeanRow {
    pub(crate) at_rest: f64,
    pub(crate) per_rate_squared: f64,
    pub(crate) per_lean: [f64; 2],
    pub(crate) per_acceleration: [f64; 2],
}

impl LeanRow {
    /// A condition that always holds.
    const NONE: Self = Self { at_rest: -1.0, per_rate_squared: 0.0, per_lean: [0.0; 2], per_acceleration: [0.0; 2] };

    /// `constant` + l·θ + g·u.
    #[inline(always)]
    pub(crate) fn value<L: Lane>(&self, constant: L, lean: [L; 2], u: [L; 2]) -> L {
        let leaning = lean[1].mul_add_all(self.per_lean[1], lean[0].mul_add_all(self.per_lean[0], constant));
        u[1].mul_add_all(self.per_acceleration[1], u[0].mul_add_all(self.per_acceleration[0], leaning))
    }
}

impl Traction {
    fn new(params: &Params, control_dt: f64, share: f64) -> Self {
        let map = LoadMap::new(params);
        let friction = share * params.wheel_dynamic_friction;
        let rows = std::array::from_fn(|k| {
            let (load, traction) = (&map.loads[k / 3], &map.tractions[k / 3]);
            let sum = |sign: f64, factor: f64| Row {
                at_rest: sign * traction.at_rest + factor * load.at_rest,
                per_tilt: std::array::from_fn(|i| sign * traction.per_tilt[i] + factor * load.per_tilt[i]),
                per_torque: Wheels::from_fn(|i| sign * traction.per_torque[i] + factor * load.per_torque[i]),
                per_rate_squared: sign * traction.per_rate_squared + factor * load.per_rate_squared,
            };
            match k % 3 {
                0 => sum(1.0, -friction),
                1 => sum(-1.0, -friction),
                _ => {
                    let row = sum(0.0, -1.0);
                    Row { at_rest: row.at_rest + LEAST_LOAD * load.at_rest, ..row }
                }
            }
        });
        let wheels = Omniwheels::new(params);
        let frame = BalanceFrame::new(params);
        let vertical = frame.in_body(&Vector3::z());
        let inverse = wheels.u.transpose().try_inverse().expect("the wheels drive the ball about every axis");
        let surface = params.ball_radius * params.roller_angle.cos();
        Self {
            rows,
            loads: map.loads.map(|load| load.at_rest),
            frame,
            yaw: Wheels::of_column(wheels.u * vertical),
            turning: Wheels::of_column(inverse * vertical),
            surface: Wheels::from_fn(|i| std::array::from_fn(|j| wheels.u[(i, j)] * surface)),
            wheel_radius: wheels.traction_radius,
            slipping_torque: default_max_torque(params),
            grip: params.wheel_inertia / (wheels.traction_radius * control_dt.max(GRIP_TIME)),
        }
    }

    /// Adds the rows (at rest, per tilt x, y, per torque of each wheel, per squared rate) and the remaining numbers.
    fn add_to(&self, constants: Constants) -> Constants {
        let rows = self.rows.map(|row| {
            let ([x, y], Wheels([a, b, c])) = (row.per_tilt, row.per_torque);
            [row.at_rest, x, y, a, b, c, row.per_rate_squared]
        });
        constants
            .matrix("traction_rows", &rows)
            .number("least_margin", LEAST_MARGIN)
            .vector("yaw_of_torques", self.yaw.as_slice())
            .vector("torques_of_yaw", self.turning.as_slice())
            .matrix("surface", &self.surface.0)
            .number("wheel_radius", self.wheel_radius)
            .number("slipping", SLIPPING)
            .number("slipping_torque", self.slipping_torque)
            .number("grip", self.grip)
    }

    /// Speed of the ball's surface relative to each wheel's, m/s; 0 without slip.
    #[inline(always)]
    fn slip<L: Lane>(&self, state: &LaneState<L>) -> Wheels<L> {
        let turned = state.body_quaternion.rotation().apply_transposed(state.ball_angular_velocity);
        let relative = turned - state.body_angular_velocity;
        let relative = [relative.x, relative.y, relative.z];
        let mut slip = state.wheel_speeds;
        for i in 0..WHEELS {
            slip[i] = slip[i].mul_add_all(-self.wheel_radius, dot(&self.surface[i], relative));
        }
        slip
    }

    /// Whether a wheel slips.
    #[inline(always)]
    fn slips<L: Lane>(slip: Wheels<L>) -> L::Mask {
        slip[0].splat(SLIPPING).lt(largest(slip))
    }

    /// The torques while a wheel slips, none above `max_torque`. A torque that drives slip is reduced to zero at most: what
    /// looks like slip, as steps of encoders do, never raises a torque.
    #[inline(always)]
    fn regrip<L: Lane>(&self, desired: Wheels<L>, slip: Wheels<L>, max_torque: f64) -> Limited<L> {
        let capped = cap(desired, max_torque.min(self.slipping_torque));
        let mut torques = capped.torques;
        for i in 0..WHEELS {
            let torque = torques[i];
            let reduced = torque + within(slip[i] * self.grip, torque.abs());
            torques[i] = L::select((torque * slip[i]).lt(torque.zero()), reduced, torque);
        }
        Limited { torques, ..capped }
    }

    /// c of each row.
    #[inline(always)]
    fn constants<L: Lane>(&self, &Pose { tilt, rate, .. }: &Pose<L>) -> [L; ROWS] {
        let squared = rate.x.mul_add(rate.x, rate.y.squared());
        let mut constants = [squared; ROWS];
        for (row, c) in self.rows.iter().zip(&mut constants) {
            let tilted = tilt[0].mul_add_all(row.per_tilt[0], tilt[1] * row.per_tilt[1]);
            *c = squared.mul_add_all(row.per_rate_squared, tilted) + row.at_rest;
        }
        constants
    }

    /// The torques in two parts: the part that turns the body about the vertical, and the rest.
    #[inline(always)]
    fn parts<L: Lane>(&self, torques: Wheels<L>) -> (Wheels<L>, Wheels<L>) {
        let amount = dot(&self.yaw.0, torques.0);
        let yaw = self.turning.map(|turning| amount * turning);
        (torques - yaw, yaw)
    }
}

impl TorqueLimits {
    /// Limits of the robot of `params`, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a torque that is not positive or above the motors' limit, and for a fraction of
    /// the friction limit, a speed or a boundary out of range; [`ballbot_base::Error::Inconsistent`] for a boundary that is
    /// too narrow, and for samples that are too long for a barrier.
    pub fn new(params: &Params, control_dt: f64, options: &LimitOptions) -> Result<Self> {
        if let Some(share) = options.traction {
            check("traction", share, "from 0.01 to 1", |share| (0.01..=1.0).contains(&share))?;
        }
        let motors = params.max_wheel_torque;
        let max_torque = match (options.max_torque, options.traction) {
            (Some(torque), _) => check_max_torque(torque, motors)?,
            (None, Some(_)) => motors,
            (None, None) => default_max_torque(params),
        };
        let barrier = Barrier::new(params, control_dt, options.speed_limit, options.boundary)?;
        Ok(Self {
            max_torque,
            traction: options.traction.map(|share| Traction::new(params, control_dt, share)),
            barrier: barrier.map(|barrier| Box::new(Guarded { barrier, frame: BalanceFrame::new(params) })),
        })
    }

    /// Largest torque of a wheel, N·m.
    pub fn max_torque(&self) -> f64 {
        self.max_torque
    }

    /// Adds the largest torque and the numbers of traction scaling and of a barrier, where there are any.
    pub(crate) fn add_to(&self, constants: Constants) -> Constants {
        let constants = constants.number("max_torque", self.max_torque);
        let constants = self.traction.iter().fold(constants, |constants, traction| traction.add_to(constants));
        self.barrier.iter().fold(constants, |constants, guarded| guarded.barrier.add_to(constants))
    }

    /// Traction conditions without yaw torque, which is reduced first.
    pub(crate) fn lean_rows(&self, planes: &LeanPlanes) -> [LeanRow; ROWS] {
        let Some(traction) = &self.traction else { return [LeanRow::NONE; ROWS] };
        let driven = [0, 1].map(|axis| planes.driven(axis));
        std::array::from_fn(|k| {
            let row = &traction.rows[k];
            let [tilt_x, tilt_y] = row.per_tilt;
            let share = traction.loads[k / 3].recip();
            LeanRow {
                at_rest: share * row.at_rest,
                per_rate_squared: share * row.per_rate_squared,
                // Leaning towards y turns about −x.
                per_lean: [share * tilt_y, -share * tilt_x],
                per_acceleration: driven.map(|torques| share * dot(&row.per_torque.0, torques.0)),
            }
        })
    }

    /// The applied torques for the desired torques, none above `largest` (N·m). Desired torques within the limits are
    /// unchanged to the last bit; NaN passes through.
    #[inline(always)]
    pub fn apply<L: Lane>(&self, desired: Wheels<L>, state: &LaneState<L>, largest_torque: f64) -> Limited<L> {
        match (&self.traction, &self.barrier) {
            (Some(Traction { frame, .. }), _) => self.apply_at(desired, state, &frame.pose(state), largest_torque),
            (None, Some(guarded)) => self.apply_at(desired, state, &guarded.frame.pose(state), largest_torque),
            (None, None) => cap(desired, self.max_torque.min(largest_torque)),
        }
    }

    /// Torques near `desired` within the limits: projected onto the conditions one after the other, then moved toward
    /// `within`, which are within the limits, until all hold. While a wheel slips they are as by [`TorqueLimits::apply`].
    #[inline(always)]
    pub fn nearest(
        &self,
        within: Wheels<f64>,
        desired: Wheels<f64>,
        state: &LaneState<f64>,
        largest_torque: f64,
    ) -> Wheels<f64> {
        let bound = self.max_torque.min(largest_torque);
        let desired = match &self.barrier {
            Some(guarded) => guarded.barrier.filter(desired, state, &guarded.frame.pose(state)).0,
            None => desired,
        };
        let capped = |torques: Wheels<f64>| torques.map(|torque| torque.clamp(-bound, bound));
        let mut nearest = capped(desired);
        let Some(traction) = &self.traction else { return nearest };
        let slip = traction.slip(state);
        if Traction::slips(slip) {
            return traction.regrip(desired, slip, bound).torques;
        }
        let constants = traction.constants(&traction.frame.pose(state));
        for _ in 0..PROJECTIONS {
            let mut fits = true;
            for (row, c) in traction.rows.iter().zip(constants) {
                let gradient = row.per_torque;
                let beyond = c + dot(&gradient.0, nearest.0);
                if beyond > 0.0 {
                    nearest = nearest - gradient * (beyond / dot(&gradient.0, gradient.0));
                    fits = false;
                }
            }
            nearest = capped(nearest);
            if fits {
                return nearest;
            }
        }
        let change = nearest - within;
        let mut share = 1.0_f64;
        for (row, c) in traction.rows.iter().zip(constants) {
            let slope = dot(&row.per_torque.0, change.0);
            if slope > 0.0 {
                share = share.min((-c - dot(&row.per_torque.0, within.0)).max(0.0) / slope);
            }
        }
        within + change * share
    }

    /// [`TorqueLimits::apply`] for a robot with known pose.
    #[inline(always)]
    pub(crate) fn apply_at<L: Lane>(
        &self,
        desired: Wheels<L>,
        state: &LaneState<L>,
        pose: &Pose<L>,
        largest_torque: f64,
    ) -> Limited<L> {
        let Some(guarded) = &self.barrier else { return self.transmitted(desired, state, pose, largest_torque) };
        let (torques, changed) = guarded.barrier.filter(desired, state, pose);
        let limited = self.transmitted(torques, state, pose, largest_torque);
        Limited { share: L::select(changed, limited.share.zero(), limited.share), ..limited }
    }

    /// The torques that the wheels can transmit.
    #[inline(always)]
    fn transmitted<L: Lane>(
        &self,
        desired: Wheels<L>,
        state: &LaneState<L>,
        pose: &Pose<L>,
        largest_torque: f64,
    ) -> Limited<L> {
        let max_torque = self.max_torque.min(largest_torque);
        let Some(traction) = &self.traction else { return cap(desired, max_torque) };
        let constants = traction.constants(pose);
        let bound = desired[0].splat(max_torque);
        let mut fits = largest(desired).le(bound);
        for (row, c) in traction.rows.iter().zip(constants) {
            fits = fits & (dot(&row.per_torque.0, desired.0) + c).le(c.zero());
        }
        let slip = traction.slip(state);
        let slips = Traction::slips(slip);
        let limited = slips | !fits;
        let one = bound.splat(1.0);
        if !L::any(limited) {
            return Limited { torques: desired, share: one, yaw_share: one };
        }
        let gripping = traction.regrip(desired, slip, max_torque);
        let (tilting, yaw) = traction.parts(desired);
        let share = one / excess(traction, &constants, Wheels::zero(bound), tilting, max_torque);
        let base = tilting * share;
        let mut left = constants;
        for (row, c) in traction.rows.iter().zip(&mut left) {
            *c += dot(&row.per_torque.0, base.0);
        }
        let yaw_share = one / excess(traction, &left, base, yaw, max_torque);
        let mut torques = desired;
        for i in 0..WHEELS {
            let scaled = within(yaw[i].mul_add(yaw_share, base[i]), bound);
            let scaled = L::select(slips, gripping.torques[i], scaled);
            let is_number = desired[i].le(desired[i]);
            torques[i] = L::select(limited & is_number, scaled, desired[i]);
        }
        Limited {
            torques,
            share: L::select(limited, L::select(slips, gripping.share, share), one),
            yaw_share: L::select(limited, L::select(slips, gripping.yaw_share, yaw_share), one),
        }
    }
}

/// Divisor of torques, at least 1, for which they may be added to other torques. The rows have the constants
/// `constants` at the other torques; no torque may exceed `max_torque`.
#[inline(always)]
fn excess<L: Lane>(
    traction: &Traction,
    constants: &[L; ROWS],
    others: Wheels<L>,
    torques: Wheels<L>,
    max_torque: f64,
) -> L {
    let least = others[0].splat(LEAST_MARGIN);
    let mut excess = least.splat(1.0);
    for (row, c) in traction.rows.iter().zip(constants) {
        excess = (dot(&row.per_torque.0, torques.0) / (-*c).max(least)).max(excess);
    }
    for (torque, other) in torques.into_iter().zip(others) {
        // Rate towards its bound.
        let zero = torque.zero();
        let signed = L::select(torque.lt(zero), -other, other);
        excess = (torque.abs() / (least.splat(max_torque) - signed).max(least)).max(excess);
    }
    excess
}

/// Scales torques down together to ±`limit`, keeping their direction; NaN passes through.
#[inline(always)]
fn cap<L: Lane>(torques: Wheels<L>, limit: f64) -> Limited<L> {
    let Wheels([a, b, c]) = torques;
    let largest = largest(torques);
    let bound = a.splat(limit);
    let scale = L::select(bound.lt(largest), bound / largest, a.splat(1.0));
    let torques = Wheels([within(a * scale, bound), within(b * scale, bound), within(c * scale, bound)]);
    Limited { torques, share: scale, yaw_share: scale }
}

/// Clamped to ±`bound`, which a scaled torque may exceed by rounding; NaN passes through.
#[inline(always)]
pub(crate) fn within<L: Lane>(torque: L, bound: L) -> L {
    L::select(bound.lt(torque.abs()), torque.min(bound).max(-bound), torque)
}

#[inline(always)]
fn largest<L: Lane>(Wheels([a, b, c]): Wheels<L>) -> L {
    a.abs().max(b.abs()).max(c.abs())
}

#[inline(always)]
pub(super) fn dot<L: Lane>(row: &[f64; 3], [a, b, c]: [L; 3]) -> L {
    c.mul_add_all(row[2], b.mul_add_all(row[1], a * row[0]))
}
