//! Shading: sun, sky, soft shadows and the checkered floor. The ground casts no shadows on itself.

use super::camera::View;
use super::color::{Color, srgb};
use super::scene::Placed;
use nalgebra::Vector3;

/// Edge of a square of the checkered floor, m; a quarter of the spacing of the grid lines.
const CHECKER_EDGE: f64 = 0.25;
/// Half width of a grid line, m; grid lines are 1 m apart.
const GRID_HALF_WIDTH: f64 = 0.006;
/// Distance over which the floor fades into the sky, m.
const HAZE_DISTANCE: f64 = 14.0;
/// Number of shadow rays to the disc of the sun, chosen by experiment: fewer rays show as separate shadows.
const SUN_RAYS: usize = 64;
/// The outermost of these rays, at most 53 deg apart: an edge between two of them hides at most one other ray.
const RIM_RAYS: usize = 8;
/// Apparent radius of the light source, rad. The real sun, 0.005 rad, would cast hard shadows.
const SUN_RADIUS: f64 = 0.05;

/// Maximum number of possible shadow casters kept per point for all its shadow rays.
const MAX_SHADOW_PARTS: usize = 32;

/// Light sources and colors, equal for all pixels.
pub(super) struct Light {
    sun: Vector3<f64>,
    towards: [Vector3<f64>; SUN_RAYS],
    /// Center of a sphere around all parts, inertial frame, m.
    center: Vector3<f64>,
    /// Radius of that sphere, m.
    radius: f64,
    horizon: Color,
    zenith: Color,
    squares: [Color; 2],
    line: Color,
    obstacle: Color,
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
            obstacle: srgb(0xc58a5c),
        }
    }

    pub fn sky(&self, direction: &Vector3<f64>) -> Color {
        let height = (direction.z / direction.norm()).clamp(0.0, 1.0);
        self.horizon.lerp(&self.zenith, height.sqrt())
    }

    /// Color of a point of a part in the direction of the camera.
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
        // Ambient light: brighter from the sky above than from the floor below.
        let around = 0.30 + 0.16 * normal.z;
        let half = (self.sun - direction.normalize()).normalize();
        let gloss = if lit > 0.0 { 0.18 * normal.dot(&half).max(0.0).powi(40) * lit } else { 0.0 };
        color * (around + 0.78 * lit) + Color::repeat(gloss)
    }

    /// Color of a point of the floor, with its normal, at depth `t` of a ray.
    pub fn floor(
        &self,
        point: &Vector3<f64>,
        normal: &Vector3<f64>,
        direction: &Vector3<f64>,
        t: f64,
        view: &View,
        parts: &[Placed<'_>],
    ) -> Color {
        let across = t * view.pixel;
        let along = across * direction.norm() / direction.dot(normal).abs();
        let horizontal = direction.xy() / direction.xy().norm().max(1e-12);
        let width = horizontal.map(f64::abs) * along
            + Vector3::new(horizontal.y, horizontal.x, 0.0).xy().map(f64::abs) * across;
        let share = checker(point.x, point.y, width.x, width.y);
        let lines = 1.0 - (1.0 - grid(point.x, width.x)) * (1.0 - grid(point.y, width.y));
        let color = self.squares[0].lerp(&self.squares[1], share).lerp(&self.line, lines);
        let facing = self.sun.dot(normal).max(0.0);
        let lit = facing * self.sunlight(point, normal, parts);
        let shade = 0.36 * self.openness(point, parts) + 0.76 * lit;
        let haze = (t / HAZE_DISTANCE).powi(2);
        (color * shade).lerp(&self.horizon, 1.0 - (-haze).exp())
    }

    /// Color of a point of an obstacle, with its outward normal, at depth `t` of a ray.
    pub fn obstacle(
        &self,
        point: &Vector3<f64>,
        normal: &Vector3<f64>,
        direction: &Vector3<f64>,
        t: f64,
        parts: &[Placed<'_>],
    ) -> Color {
        let color = self.surface(&self.obstacle, point, normal, direction, parts);
        color.lerp(&self.horizon, 1.0 - (-(t / HAZE_DISTANCE).powi(2)).exp())
    }

    /// Unoccluded fraction of the sky above a point of the floor, from the bounding spheres of the parts.
    fn openness(&self, point: &Vector3<f64>, parts: &[Placed<'_>]) -> f64 {
        let nearby = |part: &&Placed<'_>| (part.center - point).norm_squared() < (4.0 * part.radius).powi(2);
        parts.iter().filter(nearby).fold(1.0, |open, part| {
            let to = part.center - point;
            let distance = to.norm().max(part.radius);
            open * (1.0 - 0.5 * (to.z / distance).max(0.0) * (part.radius / distance).powi(2))
        })
    }

    /// Unoccluded fraction of the sun.
    fn sunlight(&self, point: &Vector3<f64>, normal: &Vector3<f64>, parts: &[Placed<'_>]) -> f64 {
        let to = self.center - point;
        let along = to.dot(&self.sun);
        let reach = self.radius + SUN_RADIUS * along.max(0.0);
        if along < -self.radius || to.norm_squared() - along * along > reach * reach {
            return 1.0;
        }
        // The offset prevents self-shadowing.
        let origin = point + normal * 1e-6;
        let mut near: [Option<&Placed<'_>>; MAX_SHADOW_PARTS] = [None; MAX_SHADOW_PARTS];
        let (mut count, mut thin) = (0, false);
        for part in parts {
            let to = part.center - origin;
            let along = to.dot(&self.sun);
            let reach = part.radius + SUN_RADIUS * along.max(0.0);
            if along <= -part.radius || to.norm_squared() - along * along >= reach * reach {
                continue;
            }
            thin |= part.part.shape.inner_radius() < SUN_RADIUS * along;
            // All rays to the sun are within this distance of the middle ray, as far as the part reaches.
            if part.near_box(&origin, &self.sun, 1e-9 + SUN_RADIUS * (along + part.radius)) {
                if count < MAX_SHADOW_PARTS {
                    near[count] = Some(part);
                }
                count += 1;
            }
        }
        if count == 0 {
            return 1.0;
        }
        let hidden = |towards: &Vector3<f64>| {
            // More casters than slots: test all parts.
            if count > MAX_SHADOW_PARTS {
                parts.iter().any(|part| part.hides(&origin, towards))
            } else {
                near.iter().flatten().any(|part| part.hides(&origin, towards))
            }
        };
        let count_hidden = |rays: &[Vector3<f64>]| rays.iter().filter(|towards| hidden(towards)).count();
        let (inner, rim) = self.towards.split_at(SUN_RAYS - RIM_RAYS);
        // If the outermost rays agree, the inner ones do too, unless a part is thinner than the disc of the sun.
        let on_rim = count_hidden(rim);
        if !thin && (on_rim == 0 || on_rim == rim.len()) {
            return 1.0 - (on_rim / rim.len()) as f64;
        }
        1.0 - (on_rim + count_hidden(inner)) as f64 / SUN_RAYS as f64
    }
}

/// Fraction of the second color in a rectangle of the checker. The average is exact, so distant squares show no
/// moiré.
fn checker(x: f64, y: f64, width_x: f64, width_y: f64) -> f64 {
    // The integral of a square wave of ±1 is a triangle wave.
    let wave = |x: f64, width: f64| {
        let (x, width) = (x / (2.0 * CHECKER_EDGE), width.max(1e-9) / (2.0 * CHECKER_EDGE));
        let triangle = |x: f64| ((x - floor(x)) - 0.5).abs();
        (triangle(x - 0.5 * width) - triangle(x + 0.5 * width)) / width
    };
    0.5 - 0.5 * wave(x, width_x) * wave(y, width_y)
}

/// Fraction of an interval that is covered by grid lines.
fn grid(x: f64, width: f64) -> f64 {
    let covered = |x: f64| {
        let meter = floor(x);
        meter * 2.0 * GRID_HALF_WIDTH
            + (x - meter).min(GRID_HALF_WIDTH)
            + ((x - meter) - (1.0 - GRID_HALF_WIDTH)).max(0.0)
    };
    let width = width.max(1e-6);
    (covered(x + 0.5 * width) - covered(x - 0.5 * width)) / width
}

/// The largest integer that is not above `x`: exact for the coordinates of pictures, without a call to libm.
#[inline(always)]
fn floor(x: f64) -> f64 {
    let whole = x as i64 as f64;
    if whole > x { whole - 1.0 } else { whole }
}
