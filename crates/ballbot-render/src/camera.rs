//! The camera: position, direction and field of view.

use ballbot_base::error::{Result, check};
use ballbot_base::terrain::Terrain;
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Minimum height of the camera above uneven ground, m.
const CLEARANCE: f64 = 0.05;

/// Largest coordinate of a target, m.
const MAX_COORDINATE: f64 = 1e6;

/// A pinhole camera. The z axis of the inertial frame is up in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Point at the center of the picture, m: in the inertial frame or, if the camera follows, from the contact point
    /// of the ball with the floor.
    pub target: Vector3<f64>,
    /// Distance from the target, m.
    pub distance: f64,
    /// Direction of the camera from the target, counter-clockwise from x seen from above, rad.
    pub azimuth: f64,
    /// Angle of that direction above the horizontal, rad.
    pub elevation: f64,
    /// Vertical field of view, rad.
    pub field_of_view: f64,
    /// Whether the camera moves with the ball along the floor.
    pub follows: bool,
}

impl Camera {
    /// A camera that follows a robot of `height` (m). The robot fills most of the picture.
    pub fn following(height: f64) -> Self {
        let field_of_view: f64 = 0.6;
        Self {
            target: Vector3::new(0.0, 0.0, 0.46 * height),
            distance: 0.75 * height / (0.5 * field_of_view).tan(),
            azimuth: -1.1,
            elevation: 0.32,
            field_of_view,
            follows: true,
        }
    }

    /// Checks ranges, and that the camera is above the floor.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the number and its limit.
    pub fn validate(&self) -> Result<()> {
        for (i, &coordinate) in self.target.iter().enumerate() {
            let limit = format_args!("within ±{MAX_COORDINATE} m");
            check(format_args!("camera target[{i}]"), coordinate, limit, |c| c.abs() <= MAX_COORDINATE)?;
        }
        check("camera distance", self.distance, "between 0.01 and 1000 m", |d| (0.01..=1e3).contains(&d))?;
        check("camera azimuth", self.azimuth, "within ±1000 rad", |a| a.abs() <= 1e3)?;
        check("camera elevation", self.elevation, "between -1.57 and 1.57 rad", |e| e.abs() <= 1.57)?;
        check("camera field of view", self.field_of_view, "between 0.01 and 3 rad", |f| (0.01..=3.0).contains(&f))?;
        let height = self.target.z + self.distance * self.elevation.sin();
        check("camera height", height, "above 0 m, the floor", |h| h > 0.0)?;
        Ok(())
    }

    /// Rays of the camera for a ball at `ball`, on a terrain or the plane z = 0. It stays above the ground.
    pub(super) fn placed(&self, ball: &Vector3<f64>, terrain: Option<&Terrain>, width: usize, height: usize) -> View {
        let ground = |place: &Vector3<f64>| terrain.map_or(0.0, |terrain| terrain.height(place.x, place.y));
        let follow = if self.follows { Vector3::new(ball.x, ball.y, ground(ball)) } else { Vector3::zeros() };
        let (sin, cos) = self.elevation.sin_cos();
        let out = Vector3::new(cos * self.azimuth.cos(), cos * self.azimuth.sin(), sin);
        let right = Vector3::new((self.azimuth + PI / 2.0).cos(), (self.azimuth + PI / 2.0).sin(), 0.0);
        let pixel = 2.0 * (0.5 * self.field_of_view).tan() / height as f64;
        let mut position = self.target + follow + out * self.distance;
        if terrain.is_some() {
            position.z = position.z.max(ground(&position) + CLEARANCE);
        }
        View {
            position,
            forward: -out,
            right: right * pixel,
            down: -out.cross(&right) * pixel,
            center: (0.5 * width as f64, 0.5 * height as f64),
            pixel,
        }
    }
}

/// The rays of all pixels.
pub(super) struct View {
    pub position: Vector3<f64>,
    /// Viewing direction, unit length; the component of each ray along it is 1.
    pub forward: Vector3<f64>,
    /// Step from a pixel to its right neighbor at unit depth, m.
    pub right: Vector3<f64>,
    /// Step from a pixel to the pixel below at unit depth, m.
    pub down: Vector3<f64>,
    center: (f64, f64),
    /// Size of a pixel at unit depth, m.
    pub pixel: f64,
}

impl View {
    /// Direction of the ray through a point of the picture (pixels from the upper left corner), of depth 1.
    pub fn ray(&self, x: f64, y: f64) -> Vector3<f64> {
        self.forward + self.right * (x - self.center.0) + self.down * (y - self.center.1)
    }
}
