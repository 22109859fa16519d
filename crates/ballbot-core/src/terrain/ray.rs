//! Where rays meet the ground.

use super::patch::Patch;
use super::{Terrain, normal_of};
use crate::lanes::Scalar;
use nalgebra::Vector3;

/// Height of a ray over the ground at which it has met it, m.
const MET: f64 = 1e-7;

/// Most steps along a ray. One that grazes the ground longer than that has met it.
const MOST_STEPS: usize = 400;

impl Terrain {
    /// The first share of `direction`, up to `limit`, at which a ray from `origin` meets the ground from above, and the
    /// ground's normal there; `None` if it does not, or meets it beyond the edges of the terrain.
    ///
    /// Steps are as long as the steepest slope allows, so that none passes through the ground.
    pub fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<(f64, Vector3<f64>)> {
        if let Some([gx, gy]) = self.plane {
            let normal = Vector3::new(-gx, -gy, 1.0);
            let (above, closing) = (normal.dot(origin), -normal.dot(direction));
            let share = above / closing;
            return (above >= 0.0 && closing > 0.0 && share < limit).then(|| (share, normal.normalize()));
        }
        let mut span = [0.0, limit];
        for axis in 0..2 {
            clip(&mut span, origin[axis], direction[axis], [-self.half_size[axis], self.half_size[axis]]);
        }
        clip(&mut span, origin.z, direction.z, [f64::NEG_INFINITY, self.steepness.highest + MET]);
        let closing = self.steepness.slope.tan().mul_add(direction.xy().norm(), -direction.z);
        if span[0] > span[1] || closing <= 0.0 {
            return None;
        }
        let mut patch = Patch::<f64>::default();
        let mut share = span[0];
        for _ in 0..MOST_STEPS {
            let at = origin + direction * share;
            let height = self.surface.at::<f64>(Scalar, [at.x, at.y], &mut patch);
            let above = at.z - height.z;
            if above < MET {
                // From below, or through an edge of the terrain.
                let entered = above < -MET.sqrt();
                return (!entered).then(|| (share, normal_of(height.gradient)));
            }
            share += above / closing;
            if share > span[1] {
                return None;
            }
        }
        let at = origin + direction * share;
        Some((share, self.normal(at.x, at.y)))
    }
}

/// Limits a span of a ray to where a coordinate is in a range.
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
