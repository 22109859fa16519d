//! Intersection of rays with the ground.

use super::Terrain;
use super::places::each;
use crate::lanes::run_one;
use nalgebra::Vector3;

/// Largest number of steps along a ray. A ray that grazes the ground for longer has hit it.
const MOST_STEPS: usize = 400;

/// Height above the ground below which a ray of a picture follows the local tangent, m.
const MET: f64 = 1e-7;

/// Rays from one origin.
pub struct Rays<const N: usize> {
    /// Components of their directions.
    pub direction: [[f64; N]; 3],
    /// Fractions of the directions before which no ray hits the ground.
    pub from: [f64; N],
    /// Fractions at which the rays end.
    pub limit: [f64; N],
}

impl Terrain {
    /// The first fraction of `direction`, up to `limit`, at which a ray from `origin` hits the ground from above, and
    /// the normal there; `None` if it does not, or hits it beyond the edges of the terrain.
    pub fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<(f64, Vector3<f64>)> {
        let rays = Rays { direction: [[direction.x], [direction.y], [direction.z]], from: [0.0], limit: [limit] };
        let [share] = run_one(
            #[inline(always)]
            || self.meet(origin, &rays, MET),
        );
        let at = origin + direction * share;
        // From below, or through an edge of the terrain.
        let entered = self.plane.is_none() && at.z - self.height(at.x, at.y) < -MET.sqrt();
        (share < limit && !entered && share.is_finite()).then(|| (share, self.normal(at.x, at.y)))
    }

    /// The first fraction of each ray at which it is within `met` of the ground, along the vertical, or below it;
    /// infinite if there is none up to its limit on the terrain.
    ///
    /// A step is the longer of two steps that cannot pass through the ground: from the steepest slope, and from the
    /// local slope with the largest curvature, which near the ground is a Newton step.
    #[inline(always)]
    pub fn meet<const N: usize>(&self, origin: &Vector3<f64>, rays: &Rays<N>, met: f64) -> [f64; N] {
        let Rays { direction: [dx, dy, dz], from, limit } = rays;
        let mut hit = [f64::INFINITY; N];
        if let Some([gx, gy]) = self.plane {
            let above = origin.z - gx * origin.x - gy * origin.y;
            for i in 0..N {
                let closing = gx * dx[i] + gy * dy[i] - dz[i];
                let share = above / closing;
                if above < 0.0 {
                    hit[i] = 0.0;
                } else if closing > 0.0 && share < limit[i] {
                    hit[i] = share;
                }
            }
            return hit;
        }
        let (mut share, mut end) = (*from, *limit);
        let (mut closing, mut bend) = ([0.0; N], [0.0; N]);
        let top = self.steepness.highest + met;
        for i in 0..N {
            clip(&mut share[i], &mut end[i], origin.x, dx[i], [-self.half_size[0], self.half_size[0]]);
            clip(&mut share[i], &mut end[i], origin.y, dy[i], [-self.half_size[1], self.half_size[1]]);
            clip(&mut share[i], &mut end[i], origin.z, dz[i], [f64::NEG_INFINITY, top]);
            let sideways = dx[i].mul_add(dx[i], dy[i] * dy[i]);
            closing[i] = self.steepness.rise.mul_add(sideways.sqrt(), -dz[i]);
            bend[i] = 2.0 * self.steepness.bend * sideways;
        }
        let mut active = [false; N];
        for i in 0..N {
            active[i] = share[i] <= end[i];
        }
        for _ in 0..MOST_STEPS {
            if !active.contains(&true) {
                break;
            }
            let x: [f64; N] = each(
                #[inline(always)]
                |i| dx[i].mul_add(share[i], origin.x),
            );
            let y: [f64; N] = each(
                #[inline(always)]
                |i| dy[i].mul_add(share[i], origin.y),
            );
            let ground = self.surface.slopes_at(&x, &y);
            for i in 0..N {
                if !active[i] {
                    continue;
                }
                let above = dz[i].mul_add(share[i], origin.z) - ground.z[i];
                let falling = ground.gx[i].mul_add(dx[i], ground.gy[i].mul_add(dy[i], -dz[i]));
                if above < met {
                    // Along the tangent: the remaining distance.
                    let rest = if above > 0.0 && falling > 0.0 { above / falling } else { 0.0 };
                    hit[i] = (share[i] + rest).min(end[i]);
                    active[i] = false;
                    continue;
                }
                if closing[i] <= 0.0 {
                    active[i] = false;
                    continue;
                }
                let straight = above / closing[i];
                let curved = 2.0 * above / (falling + falling.mul_add(falling, bend[i] * above).sqrt());
                // A ray that rises from flat ground has no curved step.
                share[i] += if curved.is_finite() { curved.max(straight) } else { straight };
                active[i] = share[i] <= end[i];
            }
        }
        for i in 0..N {
            if active[i] {
                hit[i] = share[i];
            }
        }
        hit
    }

    /// Tangent of the steepest slope anywhere.
    pub fn steepest(&self) -> f64 {
        self.steepness.rise
    }
}

/// Limits a part of a ray to the range of a coordinate.
#[inline(always)]
fn clip(from: &mut f64, to: &mut f64, origin: f64, direction: f64, [low, high]: [f64; 2]) {
    if direction == 0.0 {
        if origin < low || origin > high {
            *to = f64::NEG_INFINITY;
        }
        return;
    }
    let (a, b) = ((low - origin) / direction, (high - origin) / direction);
    *from = from.max(a.min(b));
    *to = to.min(a.max(b));
}
