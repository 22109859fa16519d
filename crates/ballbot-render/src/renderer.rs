//! The renderer: one ray or more per pixel, in tiles, on all cores.

use super::camera::{Camera, View};
use super::color::{Color, Display, Paint};
use super::scene::{Label, Link, Part, Placed, Scene};
use super::shading::Light;
use super::shape::Shape;
use ballbot_base::error::{Error, Result, check, finite};
use ballbot_base::interrupt::{Stop, Watch};
use ballbot_base::state::State;
use ballbot_base::terrain::Terrain;
use ballbot_base::thread_pool::{self, WorkerThreads, thread_count};
use nalgebra::{UnitQuaternion, Vector3};
use std::sync::{Mutex, PoisonError};

/// Edge of a tile, pixels. Parts outside the cone of a tile are skipped for all its pixels.
const TILE: usize = 16;
/// Largest coordinate of the ends of an arrow, m.
const MAX_ARROW_COORDINATE: f64 = 1e6;
/// Largest width and height of a picture, pixels.
const MAX_EDGE: usize = 8192;

/// An arrow in the inertial frame: a force, a push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrow {
    /// Tail, m.
    pub from: Vector3<f64>,
    /// Tip, m.
    pub to: Vector3<f64>,
    /// Linear color.
    pub color: Color,
}

/// Output slices of [`Renderer::render`], row by row from the top: `height` × `width` × channels.
#[derive(Default)]
pub struct Picture<'a> {
    /// Red, green and blue of each pixel, sRGB bytes.
    pub rgb: Option<&'a mut [u8]>,
    /// Distance along the camera's axis, m; infinite in the sky.
    pub depth: Option<&'a mut [f32]>,
    /// [`Label`] of each pixel.
    pub labels: Option<&'a mut [u8]>,
}

/// A scene, a camera and a picture size.
pub struct Renderer {
    scene: Scene,
    width: usize,
    height: usize,
    samples: usize,
    camera: Camera,
    display: Display,
    helpers: Mutex<WorkerThreads>,
}

impl Renderer {
    /// A renderer of pictures of `width` by `height` pixels, with 1, 2 or 4 color samples per pixel, on all cores.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the number and its limit.
    pub fn new(scene: Scene, width: usize, height: usize, samples: usize, camera: Camera) -> Result<Self> {
        for (name, edge) in [("width", width), ("height", height)] {
            check(name, edge as f64, format_args!("between 1 and {MAX_EDGE} pixels"), |_| {
                (1..=MAX_EDGE).contains(&edge)
            })?;
        }
        check("samples", samples as f64, "1, 2 or 4 a pixel", |_| matches!(samples, 1 | 2 | 4))?;
        camera.validate()?;
        let helpers = Mutex::new(WorkerThreads::new(thread_count(None)? - 1));
        Ok(Self { scene, width, height, samples, camera, display: Display::new(), helpers })
    }

