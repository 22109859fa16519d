//! The depth camera: distances to ground and ball along the optical axis of a camera on the body.

use super::channel::Reads;
use super::options::DepthOptions;
use super::view::View;
use ballbot_base::lanes::{Draws, run_one};
use ballbot_base::terrain::{PLACES, Rays, Terrain, each};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Height above the ground at which a ray follows the tangent there, m.
const MET: f64 = 1e-4;

/// Block of random numbers of the mounting and of frozen pictures, and first blocks of noise and holes: four pixels
/// share a block.
const MOUNTING: u32 = 3 << 20;
const FREEZE: u32 = (3 << 20) + 1;
const NOISE: u32 = 4 << 20;
const HOLES: u32 = 5 << 20;

/// A depth camera.
#[derive(Clone, Debug)]
pub struct Depth {
    options: DepthOptions,
    columns: usize,
    /// Directions to the right, up and forward, columns, in the body frame.
    axes: Matrix3<f64>,
    /// Slopes of the rays through the left edge of the first column and the upper edge of the first row, and steps from
    /// one pixel to the next.
    corner: [f64; 2],
    pitch: f64,
}

impl Depth {
    pub fn new(options: &DepthOptions) -> Self {
        let [columns, rows] = options.size;
        let pitch = 2.0 * (0.5 * options.field_of_view).tan() / rows;
        let (sin, cos) = options.pitch.sin_cos();
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), options.yaw);
        let axes = Matrix3::from_columns(&[-Vector3::y(), Vector3::new(sin, 0.0, cos), Vector3::new(cos, 0.0, -sin)]);
        Self {
            options: options.clone(),
            columns: columns as usize,
            axes: turn * axes,
            corner: [-0.5 * pitch * columns, 0.5 * pitch * rows],
            pitch,
        }
    }
}

impl Reads for Depth {
    /// Constants of an episode: the rotation vector of the mounting, rad.
    fn constants(&self, draws: &Draws<f64>) -> [f64; 3] {
        if self.options.misalignment == 0.0 {
            return [0.0; 3];
        }
        let [x, y, z, _] = draws.normals(MOUNTING);
        [x, y, z].map(|angle| angle * self.options.misalignment)
    }

    /// Writes the depth of each pixel, m, rows from the top, each from the left.
    fn read(
        &self,
        view: &View,
        terrain: Option<&Terrain>,
        mounting: &[f64; 3],
        draws: &Draws<f64>,
        first: bool,
        out: &mut [f32],
    ) {
        let DepthOptions { near, far, freeze, .. } = self.options;
        if freeze > 0.0 && !first && draws.units(FREEZE)[0] < freeze {
            return;
        }
        let attitude = view.rotation();
        let ball = Vector3::from(view.ball);
        let axes = attitude * Rotation3::from_scaled_axis(Vector3::from(*mounting)) * self.axes;
        let arm = attitude * Vector3::from(self.options.position);
        let eye = ball + arm;
        let [right, up, forward] = [axes.column(0), axes.column(1), axes.column(2)];
        let outside = arm.norm_squared() - view.ball_radius * view.ball_radius;
        let corner = self.corner;
        let steepest = terrain.map_or(0.0, Terrain::steepest);
        let rows = out.len() / self.columns;
        run_one(
            #[inline(always)]
            || {
                for first_column in (0..self.columns).step_by(PLACES) {
                    let columns = first_column..(first_column + PLACES).min(self.columns);
                    let mut lower = [Course::default(); PLACES];
                    // From the bottom up: a ray is above the ground at least until the ray below it meets the ground.
                    for row in (0..rows).rev() {
                        let line = forward + up * self.pitch.mul_add(-(row as f64 + 0.5), corner[1]);
                        let mut rays = Rays {
                            direction: [[0.0; PLACES]; 3],
                            from: [0.0; PLACES],
                            limit: [f64::NEG_INFINITY; PLACES],
                        };
                        for (i, column) in columns.clone().enumerate() {
                            let ray = line + right * self.pitch.mul_add(column as f64 + 0.5, corner[0]);
                            rays.direction[0][i] = ray.x;
                            rays.direction[1][i] = ray.y;
                            rays.direction[2][i] = ray.z;
                            let course = Course::of(&ray);
                            rays.from[i] = course.clear_share(&lower[i], steepest);
                            lower[i] = course;
                            rays.limit[i] = match entry(&arm, &ray, outside) {
                                Some(share) if share < far => share,
                                _ => far,
                            };
                        }
                        let met = match terrain {
                            Some(terrain) => terrain.meet(&eye, &rays, MET),
                            None => level(&eye, &rays),
                        };
                        let pixels = &mut out[row * self.columns..][columns.clone()];
                        for (i, pixel) in pixels.iter_mut().enumerate() {
                            let share = met[i].min(rays.limit[i]);
                            let course = &mut lower[i];
                            course.clear = if course.shares > 0.0 { share / course.shares } else { 0.0 };
                            *pixel = share.clamp(near, far) as f32;
                        }
                    }
                }
            },
        );
        self.add_errors(draws, out);
    }
}

