//! Poses and numbers of a URDF, checked to be finite.

use super::checked::Checked;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use urdf_rs::Pose;

/// Pose of an `<origin>`; `what` names its element.
pub(super) fn pose(what: &str, origin: &Pose) -> Checked<Isometry3<f64>> {
    let ([x, y, z], [roll, pitch, yaw]) = (*origin.xyz, *origin.rpy);
    finite(&format!("the origin of {what}"), &[x, y, z, roll, pitch, yaw])?;
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

/// Rejects numbers that are not finite; `what` names their element.
pub(super) fn finite(what: &str, values: &[f64]) -> Checked<()> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(value) => Err(format!("{what} contains {value}: it must be finite")),
        None => Ok(()),
    }
}
