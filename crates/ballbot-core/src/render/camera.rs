//! Where the picture is taken from.

use crate::error::{Result, check, finite};
use nalgebra::Vector3;
use std::f64::consts::PI;

/// A pinhole camera. The inertial frame's z is up in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it looks: a point of the inertial frame or, if it follows, relative to the ball's point of contact, m.
    pub target: Vector3<f64>,
    /// From the target, m.
    pub distance: f64,
    /// Direction of the camera from the target, counter-clockwise from x seen from above, rad.
    pub azimuth: f64,
    /// Height of that direction above the horizontal, rad.
    pub elevation: f64,
    /// Vertical field of view, rad.
    pub field_of_view: f64,
    /// Whether it moves with the ball along the floor.
    pub follows: bool,
}

impl Camera {
    /// A camera that follows a robot of a height (m), which fills most of the picture.
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

    /// Checks that it is a camera.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] naming the number and its limit.
    pub fn validate(&self) -> Result<()> {
        finite("camera target", self.target.as_slice())?;
        check("camera distance", self.distance, "between 0.01 and 1000 m", |d| (0.01..=1e3).contains(&d))?;
        check("camera azimuth", self.azimuth, "finite", f64::is_finite)?;
        check("camera elevation", self.elevation, "between -1.57 and 1.57 rad", |e| e.abs() <= 1.57)?;
        check("camera field of view", self.field_of_view, "between 0.01 and 3 rad", |f| (0.01..=3.0).contains(&f))?;
        let height = self.target.z + self.distance * self.elevation.sin();
        check("camera height", height, "above 0 m, the floor", |h| h > 0.0)?;
        Ok(())
    }

    /// The camera where it stands for a ball at `ball`.
    pub(super) fn placed(&self, ball: &Vector3<f64>, width: usize, height: usize) -> View {
        let follow = if self.follows { Vector3::new(ball.x, ball.y, 0.0) } else { Vector3::zeros() };
        let (sin, cos) = self.elevation.sin_cos();
        let out = Vector3::new(cos * self.azimuth.cos(), cos * self.azimuth.sin(), sin);
        let right = Vector3::new((self.azimuth + PI / 2.0).cos(), (self.azimuth + PI / 2.0).sin(), 0.0);
        let pixel = 2.0 * (0.5 * self.field_of_view).tan() / height as f64;
        View {
            position: self.target + follow + out * self.distance,
            forward: -out,
            right: right * pixel,
            down: -out.cross(&right) * pixel,
            center: (0.5 * width as f64, 0.5 * height as f64),
            pixel,
        }
    }
}

/// A camera in place: the ray of each pixel.
pub(super) struct View {
    pub position: Vector3<f64>,
    /// Unit length; a ray's component along it is 1.
    pub forward: Vector3<f64>,
    /// From a pixel to its right neighbor, and to the one below, at unit depth.
    pub right: Vector3<f64>,
    pub down: Vector3<f64>,
    center: (f64, f64),
    /// Size of a pixel at unit depth.
    pub pixel: f64,
}

impl View {
    /// Direction of the ray through a point of the picture, in pixels from its upper left corner; depth 1 long.
    pub fn ray(&self, x: f64, y: f64) -> Vector3<f64> {
        self.forward + self.right * (x - self.center.0) + self.down * (y - self.center.1)
    }
}
