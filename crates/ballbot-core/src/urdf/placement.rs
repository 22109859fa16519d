//! Placement of three wheels on a ball: height of the ball center, zenith and azimuths.

use super::checked::{Checked, TOLERANCE};
use super::wheel::Wheel;
use nalgebra::{Point3, Vector3};
use std::f64::consts::TAU;

/// Placement of three wheels on one ball.
pub(super) struct Placement {
    /// z coordinate of the ball center in the root frame, m.
    pub ball_height: f64,
    /// Zenith α of the contacts, rad.
    pub zenith: f64,
    /// Azimuth β of each contact, in [0, 2π), rad.
    pub azimuths: [f64; 3],
}

impl Placement {
    /// Placement on a ball of radius `ball_radius`, centered on the mast, that all `wheels` touch from above.
    pub fn solve(wheels: &[Wheel; 3], ball_radius: f64) -> Checked<Self> {
        let reach = ball_radius + wheels[0].radius;
        let off_mast = wheels.each_ref().map(|w| w.center.x.hypot(w.center.y));
        let mean_off_mast = off_mast.iter().sum::<f64>() / 3.0;
        if !(0.0..reach).contains(&mean_off_mast) {
            return Err(format!(
                "the wheels are {mean_off_mast} m off the mast: to touch the ball from above they must be closer than \
                 ball radius + wheel radius = {reach} m"
            ));
        }
        let above_ball = (reach - mean_off_mast).sqrt() * (reach + mean_off_mast).sqrt();
        let ball_height = wheels.iter().map(|w| w.center.z).sum::<f64>() / 3.0 - above_ball;
        let ball_center = Point3::new(0.0, 0.0, ball_height);
        for (wheel, off_mast) in wheels.iter().zip(off_mast) {
            let gap = (wheel.center - ball_center).norm() - reach;
            let uneven = off_mast - mean_off_mast;
            if !(-TOLERANCE..=TOLERANCE).contains(&gap) || !(-TOLERANCE..=TOLERANCE).contains(&uneven) {
                return Err(format!(
                    "the wheels do not all touch one ball centered on the mast: {} is {off_mast} m off the mast, the \
                     mean is {mean_off_mast} m, and {gap:.3e} m off the ball that fits best: \
                     at most {TOLERANCE:e} m each",
                    wheel.what
                ));
            }
        }
        let zenith = mean_off_mast.atan2(above_ball);
        let azimuths = wheels.each_ref().map(|w| azimuth(&w.center));
        for (wheel, azimuth) in wheels.iter().zip(azimuths) {
            check_axle(wheel, zenith, azimuth)?;
        }
        Ok(Self { ball_height, zenith, azimuths })
    }
}

/// Azimuth of a point in [0, 2π), rad. Rounding errors below zero are kept.
fn azimuth(p: &Point3<f64>) -> f64 {
    let angle = p.y.atan2(p.x);
    if angle < -TOLERANCE { angle + TAU } else { angle }
}

/// Refuses an axle that is not −u = −p × d, with p towards the contact and d the drive direction.
fn check_axle(wheel: &Wheel, zenith: f64, azimuth: f64) -> Checked<()> {
    let Wheel { what, axle, .. } = wheel;
    let (sin_azimuth, cos_azimuth) = azimuth.sin_cos();
    let contact = Vector3::new(zenith.sin() * cos_azimuth, zenith.sin() * sin_azimuth, zenith.cos());
    let drive = Vector3::new(-sin_azimuth, cos_azimuth, 0.0);
    let expected = drive.cross(&contact);
    if (axle - expected).norm() <= TOLERANCE {
        return Ok(());
    }
    let expected = format!("expected ({:.6}, {:.6}, {:.6})", expected.x, expected.y, expected.z);
    let (along_contact, along_drive) = (axle.dot(&contact), axle.dot(&drive));
    Err(if (axle + drive.cross(&contact)).norm() <= TOLERANCE {
        format!("{what}: its axis points the wrong way, {expected}: flip the sign of <axis>")
    } else if along_contact.abs() > TOLERANCE {
        format!(
            "{what}: its axle is not perpendicular to the line from the ball center to the contact: their cosine is \
             {along_contact:.3e}, at most {TOLERANCE:e}; {expected}"
        )
    } else {
        format!(
            "{what}: its axle is not in the meridian plane of mast and contact: its component \
             across is {along_drive:.3e}, at most {TOLERANCE:e}; {expected}"
        )
    })
}