    /// The same renderer on `num_threads` threads, including the calling thread. Pictures do not depend on the number.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for zero threads.
    pub fn with_threads(self, num_threads: usize) -> Result<Self> {
        let helpers = Mutex::new(WorkerThreads::new(thread_count(Some(num_threads))? - 1));
        Ok(Self { helpers, ..self })
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The ground; `None` for the plane z = 0.
    pub fn terrain(&self) -> Option<&Terrain> {
        self.scene.terrain.as_deref()
    }

    /// Camera of the next picture.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Replaces the camera.
    ///
    /// # Errors
    /// As [`Camera::validate`].
    pub fn set_camera(&mut self, camera: Camera) -> Result<()> {
        camera.validate()?;
        self.camera = camera;
        Ok(())
    }

    /// Renders a picture. Depth and labels are taken at the center of each pixel.
    ///
    /// # Errors
    /// [`Error::Length`] for a slice of the wrong length, [`Error::OutOfRange`] for a state or an arrow that is
    /// not finite, [`Error::Interrupted`] in [`ballbot_base::stoppable`].
    pub fn render(&self, state: &State, arrows: &[Arrow], picture: Picture<'_>) -> Result<()> {
        state.validate()?;
        let mut arrow_parts = Vec::with_capacity(2 * arrows.len());
        for arrow in arrows {
            arrow.parts(&mut arrow_parts)?;
        }
        let pixels = self.width * self.height;
        let lengths = [
            ("rgb", picture.rgb.as_ref().map(|s| s.len()), 3 * pixels),
            ("depth", picture.depth.as_ref().map(|s| s.len()), pixels),
            ("labels", picture.labels.as_ref().map(|s| s.len()), pixels),
        ];
        for (name, found, expected) in lengths {
            if let Some(found) = found.filter(|&found| found != expected) {
                return Err(Error::Length { name: name.into(), found, expected });
            }
        }
        let parts = self.scene.placed(state, &arrow_parts);
        let view = self.camera.placed(&state.ball_position, self.scene.terrain.as_deref(), self.width, self.height);
        let frame = Frame { parts: &parts, light: Light::new(&parts), view, renderer: self };
        // Each band of tiles writes its own rows of each slice.
        let band = TILE * self.width;
        let bands = self.height.div_ceil(TILE);
        let rgb = split(picture.rgb, 3 * band, bands);
        let depth = split(picture.depth, band, bands);
        let labels = split(picture.labels, band, bands);
        let bands = Mutex::new(rgb.into_iter().zip(depth).zip(labels).enumerate());
        Watch::new().check()?;
        let stop = Stop::default();
        let work = || {
            let mut watch = Watch::new();
            let next = || bands.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((i, ((rgb, depth), labels))) = next() {
                frame.band(i * TILE, rgb, depth, labels, || stop.look(&mut watch));
            }
        };
        let helpers = self.helpers.lock().unwrap_or_else(PoisonError::into_inner).pool()?;
        match helpers {
            None => work(),
            Some(pool) => thread_pool::share(&pool, work),
        }
        if stop.is_set() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Chunks of a slice; `None` repeated `chunks` times without a slice.
fn split<T>(slice: Option<&mut [T]>, chunk: usize, chunks: usize) -> Vec<Option<&mut [T]>> {
    match slice {
        Some(slice) => slice.chunks_mut(chunk).map(Some).collect(),
        None => (0..chunks).map(|_| None).collect(),
    }
}

impl Arrow {
    fn parts(&self, parts: &mut Vec<Part>) -> Result<()> {
        finite("arrow", self.color.as_slice())?;
        for value in self.from.iter().chain(&self.to) {
            check("arrow", *value, format_args!("within ±{MAX_ARROW_COORDINATE} m"), |v| {
                v.abs() <= MAX_ARROW_COORDINATE
            })?;
        }
        let along = self.to - self.from;
        let length = along.norm();
        if length < 1e-6 {
            return Ok(());
        }
        let attitude = UnitQuaternion::rotation_between(&Vector3::z(), &along)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let head = (0.35 * length).min(0.05);
        let mut part = |from: f64, to: f64, shape: Shape| {
            let position = self.from + along * (0.5 * (from + to) / length);
            parts.push(Part { link: Link::Inertial, position, attitude, shape, paint: Paint::Plain(self.color) });
        };
        part(0.0, length - head, Shape::Cylinder { radius: 0.2 * head, half_length: 0.5 * (length - head) });
        part(length - head, length, Shape::Cone { radius: 0.5 * head, half_length: 0.5 * head });
        Ok(())
    }
}

/// Positions of the samples in a pixel. No two share a row or a column.
const SAMPLES: [&[(f64, f64)]; 3] =
    [&[(0.5, 0.5)], &[(0.25, 0.75), (0.75, 0.25)], &[(0.375, 0.125), (0.875, 0.375), (0.625, 0.875), (0.125, 0.625)]];

/// One picture during rendering.
struct Frame<'a> {
    parts: &'a [Placed<'a>],
    light: Light,
    view: View,
    renderer: &'a Renderer,
}

/// Color, depth and label of the first hit of a ray.
struct PixelSample {
    color: Color,
    depth: f64,
    label: Label,
}

impl Frame<'_> {
    /// Renders the tiles whose upper row is `top`, until it is stopped.
    fn band(
        &self,
        top: usize,
        mut rgb: Option<&mut [u8]>,
        mut depth: Option<&mut [f32]>,
        mut labels: Option<&mut [u8]>,
        mut stopped: impl FnMut() -> bool,
    ) {
        let (width, height) = self.renderer.size();
        let rows = TILE.min(height - top);
        let mut near = Vec::with_capacity(self.parts.len());
        for left in (0..width).step_by(TILE) {
            if stopped() {
                return;
            }
            let columns = TILE.min(width - left);
            self.parts_in_tile(left, top, columns, rows, &mut near);
            for row in 0..rows {
                for column in left..left + columns {
                    let (x, y) = (column as f64, (top + row) as f64);
                    let at = row * width + column;
                    if let Some(rgb) = &mut rgb {
                        let offsets = SAMPLES[self.renderer.samples.trailing_zeros() as usize];
                        let sum = offsets.iter().fold(Color::zeros(), |sum, (dx, dy)| {
                            sum + self.trace(&self.view.ray(x + dx, y + dy), &near, true).color
                        });
                        let bytes = self.renderer.display.bytes(&(sum / offsets.len() as f64));
                        rgb[3 * at..3 * at + 3].copy_from_slice(&bytes);
                    }
                    if depth.is_some() || labels.is_some() {
                        let sample = self.trace(&self.view.ray(x + 0.5, y + 0.5), &near, false);
                        if let Some(depth) = &mut depth {
                            depth[at] = sample.depth as f32;
                        }
                        if let Some(labels) = &mut labels {
                            labels[at] = sample.label as u8;
                        }
                    }
                }
            }
        }
    }

