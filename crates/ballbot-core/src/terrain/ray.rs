//! Where rays meet the ground.

use super::Terrain;
use crate::lanes::run_one;
use nalgebra::Vector3;

/// Most steps along a ray. One that grazes the ground longer than that has met it.
const MOST_STEPS: usize = 400;

/// Height over the ground at which a picture's ray has met it, m.
const MET: f64 = 1e-7;

impl Terrain {
    /// The first share of `direction`, up to `limit`, at which a ray from `origin` meets the ground from above, and the
    /// ground's normal there; `None` if it does not, or meets it beyond the edges of the terrain.
    pub fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let share = run_one(
            #[inline(always)]
            || self.meet(origin, direction, limit, MET),
        )?;
        let at = origin + direction * share;
        // From below, or through an edge of the terrain.
        let entered = self.plane.is_none() && at.z - self.height(at.x, at.y) < -MET.sqrt();
        (!entered).then(|| (share, self.normal(at.x, at.y)))
    }

    /// The first share of `direction`, up to `limit`, at which a ray from `origin` is within `met` of the ground, along the
    /// vertical, or below it; `None` if there is none on the terrain.
    ///
    /// A step is the longest of two that cannot pass through the ground: that of the steepest slope, and that of the slope
    /// here with the largest curvature, which near the ground is one of Newton's method.
    #[inline(always)]
    pub fn meet(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64, met: f64) -> Option<f64> {
        if let Some([gx, gy]) = self.plane {
            let above = origin.z - gx * origin.x - gy * origin.y;
            let closing = gx * direction.x + gy * direction.y - direction.z;
            let share = above / closing;
            return if above < 0.0 { Some(0.0) } else { (closing > 0.0 && share < limit).then_some(share) };
        }
        let mut span = [0.0, limit];
        for axis in 0..2 {
            clip(&mut span, origin[axis], direction[axis], [-self.half_size[axis], self.half_size[axis]]);
        }
        clip(&mut span, origin.z, direction.z, [f64::NEG_INFINITY, self.steepness.highest + met]);
        let sideways = direction.x.mul_add(direction.x, direction.y * direction.y);
        let closing = self.steepness.slope.tan().mul_add(sideways.sqrt(), -direction.z);
        if span[0] > span[1] {
            return None;
        }
        let bend = self.steepness.bend * sideways;
        let mut share = span[0];
        for _ in 0..MOST_STEPS {
            let at = origin + direction * share;
            let ground = self.surface.slope(at.x, at.y);
            let above = at.z - ground.z;
            let [gx, gy] = ground.gradient;
            let falling = gx.mul_add(direction.x, gy.mul_add(direction.y, -direction.z));
            if above < met {
                // Along the tangent: the rest of the way.
                let rest = if above > 0.0 && falling > 0.0 { above / falling } else { 0.0 };
                return Some((share + rest).min(span[1]));
            }
            if closing <= 0.0 {
                return None;
            }
            let curved = 2.0 * above / (falling + falling.mul_add(falling, 2.0 * bend * above).sqrt());
            // A ray along flat ground that rises from it gives no curved step.
            share += if curved.is_finite() { curved.max(above / closing) } else { above / closing };
            if share > span[1] {
                return None;
            }
        }
        Some(share)
    }
}

/// Limits a span of a ray to where a coordinate is in a range.
#[inline(always)]
fn clip(span: &mut [f64; 2], origin: f64, direction: f64, [low, high]: [f64; 2]) {
    if direction == 0.0 {
        if origin < low || origin > high {
            *span = [1.0, 0.0];
        }
        return;
    }
    let (a, b) = ((low - origin) / direction, (high - origin) / direction);
    span[0] = span[0].max(a.min(b));
    span[1] = span[1].min(a.max(b));
}
