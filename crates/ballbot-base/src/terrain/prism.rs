//! The shape of every obstacle: a rounded rectangle, extruded along z.

use crate::lanes::{Lane, Vec3, lane_struct};

lane_struct! {
    /// An upright prism over a rectangle with rounded corners. SI units, inertial frame. Half lengths may be infinite.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Prism<T> {
        /// Its center.
        pub center: Vec3<T>,
        /// Half lengths along its own axes, without the rounding.
        pub half: Vec3<T>,
        /// Cosine and sine of the angle from the x axis to its own.
        pub axis: [T; 2],
        /// Radius of its corners.
        pub radius: T,
        /// Coefficient of friction.
        pub friction: T,
        /// Speed after an impact over the speed before.
        pub restitution: T,
    }
}

/// Distance from a line of the outline, or from a corner, at which a direction is undefined, m.
const TINY: f64 = 1e-300;

impl<L: Lane> Prism<L> {
    /// Horizontal distance from the outline, negative inside, and its gradient.
    #[inline(always)]
    pub fn outline(&self, point: Vec3<L>) -> (L, [L; 2]) {
        let [cos, sin] = self.axis;
        let (dx, dy) = (point.x - self.center.x, point.y - self.center.y);
        let (x, y) = (cos.mul_add(dx, sin * dy), cos.mul_add(dy, -(sin * dx)));
        let zero = x.zero();
        let (one, tiny) = (x.splat(1.0), x.splat(TINY));
        let (over_x, over_y) = (x.abs() - self.half.x, y.abs() - self.half.y);
        let (out_x, out_y) = (over_x.max(zero), over_y.max(zero));
        let apart = out_x.mul_add(out_x, out_y.squared()).sqrt();
        let outside = tiny.lt(apart);
        let inverse = one / L::select(outside, apart, one);
        // Inside, the nearest side.
        let sideways = over_x.lt(over_y);
        let along_x = L::select(outside, out_x * inverse, L::select(sideways, zero, one));
        let along_y = L::select(outside, out_y * inverse, L::select(sideways, one, zero));
        let along_x = L::select(x.lt(zero), -along_x, along_x);
        let along_y = L::select(y.lt(zero), -along_y, along_y);
        let distance = apart + over_x.max(over_y).min(zero) - self.radius;
        (distance, [cos.mul_add(along_x, -(sin * along_y)), sin.mul_add(along_x, cos * along_y)])
    }

    /// Horizontal distance of a point from the outline, m, negative inside: at most its distance from the prism.
    #[inline(always)]
    pub fn aside(&self, point: Vec3<L>) -> L {
        self.outline(point).0
    }

    /// Distance of a point, m, negative inside, and its gradient: the outward normal at the nearest point of the surface.
    #[inline(always)]
    pub fn distance(&self, point: Vec3<L>) -> (L, Vec3<L>) {
        let (aside, [gx, gy]) = self.outline(point);
        let height = point.z - self.center.z;
        let above = height.abs() - self.half.z;
        let zero = aside.zero();
        let one = zero.splat(1.0);
        let (out, over) = (aside.max(zero), above.max(zero));
        let apart = out.mul_add(out, over.squared()).sqrt();
        let outside = zero.splat(TINY).lt(apart);
        let inverse = one / L::select(outside, apart, one);
        let through_side = above.lt(aside);
        let flat = L::select(outside, out * inverse, L::select(through_side, one, zero));
        let up = L::select(outside, over * inverse, L::select(through_side, zero, one));
        let up = L::select(height.lt(zero), -up, up);
        (L::select(outside, apart, aside.max(above)), Vec3::new(gx * flat, gy * flat, up))
    }
}

impl Prism<f64> {
    /// The same prism in all lanes.
    #[inline(always)]
    pub fn in_lanes<L: Lane>(&self, like: L) -> Prism<L> {
        self.map(
            #[inline(always)]
            |number| like.splat(*number),
        )
    }
}

/// Halvings of a segment in the search for its point that is nearest to a prism: to a ten-millionth of its length.
const HALVINGS: usize = 24;

impl<L: Lane> Prism<L> {
    /// The point of a segment that is nearest to the prism; of a part that is parallel to its surface, one point.
    #[inline(always)]
    pub fn nearest_on(&self, from: Vec3<L>, to: Vec3<L>) -> Vec3<L> {
        let along = to - from;
        let zero = along.x.zero();
        let (mut low, mut high) = (zero, zero.splat(1.0));
        // The distance is a convex function along the segment: its slope has the sign of the way to the minimum.
        for _ in 0..HALVINGS {
            let middle = (low + high) * 0.5;
            let (_, normal) = self.distance(from.plus(along, middle));
            let slope = normal.dot(along);
            (low, high) = (L::select(zero.lt(slope), low, middle), L::select(slope.lt(zero), high, middle));
        }
        from.plus(along, (low + high) * 0.5)
    }
}