    /// Collects the parts whose bounding sphere intersects the cone of a tile.
    fn parts_in_tile(&self, left: usize, top: usize, columns: usize, rows: usize, near: &mut Vec<usize>) {
        let (x, y) = (left as f64 + 0.5 * columns as f64, top as f64 + 0.5 * rows as f64);
        let axis = self.view.ray(x, y);
        let corners = [(left, top), (left + columns, top), (left, top + rows), (left + columns, top + rows)];
        let axis = axis.normalize();
        // The margin keeps parts that touch the cone within rounding.
        let spread =
            1e-9 + corners.iter().map(|&(x, y)| axis.angle(&self.view.ray(x as f64, y as f64))).fold(0.0, f64::max);
        near.clear();
        for (i, part) in self.parts.iter().enumerate() {
            let to = part.center - self.view.position;
            let distance = to.norm();
            let angle = if distance <= part.radius { 0.0 } else { axis.angle(&to) - (part.radius / distance).asin() };
            if angle <= spread {
                near.push(i);
            }
        }
    }

    /// Depth of the floor along a ray, infinite if it misses, and the normal there.
    fn floor(&self, direction: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let origin = &self.view.position;
        match &self.renderer.scene.terrain {
            Some(terrain) => terrain.cast(origin, direction, f64::INFINITY).unwrap_or((f64::INFINITY, Vector3::z())),
            None if direction.z < 0.0 => (-origin.z / direction.z, Vector3::z()),
            None => (f64::INFINITY, Vector3::z()),
        }
    }

    fn trace(&self, direction: &Vector3<f64>, near: &[usize], shaded: bool) -> PixelSample {
        let origin = &self.view.position;
        let length_squared = direction.norm_squared();
        let mut first = None;
        let (mut limit, floor_normal) = self.floor(direction);
        let obstacle = self
            .renderer
            .scene
            .terrain
            .as_ref()
            .and_then(|terrain| terrain.obstacles().cast((*origin).into(), (*direction).into(), limit));
        if let Some((share, _)) = obstacle {
            limit = share;
        }
        for &i in near {
            let part = &self.parts[i];
            if part.near(origin, direction, length_squared)
                && let Some(hit) = part.cast(origin, direction, limit)
            {
                limit = hit.distance;
                first = Some((part, hit));
            }
        }
        // Rays have depth 1, so the distance along a ray is the depth.
        let (label, color): (_, &dyn Fn() -> Color) = match &first {
            Some((part, hit)) => (part.label, &|| {
                let point = origin + direction * hit.distance;
                self.light.surface(&part.color(&point), &point, &hit.normal, direction, self.parts)
            }),
            None if obstacle.is_some() => (Label::Obstacle, &|| {
                let normal = obstacle.map_or(Vector3::z(), |(_, normal)| normal.into());
                self.light.obstacle(&(origin + direction * limit), &normal, direction, limit, self.parts)
            }),
            None if limit.is_finite() => (Label::Floor, &|| {
                let point = origin + direction * limit;
                self.light.floor(&point, &floor_normal, direction, limit, &self.view, self.parts)
            }),
            None => (Label::Sky, &|| self.light.sky(direction)),
        };
        PixelSample { color: if shaded { color() } else { Color::zeros() }, depth: limit, label }
    }
}