impl Depth {
    fn add_errors(&self, draws: &Draws<f64>, out: &mut [f32]) {
        let DepthOptions { near, far, noise: [constant, growing], dropout, .. } = self.options;
        if constant > 0.0 || growing > 0.0 {
            for (block, pixels) in out.chunks_mut(4).enumerate() {
                for (pixel, normal) in pixels.iter_mut().zip(draws.normals(NOISE + block as u32)) {
                    let depth = f64::from(*pixel);
                    // Nothing is measured beyond this.
                    if depth < far {
                        let deviation = (growing * depth).mul_add(depth, constant);
                        *pixel = deviation.mul_add(normal, depth).clamp(near, far) as f32;
                    }
                }
            }
        }
        if dropout > 0.0 {
            for (block, pixels) in out.chunks_mut(4).enumerate() {
                for (pixel, unit) in pixels.iter_mut().zip(draws.units(HOLES + block as u32)) {
                    if unit < dropout {
                        *pixel = far as f32;
                    }
                }
            }
        }
    }
}

/// Direction of a ray, and how far it is known to be above the ground.
#[derive(Clone, Copy, Default)]
struct Course {
    /// Its horizontal direction, a unit vector, and its rise per horizontal meter.
    direction: [f64; 2],
    rise: f64,
    /// Ray parameter per horizontal meter; 0 for a vertical ray.
    shares: f64,
    /// Horizontal distance up to which it is above the ground, m.
    clear: f64,
}

impl Course {
    #[inline(always)]
    fn of(ray: &Vector3<f64>) -> Self {
        let length = ray.x.mul_add(ray.x, ray.y * ray.y).sqrt();
        let shares = if length > 1e-9 { 1.0 / length } else { 0.0 };
        Self { direction: [ray.x * shares, ray.y * shares], rise: ray.z * shares, shares, clear: 0.0 }
    }

    /// The parameter of this ray up to which it is above the ground because `lower` is. It is above `lower` at the same
    /// horizontal distance; the ground rises at most by the steepest slope times the sideways distance between the two.
    #[inline(always)]
    fn clear_share(&self, lower: &Self, steepest: f64) -> f64 {
        let [x, y] = [self.direction[0] - lower.direction[0], self.direction[1] - lower.direction[1]];
        let (above, aside) = (self.rise - lower.rise, steepest * steepest * x.mul_add(x, y * y));
        let is_above = above > 0.0 && above * above > aside && lower.shares > 0.0;
        if is_above { lower.clear * self.shares } else { 0.0 }
    }
}

/// Intersections of rays with level ground.
#[inline(always)]
fn level<const N: usize>(eye: &Vector3<f64>, rays: &Rays<N>) -> [f64; N] {
    each(
        #[inline(always)]
        |i| match rays.direction[2][i] {
            _ if eye.z < 0.0 => 0.0,
            z if z < 0.0 => -eye.z / z,
            _ => f64::INFINITY,
        },
    )
}

/// The parameter of `ray` at which it enters a sphere whose center is at −`arm` from its origin; `outside` is the
/// squared length of the arm minus the squared radius, positive.
#[inline(always)]
fn entry(arm: &Vector3<f64>, ray: &Vector3<f64>, outside: f64) -> Option<f64> {
    let towards = -arm.dot(ray);
    let length = ray.norm_squared();
    let root = towards * towards - length * outside;
    if towards > 0.0 && outside > 0.0 && root >= 0.0 { Some((towards - root.sqrt()) / length) } else { None }
}
