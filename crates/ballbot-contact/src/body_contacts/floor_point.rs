//! Contact points of bot and floor: one per wheel, and three on the rims of the body cylinder.

use super::mast::MastFrame;
use crate::constants::{Constants, at3};
use crate::footing::Relief;
use crate::friction::in_disc;
use crate::phases::Start;
use crate::rows::allowance;
use crate::types::Velocities;
use ballbot_base::lanes::{Lane, Value, Vec3, map3};
use ballbot_base::terrain::Frame;

/// Number of points.
pub const POINTS: usize = 6;

/// Cosine and sine of the angle between points of a rim.
const THIRD: [f64; 2] = [-0.5, 0.866_025_403_784_438_6];

/// Horizontal part of the mast's direction below which a rim has no lowest point.
const UPRIGHT: f64 = 1e-6;
/// Steps of the search for the point of a rim that is nearest to a floor with relief.
const REFINEMENTS: usize = 2;

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

/// A contact point of bot and floor.
pub struct FloorPoint<L: Lane> {
    /// Wheel of the point; `None` for a point of the body.
    wheel: Option<usize>,
    /// Normal and two tangents of the floor at the point, inertial frame.
    axes: [Vec3<L>; 3],
    /// Height above the floor, m.
    gap: L,
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
    pub impulses: [L; 3],
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

/// The floor below a point of the bot.
struct Below<L> {
    /// Normal and two tangents, inertial frame.
    axes: [Vec3<L>; 3],
    /// The axes in the principal frame.
    turned: [Vec3<L>; 3],
    /// Height of the point above the floor, m.
    height: L,
}

impl<L: Lane> Below<L> {
    /// The floor below a point (principal frame); a `relief`, or the plane z = 0.
    #[inline(always)]
    fn new(start: &Start<L>, relief: Option<&Relief<'_, L>>, point: Vec3<L>) -> Self {
        let rotation = &start.rotation;
        let Some(relief) = relief else {
            let (zero, one) = (point.x.zero(), point.x.splat(1.0));
            let [x, y, z] = rotation.rows;
            return Self {
                axes: [Vec3::new(zero, zero, one), Vec3::new(one, zero, zero), Vec3::new(zero, one, zero)],
                turned: [z, x, y],
                height: start.pose.body.z + z.dot(point),
            };
        };
        let (height, normal) = relief.below(start.pose.body + rotation.apply(point));
        // The smallest rotation from z to the normal.
        let [x, y, _] = Frame::of_normal(normal).rotation.rows;
        let axes = [normal, x, y];
        let turned = map3(
            axes,
            #[inline(always)]
            |axis| rotation.apply_transposed(axis),
        );
        Self { axes, turned, height }
    }
}

/// Points of a robot that touch the floor in this step if they are below `limit`.
#[inline(always)]
pub fn floor_points<L: Lane, V: Value<L>>(
    c: &Constants<V>,
    start: &Start<L>,
    limit: L,
    relief: Option<&Relief<'_, L>>,
) -> [FloorPoint<L>; POINTS] {
    let like = start.pose.body.z;
    let frame = MastFrame::new(c, like);
    // Up axis of the floor below the CoM.
    let up = frame.vector(Below::new(start, relief, Vec3::zero(like)).turned[0]);
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
        FloorPoint::of_wheel(c, start, relief, limit, 0),
        FloorPoint::of_wheel(c, start, relief, limit, 1),
        FloorPoint::of_wheel(c, start, relief, limit, 2),
        FloorPoint::of_body(c, start, relief, limit, arms[0]),
        FloorPoint::of_body(c, start, relief, limit, arms[1]),
        FloorPoint::of_body(c, start, relief, third_limit, arms[2]),
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
            direction = lowest_direction(frame.vector(Below::new(start, relief, point).turned[0]));
        }
    }
    direction
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

impl<L: Lane> FloorPoint<L> {
    /// The point of wheel `i` nearest to the floor. About the axle the wheel rotates at its spin, not at the body rate.
    #[inline(always)]
    fn of_wheel<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        relief: Option<&Relief<'_, L>>,
        limit: L,
        i: usize,
    ) -> Self {
        let (center, u) = (c.wheel_center(i, limit), c.u(i, limit));
        let radius = c.wheel_radius.at(limit);
        let below = Below::new(start, relief, center);
        let normal = below.turned[0];
        let rows = map3(
            below.turned,
            #[inline(always)]
            |axis| {
                let across = normal.cross(axis);
                let along = across.dot(u);
                let arm = center.cross(axis) - (across - u * along) * radius;
                Row::new(c, arm, along * radius)
            },
        );
        Self::new(Some(i), below.axes, below.height - radius, limit, rows)
    }

    /// A point fixed to the body.
    #[inline(always)]
    fn of_body<V: Value<L>>(
        c: &Constants<V>,
        start: &Start<L>,
        relief: Option<&Relief<'_, L>>,
        limit: L,
        arm: Vec3<L>,
    ) -> Self {
        let below = Below::new(start, relief, arm);
        let rows = map3(
            below.turned,
            #[inline(always)]
            |axis| Row::new(c, arm.cross(axis), limit.zero()),
        );
        Self::new(None, below.axes, below.height, limit, rows)
    }

    #[inline(always)]
    fn new(wheel: Option<usize>, axes: [Vec3<L>; 3], gap: L, limit: L, rows: [Row<L>; 3]) -> Self {
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
            candidate: gap.lt(limit),
            normal_inverse: one / normal.compliance,
            tangent_inverse: one / largest,
            couplings: [normal.coupling(x), normal.coupling(y)],
            rows,
            impulses: [gap.zero(); 3],
        }
    }

    /// Whether any of the robots in `mask` may touch the floor with this point.
    #[inline(always)]
    pub fn may_touch(&self, mask: L::Mask) -> bool {
        L::any(self.candidate & mask)
    }

    /// Robots whose point reaches the floor at these velocities.
    #[inline(always)]
    pub fn closes<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>) -> L::Mask {
        let speed = self.rows[0].speed(self.wheel, self.axes[0].dot(v.body), v);
        self.candidate & (speed + allowance(c, self.gap)).lt(speed.zero())
    }

    /// One Gauss-Seidel sweep over the rows of this point. Returns the sum of the squared changes of its impulses.
    #[inline(always)]
    pub fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, friction: L, v: &mut Velocities<L>) -> L {
        let zero = friction.zero();
        let [normal, x, y] = &self.rows;
        let [n, tx, ty] = self.impulses;
        // All speeds at once; the coupling gives the effect of the normal impulse on the tangential speeds.
        let [up, across, along] = self.axes;
        let sn = normal.speed(self.wheel, up.dot(v.body), v);
        let sx = x.speed(self.wheel, across.dot(v.body), v);
        let sy = y.speed(self.wheel, along.dot(v.body), v);
        let pressed = (sn + allowance(c, self.gap)).neg_mul_add(self.normal_inverse, n).max(zero);
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

    /// Impulse of the floor on the bot at this point, N·s.
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

    /// Mask of the robots whose point presses on the floor or overlaps it.
    #[inline(always)]
    pub fn touches(&self) -> L::Mask {
        let zero = self.gap.zero();
        zero.lt(self.impulses[0]) | self.gap.le(zero)
    }
}
