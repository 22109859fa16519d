//! Contact points of the bot with the floor or an obstacle: one per wheel, and three on the body cylinder.

use super::mast::MastFrame;
use super::plane::{Floor, Obstacle, Plane, Surface, required};
use crate::constants::{Constants, at3};
use crate::footing::Relief;
use crate::friction::in_disc;
use crate::phases::Start;
use crate::rows::allowance;
use crate::types::{Velocities, select3};
use ballbot_base::lanes::{Lane, Value, Vec3, map3};

/// Number of points.
pub const POINTS: usize = 6;

/// Cosine and sine of the angle between points of a rim.
const THIRD: [f64; 2] = [-0.5, 0.866_025_403_784_438_6];

/// Horizontal part of the mast's direction below which a rim has no lowest point.
const UPRIGHT: f64 = 1e-6;
/// Steps of the search for the point of a rim that is nearest to a floor with relief.
const REFINEMENTS: usize = 2;
/// The same for an obstacle, which may have edges.
const SIDE_REFINEMENTS: usize = 4;

/// A row of a contact point, along an axis of its plane.
#[derive(Clone, Copy)]
struct Row<L> {
    /// Factor of the body rate, principal frame, m.
    arm: Vec3<L>,
    /// Change of the body rate per impulse.
    effect: Vec3<L>,
    /// Factor of the spin of the point's wheel, m; zero for a point of the body.
    spin_share: L,
    /// Change of that spin per impulse.
    spin_effect: L,
    /// Change of the row velocity per impulse, 1/kg.
    compliance: L,
}

/// A contact point of the bot.
pub struct BotPoint<L: Lane> {
    /// Wheel of the point; `None` for a point of the body.
    wheel: Option<usize>,
    /// Normal and two tangents of the surface at the point, inertial frame.
    axes: [Vec3<L>; 3],
    /// Distance from the surface, m.
    gap: L,
    /// Least velocity of the normal row, negated, m/s.
    required: L,
    /// Whether the point may touch in this step.
    candidate: L::Mask,
    /// Rows along the axes.
    rows: [Row<L>; 3],
    /// Inverse of the change of the normal velocity per normal impulse, kg.
    normal_inverse: L,
    /// Inverse of the largest change of the tangential velocity per tangential impulse, kg.
    tangent_inverse: L,
    /// Change of the tangential velocities per normal impulse, 1/kg.
    couplings: [L; 2],
    /// Impulses along the axes, N·s.
    impulses: [L; 3],
}

impl<L: Lane> Row<L> {
    #[inline(always)]
    fn new<V: Value<L>>(c: &Constants<V>, arm: Vec3<L>, spin_share: L) -> Self {
        let like = arm.x;
        let effect = arm.scaled_by(at3(c.body_inertia_inverse, like));
        let spin_effect = spin_share * c.wheel_inertia_inverse.at(like);
        let compliance = spin_share.mul_add(spin_effect, effect.dot(arm)) + c.body_mass_inverse.at(like);
        Self { arm, effect, spin_share, spin_effect, compliance }
    }

    /// Change of the velocity of this row per impulse of an orthogonal row of the same point, 1/kg.
    #[inline(always)]
    fn coupling(&self, other: &Self) -> L {
        self.spin_share.mul_add(other.spin_effect, self.effect.dot(other.arm))
    }

    #[inline(always)]
    fn speed(&self, wheel: Option<usize>, along: L, v: &Velocities<L>) -> L {
        let speed = along + self.arm.dot(v.body_rate);
        wheel.map_or(
            speed,
            #[inline(always)]
            |i| self.spin_share.mul_add(v.spins[i], speed),
        )
    }

    #[inline(always)]
    fn push(&self, wheel: Option<usize>, impulse: L, v: &mut Velocities<L>) {
        v.body_rate = v.body_rate.plus(self.effect, impulse);
        if let Some(i) = wheel {
            v.spins[i] = self.spin_effect.mul_add(impulse, v.spins[i]);
        }
    }
}

