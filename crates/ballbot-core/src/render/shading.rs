//! Light: sun and sky, soft shadows, the floor's checker.

use super::camera::View;
use super::color::{Color, srgb};
use super::scene::Placed;
use nalgebra::Vector3;

/// Edge of a square of the floor, m; four make the meter of the grid.
const CHECKER_EDGE: f64 = 0.25;
/// Half width of a line of the meter grid, m.
const GRID_HALF_WIDTH: f64 = 0.006;
/// Where the floor has faded into the sky, m.
const HAZE_DISTANCE: f64 = 14.0;
/// Rays to the sun where its edge may be hidden; as few as do not show.
const SUN_RAYS: usize = 12;
/// Apparent radius of the sun, rad: that of a lamp rather than of the sun.
const SUN_RADIUS: f64 = 0.05;

/// Parts between a point and the sun that are remembered for all rays to it.
const MAX_SHADOW_PARTS: usize = 32;

/// Everything that is the same for all pixels.
pub(super) struct Light {
    sun: Vector3<f64>,
    towards: [Vector3<f64>; SUN_RAYS],
    /// Of a sphere around all parts.
    center: Vector3<f64>,
    radius: f64,
    horizon: Color,
    zenith: Color,
    squares: [Color; 2],
    line: Color,
}

impl Light {
    pub fn new(parts: &[Placed<'_>]) -> Self {
        let sun = Vector3::new(-0.45, -0.55, 1.1).normalize();
        let across = sun.cross(&Vector3::x()).normalize();
        let other = sun.cross(&across);
        // Points spread evenly over a disc (Vogel's spiral).
        let towards = std::array::from_fn(|k| {
            let (angle, share) = (2.399_963 * k as f64, ((k as f64 + 0.5) / SUN_RAYS as f64).sqrt());
            sun + (across * angle.cos() + other * angle.sin()) * (share * SUN_RADIUS)
        });
        let count = parts.len().max(1) as f64;
        let center = parts.iter().fold(Vector3::zeros(), |sum, part| sum + part.center) / count;
        let radius = parts.iter().map(|part| (part.center - center).norm() + part.radius).fold(0.0, f64::max);
        Self {
            sun,
            towards,
            center,
            radius,
            horizon: srgb(0xf1f5f8),
            zenith: srgb(0xb9d3e6),
            squares: [srgb(0xe3e8ec), srgb(0xccd5dc)],
            line: srgb(0x9fb0bd),
        }
    }

    pub fn sky(&self, direction: &Vector3<f64>) -> Color {
        let height = (direction.z / direction.norm()).clamp(0.0, 1.0);
        self.horizon.lerp(&self.zenith, height.sqrt())
    }

    /// Light that a point of a part sends to the eye.
    pub fn surface(
        &self,
        color: &Color,
        point: &Vector3<f64>,
        normal: &Vector3<f64>,
        direction: &Vector3<f64>,
        parts: &[Placed<'_>],
    ) -> Color {
        let facing = normal.dot(&self.sun);
        let lit = if facing > 0.0 { facing * self.sunlight(point, normal, parts) } else { 0.0 };
        // The sky from above, the floor's light from below.
        let around = 0.30 + 0.16 * normal.z;
        let half = (self.sun - direction.normalize()).normalize();
        let gloss = if lit > 0.0 { 0.18 * normal.dot(&half).max(0.0).powi(40) * lit } else { 0.0 };
        color * (around + 0.78 * lit) + Color::repeat(gloss)
    }

    /// Light of the floor at a point, `t` along a ray of depth-1 direction.
    pub fn floor(
        &self,
        point: &Vector3<f64>,
        direction: &Vector3<f64>,
        t: f64,
        view: &View,
        parts: &[Placed<'_>],
    ) -> Color {
        let across = t * view.pixel;
        let along = across * direction.norm() / direction.z.abs();
        let horizontal = direction.xy() / direction.xy().norm().max(1e-12);
        let width = horizontal.map(f64::abs) * along
            + Vector3::new(horizontal.y, horizontal.x, 0.0).xy().map(f64::abs) * across;
        let share = checker(point.x, point.y, width.x, width.y);
        let lines = 1.0 - (1.0 - grid(point.x, width.x)) * (1.0 - grid(point.y, width.y));
        let color = self.squares[0].lerp(&self.squares[1], share).lerp(&self.line, lines);
        let normal = Vector3::z();
        let lit = self.sun.z * self.sunlight(point, &normal, parts);
        let shade = 0.36 * self.openness(point, parts) + 0.76 * lit;
        let haze = (t / HAZE_DISTANCE).powi(2);
        (color * shade).lerp(&self.horizon, 1.0 - (-haze).exp())
    }

    /// Share of the sky that a point of the floor sees past the parts' spheres.
    fn openness(&self, point: &Vector3<f64>, parts: &[Placed<'_>]) -> f64 {
        let nearby = |part: &&Placed<'_>| (part.center - point).norm_squared() < (4.0 * part.radius).powi(2);
        parts.iter().filter(nearby).fold(1.0, |open, part| {
            let to = part.center - point;
            let distance = to.norm().max(part.radius);
            open * (1.0 - 0.5 * (to.z / distance).max(0.0) * (part.radius / distance).powi(2))
        })
    }

    /// Share of the sun that is not hidden.
    fn sunlight(&self, point: &Vector3<f64>, normal: &Vector3<f64>, parts: &[Placed<'_>]) -> f64 {
        let to = self.center - point;
        let along = to.dot(&self.sun);
        let reach = self.radius + SUN_RADIUS * along.max(0.0);
        if along < -self.radius || to.norm_squared() - along * along > reach * reach {
            return 1.0;
        }
        // Off the surface, or it would shade itself.
        let origin = point + normal * 1e-6;
        let mut near: [Option<&Placed<'_>>; MAX_SHADOW_PARTS] = [None; MAX_SHADOW_PARTS];
        let (mut count, mut thin) = (0, false);
        for part in parts {
            let to = part.center - origin;
            let along = to.dot(&self.sun);
            let reach = part.radius + SUN_RADIUS * along.max(0.0);
            if along > -part.radius && to.norm_squared() - along * along < reach * reach {
                if count < MAX_SHADOW_PARTS {
                    near[count] = Some(part);
                }
                count += 1;
                thin |= part.part.shape.inner_radius() < SUN_RADIUS * along;
            }
        }
        if count == 0 {
            return 1.0;
        }
        let hides = |part: &Placed<'_>, towards: &Vector3<f64>| part.cast(&origin, towards, f64::INFINITY).is_some();
        let hidden = |towards: &Vector3<f64>| {
            // Too many to remember: try them all.
            if count > MAX_SHADOW_PARTS {
                parts.iter().any(|part| hides(part, towards))
            } else {
                near.iter().flatten().any(|part| hides(part, towards))
            }
        };
        let count_hidden = |rays: &[Vector3<f64>]| rays.iter().filter(|towards| hidden(towards)).count();
        let (inner, rim) = self.towards.split_at(SUN_RAYS - 4);
        // The outermost rays first: where they agree, so do those between, unless something thin is between them.
        let on_rim = count_hidden(rim);
        if !thin && (on_rim == 0 || on_rim == rim.len()) {
            return 1.0 - (on_rim / rim.len()) as f64;
        }
        1.0 - (on_rim + count_hidden(inner)) as f64 / SUN_RAYS as f64
    }
}

/// Share of the second color in a box of a checker: an exact average, so that squares far away neither flicker nor moiré.
fn checker(x: f64, y: f64, width_x: f64, width_y: f64) -> f64 {
    // The integral of a square wave of ±1 is a triangle wave.
    let wave = |x: f64, width: f64| {
        let (x, width) = (x / (2.0 * CHECKER_EDGE), width.max(1e-9) / (2.0 * CHECKER_EDGE));
        let triangle = |x: f64| ((x - x.floor()) - 0.5).abs();
        (triangle(x - 0.5 * width) - triangle(x + 0.5 * width)) / width
    };
    0.5 - 0.5 * wave(x, width_x) * wave(y, width_y)
}

/// Share of a line of the meter grid in an interval.
fn grid(x: f64, width: f64) -> f64 {
    let covered = |x: f64| {
        let meter = x.floor();
        meter * 2.0 * GRID_HALF_WIDTH
            + (x - meter).min(GRID_HALF_WIDTH)
            + ((x - meter) - (1.0 - GRID_HALF_WIDTH)).max(0.0)
    };
    let width = width.max(1e-6);
    (covered(x + 0.5 * width) - covered(x - 0.5 * width)) / width
}
