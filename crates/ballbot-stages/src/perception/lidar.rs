//! The lidar: ranges to ground and ball along the beams of a ring.

use super::instrument::{Instrument, Random, Range, Reads, Sample};
use super::rays::{require_outside_ball, to_ground, to_obstacle, to_sphere};
use ballbot_base::error::{Result, check};
use ballbot_base::fields;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, run_one};
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::terrain::{PLACES, Rays, each};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Block of random numbers of the mounting, and first blocks of noise and dropout: four beams share a block.
const MOUNTING: u32 = 0;
const NOISE: u32 = 1 << 20;
const DROPOUT: u32 = 2 << 20;

fields! {
    /// A range finder with a ring of beams. SI units and radians.
    pub struct LidarOptions {
        /// Count of beams, a whole number.
        pub beams: f64 = 72.0, "", Limit::from(1.0).to(4096.0);
        /// Angle that the beams divide evenly, centered on the axis ahead; 2 pi is a whole turn.
        pub field_of_view: f64 = TAU, "rad", Limit::above(0.0).to(TAU);
        /// The lidar in the body frame, whose origin is the ball's center; outside of the ball.
        pub position: [f64; 3] = [0.0, 0.0, 0.4], "m", Limit::from(-10.0).to(10.0);
        /// Angle of the ring's plane below the horizontal plane of the body, ahead of it.
        pub pitch: f64 = 0.0, "rad", Limit::from(-FRAC_PI_2).to(FRAC_PI_2);
        /// Angle of each beam below the ring's plane: the beams form a cone.
        pub depression: f64 = 0.2, "rad", Limit::from(-FRAC_PI_2).to(FRAC_PI_2);
        /// 1: a gimbal keeps the lidar level and turns it with the heading; 0: it is fixed to the body.
        pub stabilized: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Smaller ranges read as this value.
        pub min_range: f64 = 0.05, "m", Limit::from(1e-3).to(100.0);
        /// Larger ranges, and beams that hit nothing, read as this value.
        pub max_range: f64 = 5.0, "m", Limit::from(1e-2).to(100.0);
        /// Turns in a second, held in between; 0: one at each control step, which is also the maximum.
        pub rate: f64 = 10.0, "Hz", Limit::from(0.0).to(1e6);
        /// Age of a turn when it is read, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::from(0.0).to(100.0);
        /// Standard deviation of the noise of a range.
        pub noise: f64 = 0.0, "m", Limit::from(0.0).to(10.0);
        /// Fraction of the beams without an echo, which read as `max_range`.
        pub dropout: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Standard deviation of the lidar's mounting error about each axis, sampled for each episode.
        pub misalignment: f64 = 0.0, "rad", Limit::from(0.0).to(0.5);
    }
}

impl OptionTable for LidarOptions {
    const NAME: &'static str = "lidar";

    fn check_relations(&self) -> Result<()> {
        check("stabilized", self.stabilized, "0 or 1", |flag| flag == 0.0 || flag == 1.0)?;
        let limit = format_args!("below max_range = {} m", self.max_range);
        check("min_range", self.min_range, limit, |range| range < self.max_range).map(drop)
    }
}

impl Instrument for LidarOptions {
    const TITLE: &'static str = "Lidar";
    const ABOUT: &'static str = "\
A range finder that turns about an axis of the body, or, with `stabilized`, about the vertical. A reading has a number for
each beam: the distance along the beam to the first object that it hits, the ground, an obstacle or the robot's own ball. Beam k of n,
from 0 on, is at `((k + 1/2) / n - 1/2) * field_of_view` from the axis ahead towards the left. Anything nearer than `min_range` reads as `min_range`; anything
farther than `max_range`, and nothing, as `max_range`. Beyond the edges of a terrain there is nothing. The robot's body
and wheels are not hit. All beams of a turn are taken at the same time. Scaled observations are fractions of `max_range`.";

    fn lengths(&self) -> (&'static str, &[f64]) {
        ("beams", std::slice::from_ref(&self.beams))
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, self.latency]
    }

    fn range(&self) -> Range {
        Range { low: 0.0, high: self.max_range, typical: self.max_range }
    }

    fn check_robot(&self, params: &Params) -> Result<()> {
        require_outside_ball("lidar.position", &self.position, params)
    }

    fn reader(&self) -> Box<dyn Reads> {
        Box::new(Lidar::new(self))
    }
}

