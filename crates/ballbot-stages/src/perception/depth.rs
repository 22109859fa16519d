//! The depth camera: distances to ground and ball along the optical axis of a camera on the body.

use super::instrument::{Instrument, Random, Range, Reads, Sample};
use super::rays::{require_outside_ball, to_ground, to_obstacle, to_sphere};
use ballbot_base::error::{Result, check};
use ballbot_base::fields;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::run_one;
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::terrain::{PLACES, Rays, Terrain};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Block of random numbers of the mounting and of frozen pictures, and first blocks of noise and holes: four pixels
/// share a block.
const MOUNTING: u32 = 0;
const FREEZE: u32 = 1;
const NOISE: u32 = 1 << 20;
const HOLES: u32 = 2 << 20;

fields! {
    /// A camera on the body that reads distances along its optical axis. SI units and radians.
    pub struct DepthOptions {
        /// Columns and rows of pixels, whole numbers.
        pub size: [f64; 2] = [32.0, 24.0], "", Limit::from(1.0).to(256.0);
        /// Angle between the upper and the lower edge of the picture; pixels are square.
        pub field_of_view: f64 = 1.0, "rad", Limit::above(0.0).below(PI);
        /// The camera in the body frame, whose origin is the ball's center; outside of the ball.
        pub position: [f64; 3] = [0.2, 0.0, 0.3], "m", Limit::from(-10.0).to(10.0);
        /// Angle of the optical axis below the horizontal plane of the body.
        pub pitch: f64 = 0.6, "rad", Limit::from(-FRAC_PI_2).to(FRAC_PI_2);
        /// Angle of the optical axis from body x towards body y.
        pub yaw: f64 = 0.0, "rad", Limit::from(-PI).to(PI);
        /// Smaller depths read as this value.
        pub near: f64 = 0.05, "m", Limit::from(1e-3).to(100.0);
        /// Larger depths, and pixels without a surface, read as this value.
        pub far: f64 = 3.0, "m", Limit::from(1e-2).to(100.0);
        /// Pictures in a second, held in between; 0: one at each control step, which is also the maximum.
        pub rate: f64 = 25.0, "Hz", Limit::from(0.0).to(1e6);
        /// Age of a picture when it is read, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::from(0.0).to(100.0);
        /// Standard deviation of the noise of a pixel: the first number, m, and the second, 1/m, times its squared depth.
        pub noise: [f64; 2] = [0.0; 2], "", Limit::from(0.0).to(10.0);
        /// Fraction of the pixels that are holes, which read as `far`.
        pub dropout: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Fraction of the pictures that are dropped; the previous picture stays.
        pub freeze: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Standard deviation of the camera's mounting error about each body axis, sampled for each episode.
        pub misalignment: f64 = 0.0, "rad", Limit::from(0.0).to(0.5);
    }
}

impl OptionTable for DepthOptions {
    const NAME: &'static str = "depth";

    fn check_relations(&self) -> Result<()> {
        check("near", self.near, format_args!("below far = {} m", self.far), |near| near < self.far).map(drop)
    }
}

impl Instrument for DepthOptions {
    const TITLE: &'static str = "Depth camera";
    const ABOUT: &'static str = "\
A pinhole camera on the body. A pixel reads the distance along the optical axis (not along its ray) of the first object
that the ray through its center hits: the ground, an obstacle or the robot's own ball. Anything nearer than `near` reads as `near`;
anything farther than `far`, and the sky, as `far`. Beyond the edges of a terrain there is nothing. The robot's body and
wheels are not in the image. A reading has the rows of the picture from the top, each from the left. Scaled observations
are fractions of `far`.";

    fn lengths(&self) -> (&'static str, &[f64]) {
        ("size", &self.size)
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, self.latency]
    }

    fn range(&self) -> Range {
        Range { low: 0.0, high: self.far, typical: self.far }
    }

    fn check_robot(&self, params: &Params) -> Result<()> {
        require_outside_ball("depth.position", &self.position, params)
    }

    fn reader(&self) -> Box<dyn Reads> {
        Box::new(Depth::new(self))
    }
}

/// A depth camera.
#[derive(Clone, Debug)]
struct Depth {
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
    fn new(options: &DepthOptions) -> Self {
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
    fn constants(&self, random: &Random) -> [f64; 3] {
        if self.options.misalignment == 0.0 {
            return [0.0; 3];
        }
        let [x, y, z, _] = random.normals(MOUNTING);
        [x, y, z].map(|angle| angle * self.options.misalignment)
    }

    /// Writes the depth of each pixel, m, rows from the top, each from the left.
    fn read(&self, sample: &Sample, out: &mut [f32]) {
        let Sample { view, terrain, constants: mounting, random, is_first } = *sample;
        let DepthOptions { near, far, freeze, .. } = self.options;
        if freeze > 0.0 && !is_first && random.units(FREEZE)[0] < freeze {
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
                            let limit = match to_sphere(&arm, &ray, outside) {
                                Some(share) if share < far => share,
                                _ => far,
                            };
                            rays.limit[i] = to_obstacle(terrain, &eye, &ray, limit);
                        }
                        let met = to_ground(terrain, &eye, &rays);
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
        self.add_errors(random, out);
    }
}

impl Depth {
    fn add_errors(&self, random: &Random, out: &mut [f32]) {
        let DepthOptions { near, far, noise: [constant, growing], dropout, .. } = self.options;
        if constant > 0.0 || growing > 0.0 {
            for (block, pixels) in out.chunks_mut(4).enumerate() {
                for (pixel, normal) in pixels.iter_mut().zip(random.normals(NOISE + block as u32)) {
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
                for (pixel, unit) in pixels.iter_mut().zip(random.units(HOLES + block as u32)) {
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