/// Points of a robot that touch the floor in this step if they are below `limit`.
#[inline(always)]
pub fn floor_points<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    start: &Start<L>,
    limit: L,
    relief: Option<&Relief<'_, L>>,
) -> [BotPoint<L>; POINTS] {
    let floor = &Floor(relief);
    let like = start.pose.body.z;
    let frame = MastFrame::new(c, like);
    // Up axis of the floor below the CoM.
    let up = frame.vector(floor.near_bot(start, Vec3::zero(like)).turned[0]);
    let radius = c.body_radius.at(like);
    let (bottom, top) = (c.body_bottom.at(like), c.body_top.at(like));
    let inverted = up.z.lt(up.z.zero());
    let (lower, upper) = (L::select(inverted, top, bottom), L::select(inverted, bottom, top));
    let [dx, dy] = nearest_direction(start, relief, &frame, up, [radius, lower]);
    let (cos, sin) = (dx.splat(THIRD[0]), dx.splat(THIRD[1]));
    let directions = [
        [dx, dy],
        [dx.mul_add(cos, -(dy * sin)), dx.mul_add(sin, dy * cos)],
        [dx.mul_add(cos, dy * sin), dy.mul_add(cos, -(dx * sin))],
    ];
    let rims = map3(
        directions,
        #[inline(always)]
        |[x, y]| [x * radius, y * radius],
    );
    // A cylinder rests on the rim of its lower end or on the lowest points of both ends.
    let [[ax, ay], [bx, by], [cx, cy]] = rims;
    let (first, second, third) = (Vec3::new(ax, ay, lower), Vec3::new(bx, by, lower), Vec3::new(cx, cy, lower));
    let [ox, oy] = nearest_direction(start, relief, &frame, up, [radius, upper]);
    let other = Vec3::new(ox * radius, oy * radius, upper);
    let lies = up.dot(other).lt(up.dot(second));
    let arms = map3(
        [first, Vec3::select(lies, other, second), third],
        #[inline(always)]
        |point| frame.principal_point(point),
    );
    let third_limit = L::select(lies, limit.splat(f64::NEG_INFINITY), limit);
    [
        BotPoint::of_wheel(c, start, floor, limit, 0),
        BotPoint::of_wheel(c, start, floor, limit, 1),
        BotPoint::of_wheel(c, start, floor, limit, 2),
        BotPoint::of_body(c, start, floor, limit, arms[0]),
        BotPoint::of_body(c, start, floor, limit, arms[1]),
        BotPoint::of_body(c, start, floor, third_limit, arms[2]),
    ]
}

/// Direction in the body frame, a unit vector, of the point nearest to the floor on a rim with this radius and height along
/// the mast; `up` is the upward direction of the floor below the CoM.
#[inline(always)]
fn nearest_direction<L: Lane>(
    start: &Start<L>,
    relief: Option<&Relief<'_, L>>,
    frame: &MastFrame<L>,
    up: Vec3<L>,
    [radius, height]: [L; 2],
) -> [L; 2] {
    let mut direction = lowest_direction(up);
    if relief.is_some() {
        // Below the rim the floor has another slope. At a point that is not the nearest, a robot that slides gains energy.
        for _ in 0..REFINEMENTS {
            let [x, y] = direction;
            let point = frame.principal_point(Vec3::new(x * radius, y * radius, height));
            direction = lowest_direction(frame.vector(Floor(relief).near_bot(start, point).turned[0]));
        }
    }
    direction
}

/// Points of a robot that touch an obstacle in this step if they are nearer than `limit`: on the rims of both ends of the
/// body, and where its side is nearest.
#[inline(always)]
pub fn obstacle_points<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    start: &Start<L>,
    limit: L,
    obstacle: &Obstacle<'_, '_, L>,
) -> [BotPoint<L>; POINTS] {
    let frame = MastFrame::new(c, limit);
    let (bottom, top): (Vec3<L>, Vec3<L>) = (at3(c.body_ends[0], limit).into(), at3(c.body_ends[1], limit).into());
    let (from, to) = (obstacle.place(start, bottom), obstacle.place(start, top));
    let nearest = obstacle.prism.nearest_on(from, to);
    let along = to - from;
    let share = (nearest - from).dot(along) / along.norm_squared();
    let arms = map3(
        [bottom, top, bottom.plus(top - bottom, share)],
        #[inline(always)]
        |center| on_side(c, start, &frame, obstacle, center),
    );
    let restitution = obstacle.prism.restitution;
    [
        BotPoint::of_wheel(c, start, obstacle, limit, 0).bouncing(c, start, restitution),
        BotPoint::of_wheel(c, start, obstacle, limit, 1).bouncing(c, start, restitution),
        BotPoint::of_wheel(c, start, obstacle, limit, 2).bouncing(c, start, restitution),
        BotPoint::of_body(c, start, obstacle, limit, arms[0]).bouncing(c, start, restitution),
        BotPoint::of_body(c, start, obstacle, limit, arms[1]).bouncing(c, start, restitution),
        BotPoint::of_body(c, start, obstacle, limit, arms[2]).bouncing(c, start, restitution),
    ]
}