/// A lidar.
#[derive(Clone, Debug)]
struct Lidar {
    options: LidarOptions,
    /// Unit vectors along the beams, in the frame of the body or of the heading: components of eight at a time; the
    /// last places may be empty.
    beams: Vec<[[f64; PLACES]; 3]>,
}

impl Lidar {
    fn new(options: &LidarOptions) -> Self {
        let LidarOptions { beams, field_of_view, pitch, depression, .. } = *options;
        let tilt = Rotation3::from_axis_angle(&Vector3::y_axis(), pitch);
        let beam = |index: usize| {
            let (sin, cos) = (((index as f64 + 0.5) / beams - 0.5) * field_of_view).sin_cos();
            tilt * Vector3::new(depression.cos() * cos, depression.cos() * sin, -depression.sin())
        };
        let part = |first: usize| [0, 1, 2].map(|axis| each(|i| beam(first + i)[axis]));
        Self { options: options.clone(), beams: (0..beams as usize).step_by(PLACES).map(part).collect() }
    }
}

impl Reads for Lidar {
    /// The rotation vector of the mounting, rad.
    fn constants(&self, random: &Random) -> [f64; 3] {
        let [x, y, z, _] = random.normals(MOUNTING);
        [x, y, z].map(|angle| angle * self.options.misalignment)
    }

    fn read(&self, sample: &Sample, out: &mut [f32]) {
        let Sample { view, terrain, constants: mounting, random, .. } = *sample;
        let LidarOptions { position, stabilized, min_range, max_range, .. } = self.options;
        let attitude = view.rotation();
        let arm = attitude * Vector3::from(position);
        let eye = Vector3::from(view.ball) + arm;
        let outside = arm.norm_squared() - view.ball_radius * view.ball_radius;
        let axes = if stabilized == 0.0 {
            attitude
        } else {
            let Heading { cos, sin } = Heading::new(view.quaternion());
            Rotation3::from_axis_angle(&Vector3::z_axis(), sin.atan2(cos))
        };
        let axes = axes * Rotation3::from_scaled_axis(Vector3::from(*mounting));
        run_one(
            #[inline(always)]
            || {
                for (ranges, [x, y, z]) in out.chunks_mut(PLACES).zip(&self.beams) {
                    let mut rays =
                        Rays { direction: [[0.0; PLACES]; 3], from: [0.0; PLACES], limit: [max_range; PLACES] };
                    for i in 0..PLACES {
                        let ray = axes * Vector3::new(x[i], y[i], z[i]);
                        rays.direction[0][i] = ray.x;
                        rays.direction[1][i] = ray.y;
                        rays.direction[2][i] = ray.z;
                        if let Some(range) = to_sphere(&arm, &ray, outside) {
                            rays.limit[i] = range.min(max_range);
                        }
                        rays.limit[i] = to_obstacle(terrain, &eye, &ray, rays.limit[i]);
                    }
                    let hit = to_ground(terrain, &eye, &rays);
                    for (i, range) in ranges.iter_mut().enumerate() {
                        *range = hit[i].min(rays.limit[i]).max(min_range) as f32;
                    }
                }
            },
        );
        self.add_errors(random, out);
    }
}

impl Lidar {
    fn add_errors(&self, random: &Random, out: &mut [f32]) {
        let LidarOptions { min_range, max_range, noise, dropout, .. } = self.options;
        for (block, ranges) in out.chunks_mut(4).enumerate() {
            if noise > 0.0 {
                for (range, normal) in ranges.iter_mut().zip(random.normals(NOISE + block as u32)) {
                    let exact = f64::from(*range);
                    // Nothing is measured beyond this.
                    if exact < max_range {
                        *range = noise.mul_add(normal, exact).clamp(min_range, max_range) as f32;
                    }
                }
            }
            if dropout > 0.0 {
                for (range, unit) in ranges.iter_mut().zip(random.units(DROPOUT + block as u32)) {
                    if unit < dropout {
                        *range = max_range as f32;
                    }
                }
            }
        }
    }
}
