//! One wheel of the bot: its axle, its round shape, its mass and its joint's dynamics.

use super::mass::RigidMass;
use super::shape::{Shape, spheres_and_cylinders};
use super::tree::{Tree, finite};
use super::{Checked, TOLERANCE};
use nalgebra::{Matrix3, Point3, Vector3};
use urdf_rs::Joint;

/// A wheel in the root frame.
pub(super) struct Wheel {
    /// "wheel i (joint 'name')".
    pub what: String,
    /// m.
    pub centre: Point3<f64>,
    /// Unit vector of the joint axis.
    pub axle: Vector3<f64>,
    /// m.
    pub radius: f64,
    /// The wheel's links as one rigid part.
    pub body: RigidMass,
    /// About the axle, kg·m².
    pub axial_inertia: f64,
    /// Joint damping, N·m/(rad/s).
    pub damping: f64,
    /// Joint friction, N·m.
    pub friction: f64,
    /// Effort limit, N·m; zero for none.
    pub effort: f64,
}

impl Wheel {
    /// Wheel `i`, the links turned by `joint`.
    pub fn read(tree: &Tree, i: usize, joint: usize) -> Checked<Self> {
        let what = format!("wheel {i} (joint '{}')", tree.joints[joint].name);
        let links = tree.turned_by(Some(joint));
        let (on_axle, axle) = axle(tree, joint, &what)?;
        let off_axle = |p: &Point3<f64>| (p - on_axle).cross(&axle).norm();
        let is_coaxial = |shape: &Shape| {
            off_axle(&shape.centre) <= TOLERANCE
                && shape.cylinder_axis.is_none_or(|axis| axis.cross(&axle).norm() <= TOLERANCE)
        };
        let shape = spheres_and_cylinders(tree, &links, is_coaxial)?
            .into_iter()
            .reduce(|largest, shape| if shape.radius > largest.radius { shape } else { largest })
            .ok_or_else(|| format!("{what} has no collision or visual sphere or cylinder around its axle"))?;
        let body = tree.mass(Some(joint), &what)?;
        let off = off_axle(&body.centre);
        if !(..=TOLERANCE).contains(&off) {
            return Err(format!("{what}: its centre of mass is {off} m off its axle, at most {TOLERANCE} m"));
        }
        let axial_inertia = axle.dot(&(body.inertia * axle));
        check_symmetry(&body.inertia, &axle, axial_inertia, &what)?;
        let (damping, friction, effort) = dynamics(&tree.joints[joint], &what)?;
        let Shape { radius, centre, .. } = shape;
        Ok(Self { what, centre, axle, radius, body, axial_inertia, damping, friction, effort })
    }
}

/// A point of the axle and its direction.
fn axle(tree: &Tree, joint: usize, what: &str) -> Checked<(Point3<f64>, Vector3<f64>)> {
    let axis = Vector3::from(*tree.joints[joint].axis.xyz);
    finite(&format!("the axis of {what}"), axis.as_slice())?;
    let axis = axis.try_normalize(f64::MIN_POSITIVE).ok_or_else(|| format!("{what}: its axis has length 0"))?;
    // A joint's frame is its child link's; the child is the first link the joint turns.
    let child = &tree.joints[joint].child.link;
    let child = tree.links.iter().position(|link| link.name == *child);
    let pose = child.map(|link| tree.poses[link]).unwrap_or_default();
    Ok((pose.translation.vector.into(), pose.rotation * axis))
}

/// Refuses an inertia that changes as the wheel turns.
fn check_symmetry(inertia: &Matrix3<f64>, axle: &Vector3<f64>, axial: f64, what: &str) -> Checked<()> {
    let along = axle * axle.transpose();
    let transverse = (inertia.trace() - axial) / 2.0;
    let symmetric = along * axial + (Matrix3::identity() - along) * transverse;
    let uneven = (inertia - symmetric).amax() / inertia.amax();
    if (..=TOLERANCE).contains(&uneven) {
        return Ok(());
    }
    Err(format!(
        "{what}: its inertia is not symmetric about its axle: off by {uneven} of its largest moment, at most {TOLERANCE}"
    ))
}

/// Damping, friction and effort limit of a joint; zero where the file is silent.
fn dynamics(joint: &Joint, what: &str) -> Checked<(f64, f64, f64)> {
    let (damping, friction) = joint.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
    // From version 1.2 of the format on, no limit is infinite.
    let effort = if joint.limit.effort == f64::INFINITY { 0.0 } else { joint.limit.effort };
    for (name, value) in [("damping", damping), ("friction", friction), ("effort limit", effort)] {
        if !value.is_finite() || value < 0.0 {
            return Err(format!("{what}: {name} = {value} is out of range: it must be a finite number >= 0"));
        }
    }
    Ok((damping, friction, effort))
}