/// The point of a circle about the mast through the body's side, with this center (principal frame), that is nearest to
/// an obstacle.
#[inline(always)]
fn on_side<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    start: &Start<L>,
    frame: &MastFrame<L>,
    obstacle: &Obstacle<'_, '_, L>,
    center: Vec3<L>,
) -> Vec3<L> {
    let (radius, center) = (c.body_radius.at(center.x), frame.point(center));
    let mut point = center;
    for _ in 0..SIDE_REFINEMENTS {
        let outward = frame.vector(obstacle.near_bot(start, frame.principal_point(point)).turned[0]);
        let [x, y] = lowest_direction(outward);
        point = Vec3::new(x.mul_add(radius, center.x), y.mul_add(radius, center.y), center.z);
    }
    frame.principal_point(point)
}

/// Horizontal downward direction in the body frame, a unit vector, from the upward direction; x for a vertical mast.
#[inline(always)]
fn lowest_direction<L: Lane>(up: Vec3<L>) -> [L; 2] {
    let (zero, one) = (up.x.zero(), up.x.splat(1.0));
    let size = up.x.mul_add(up.x, up.y.squared()).sqrt();
    let upright = size.lt(size.splat(UPRIGHT));
    let inverse = one / L::select(upright, one, size);
    [L::select(upright, one, -up.x * inverse), L::select(upright, zero, -up.y * inverse)]
}

