//! Placement of three wheels on a ball: height of the ball center, zenith and azimuths.

use super::checked::{Checked, TOLERANCE};
use super::wheel::Wheel;
use nalgebra::{Point3, Vector3};
use std::f64::consts::TAU;

/// Placement of three wheels on one ball.
pub(super) struct Placement {
    /// z coordinate of the ball center in the root frame, m.
    pub ball_height: f64,
    /// Mean zenith α of the contacts, rad.
    pub zenith: f64,
    /// Zenith of each contact minus the mean, rad; zeros if it is rounding.
    pub zenith_offsets: [f64; 3],
    /// Azimuth β of each contact, in [0, 2π), rad.
    pub azimuths: [f64; 3],
}

impl Placement {
    /// Placement on a ball of radius `ball_radius`, centered on the mast, that all `wheels` touch from above.
    pub fn solve(wheels: &[Wheel; 3], ball_radius: f64) -> Checked<Self> {
        let reach = ball_radius + wheels[0].radius;
        let off_mast = wheels.each_ref().map(|w| w.center.x.hypot(w.center.y));
        let mean_off_mast = mean(off_mast);
        for (wheel, off_mast) in wheels.iter().zip(off_mast) {
            if !(0.0..reach).contains(&off_mast) {
                return Err(format!(
                    "{} is {off_mast} m off the mast: to touch the ball from above it must be closer than ball radius + \
                     wheel radius = {reach} m",
                    wheel.what
                ));
            }
        }
        let above_ball = |off_mast: f64| (reach - off_mast).sqrt() * (reach + off_mast).sqrt();
        let even = off_mast.iter().all(|off| (off - mean_off_mast).abs() <= TOLERANCE);
        let above = if even { above_ball(mean_off_mast) } else { mean(off_mast.map(above_ball)) };
        let ball_height = mean(wheels.each_ref().map(|w| w.center.z)) - above;
        let ball_center = Point3::new(0.0, 0.0, ball_height);
        for (wheel, off_mast) in wheels.iter().zip(off_mast) {
            let gap = (wheel.center - ball_center).norm() - reach;
            if !(-TOLERANCE..=TOLERANCE).contains(&gap) {
                return Err(format!(
                    "the wheels do not all touch one ball centered on the mast: {}, {off_mast} m off the mast, is \
                     {gap:.3e} m off the ball that fits best: at most {TOLERANCE:e} m",
                    wheel.what
                ));
            }
        }
        let zeniths = if even {
            [mean_off_mast.atan2(above); 3]
        } else {
            off_mast.map(|off_mast| off_mast.atan2(above_ball(off_mast)))
        };
        let (zenith, zenith_offsets) = if even {
            (zeniths[0], [0.0; 3])
        } else {
            let zenith = mean(zeniths);
            (zenith, zeniths.map(|one| one - zenith))
        };
        let azimuths = wheels.each_ref().map(|w| azimuth(&w.center));
        for ((wheel, azimuth), zenith) in wheels.iter().zip(azimuths).zip(zeniths) {
            check_axle(wheel, zenith, azimuth)?;
        }
        Ok(Self { ball_height, zenith, zenith_offsets, azimuths })
    }
}

fn mean(values: [f64; 3]) -> f64 {
    values.iter().sum::<f64>() / 3.0
}

/// Azimuth of a point in [0, 2π), rad. Rounding errors below zero are kept.
fn azimuth(p: &Point3<f64>) -> f64 {
    let angle = p.y.atan2(p.x);
    if angle < -TOLERANCE { angle + TAU } else { angle }
}

/// Rejects an axle that is not −u = −p × d, with p towards the contact and d the drive direction.
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