impl<L: Lane> BotPoint<L> {
    /// The point of wheel `i` nearest to a surface. About the axle the wheel rotates at its spin, not at the body rate.
    #[inline(always)]
    fn of_wheel<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        surface: &impl Surface<L>,
        limit: L,
        i: usize,
    ) -> Self {
        let (center, u) = (c.wheel_center(i, limit), c.u(i, limit));
        let radius = c.wheel_radius.at(limit);
        let plane: Plane<L> = surface.near_bot(start, center);
        let normal = plane.turned[0];
        let rows = map3(
            plane.turned,
            #[inline(always)]
            |axis| {
                let across = normal.cross(axis);
                let along = across.dot(u);
                let arm = center.cross(axis) - (across - u * along) * radius;
                Row::new(c, arm, along * radius)
            },
        );
        Self::new(c, Some(i), plane.axes, plane.height - radius, limit, rows)
    }

    /// A point fixed to the body.
    #[inline(always)]
    fn of_body<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        surface: &impl Surface<L>,
        limit: L,
        arm: Vec3<L>,
    ) -> Self {
        let plane = surface.near_bot(start, arm);
        let rows = map3(
            plane.turned,
            #[inline(always)]
            |axis| Row::new(c, arm.cross(axis), limit.zero()),
        );
        Self::new(c, None, plane.axes, plane.height, limit, rows)
    }

    #[inline(always)]
    fn new<V: Value<L>>(
        c: &Constants<V>,
        wheel: Option<usize>,
        axes: [Vec3<L>; 3],
        gap: L,
        limit: L,
        rows: [Row<L>; 3],
    ) -> Self {
        let one = gap.splat(1.0);
        let [normal, x, y] = &rows;
        // The larger eigenvalue of the tangential matrix. One value for both axes keeps friction opposite to the slip.
        let half = (x.compliance - y.compliance) * 0.5;
        let coupling = x.coupling(y);
        let largest = (x.compliance + y.compliance) * 0.5 + half.mul_add(half, coupling.squared()).sqrt();
        Self {
            wheel,
            axes,
            gap,
            required: allowance(c, gap),
            candidate: gap.lt(limit),
            normal_inverse: one / normal.compliance,
            tangent_inverse: one / largest,
            couplings: [normal.coupling(x), normal.coupling(y)],
            rows,
            impulses: [gap.zero(); 3],
        }
    }

    /// The point with an impact on an obstacle that bounces.
    #[inline(always)]
    fn bouncing<V: Value<L>>(mut self, c: &Constants<V>, start: &Start<L>, restitution: L) -> Self {
        let v = &start.velocities;
        let speed = self.rows[0].speed(self.wheel, self.axes[0].dot(v.body), v);
        self.required = required(c, self.gap, speed, restitution);
        self
    }

    /// Whether any of the robots in `mask` may touch the surface with this point.
    #[inline(always)]
    pub fn may_touch(&self, mask: L::Mask) -> bool {
        L::any(self.candidate & mask)
    }

    /// Robots whose point reaches the surface at these velocities.
    #[inline(always)]
    pub fn closes(&self, v: &Velocities<L>) -> L::Mask {
        let speed = self.rows[0].speed(self.wheel, self.axes[0].dot(v.body), v);
        self.candidate & (speed + self.required).lt(speed.zero())
    }

    /// One Gauss-Seidel sweep over the rows of this point. Returns the sum of the squared changes of its impulses.
    #[inline(always)]
    fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, friction: L, v: &mut Velocities<L>) -> L {
        let zero = friction.zero();
        let [normal, x, y] = &self.rows;
        let [n, tx, ty] = self.impulses;
        // All speeds at once; the coupling gives the effect of the normal impulse on the tangential speeds.
        let [up, across, along] = self.axes;
        let sn = normal.speed(self.wheel, up.dot(v.body), v);
        let sx = x.speed(self.wheel, across.dot(v.body), v);
        let sy = y.speed(self.wheel, along.dot(v.body), v);
        let pressed = (sn + self.required).neg_mul_add(self.normal_inverse, n).max(zero);
        let pressed = L::select(self.candidate, pressed, zero);
        let dn = pressed - n;
        let stick = [
            self.couplings[0].mul_add(dn, sx).neg_mul_add(self.tangent_inverse, tx),
            self.couplings[1].mul_add(dn, sy).neg_mul_add(self.tangent_inverse, ty),
        ];
        let held = in_disc(stick, friction * pressed);
        let change = Vec3::new(dn, held[0] - tx, held[1] - ty);
        self.push(c, [change.x, change.y, change.z], v);
        self.impulses = [pressed, held[0], held[1]];
        change.norm_squared()
    }

    /// [`BotPoint::sweep`], after which robots outside of `open` have their impulses from before.
    #[inline(always)]
    pub fn sweep_open<V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        friction: L,
        open: L::Mask,
        v: &mut Velocities<L>,
    ) -> L {
        let before = self.impulses;
        let change = self.sweep(c, friction, v);
        self.impulses = select3(open, self.impulses, before);
        change
    }

    /// Impulse on the bot at this point, N·s.
    #[inline(always)]
    pub fn impulse(&self) -> Vec3<L> {
        self.along_axes(self.impulses)
    }

    #[inline(always)]
    fn along_axes(&self, [n, x, y]: [L; 3]) -> Vec3<L> {
        let [up, across, along] = self.axes;
        up * n + across * x + along * y
    }

    #[inline(always)]
    fn push<V: Value<L>>(&self, c: &Constants<V>, [n, x, y]: [L; 3], v: &mut Velocities<L>) {
        v.body = v.body.plus(self.along_axes([n, x, y]), c.body_mass_inverse.at(n));
        for (row, impulse) in self.rows.iter().zip([n, x, y]) {
            row.push(self.wheel, impulse, v);
        }
    }

    /// Mask of the robots whose point presses on the surface or overlaps it.
    #[inline(always)]
    pub fn touches(&self) -> L::Mask {
        let zero = self.gap.zero();
        zero.lt(self.impulses[0]) | self.gap.le(zero)
    }
}
