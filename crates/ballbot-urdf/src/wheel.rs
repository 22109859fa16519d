//! One wheel of the bot: axle, radius, mass and joint friction.

use super::checked::{Checked, TOLERANCE};
use super::mass::RigidMass;
use super::numbers::finite;
use super::shape::{Shape, spheres_and_cylinders};
use super::tree::Tree;
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::TAU;
use urdf_rs::{Joint, JointType};

/// A wheel in the root frame.
pub(super) struct Wheel {
    /// Name for messages: "wheel i (joint 'name')".
    pub what: String,
    /// Center, m.
    pub center: Point3<f64>,
    /// Unit vector of the joint axis.
    pub axle: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
    /// All links of the wheel as one rigid part.
    pub body: RigidMass,
    /// Moment of inertia about the axle, kg·m².
    pub axial_inertia: f64,
    /// Joint damping, N·m/(rad/s).
    pub damping: f64,
    /// Joint friction, N·m.
    pub friction: f64,
    /// Effort limit, N·m; zero without limit.
    pub effort: f64,
}

impl Wheel {
    /// Wheel `i`: the links turned by `joint`.
    pub fn read(tree: &Tree, i: usize, joint: usize) -> Checked<Self> {
        let what = format!("wheel {i} (joint '{}')", tree.joints[joint].name);
        let links = tree.turned_by(Some(joint));
        let (on_axle, axle) = axle(tree, joint, &what)?;
        let off_axle = |p: &Point3<f64>| (p - on_axle).cross(&axle).norm();
        let is_coaxial = |shape: &Shape| {
            off_axle(&shape.center) <= TOLERANCE
                && shape.cylinder_axis.is_none_or(|axis| axis.cross(&axle).norm() <= TOLERANCE)
        };
        let shape = spheres_and_cylinders(tree, &links, is_coaxial)?
            .into_iter()
            .reduce(|largest, shape| if shape.radius > largest.radius { shape } else { largest })
            .ok_or_else(|| {
                let [x, y, z]: [f64; 3] = axle.into();
                format!(
                    "{what} has no collision or visual sphere or cylinder around its axle, ({x:.6}, {y:.6}, {z:.6})"
                )
            })?;
        let body = tree.mass(Some(joint), &what)?;
        let axial_inertia = axle.dot(&(body.inertia * axle));
        let (damping, friction, effort) = dynamics(&tree.joints[joint], &what)?;
        let Shape { radius, center, .. } = shape;
        Ok(Self { what, center, axle, radius, body, axial_inertia, damping, friction, effort })
    }

    /// Rejects a wheel whose rotation would move the center of mass or change the inertia of the bot.
    pub fn check_balance(&self) -> Checked<()> {
        let Self { what, axle, body, .. } = self;
        let off_axle = (body.center - self.center).cross(axle).norm();
        if !(..=TOLERANCE).contains(&off_axle) {
            return Err(format!(
                "{what}: its center of mass is {off_axle:.3e} m off its axle, at most {TOLERANCE:e} m"
            ));
        }
        let along = axle * axle.transpose();
        let transverse = (body.inertia.trace() - self.axial_inertia) / 2.0;
        let symmetric = along * self.axial_inertia + (Matrix3::identity() - along) * transverse;
        let uneven = (body.inertia - symmetric).amax() / body.inertia.amax();
        if (..=TOLERANCE).contains(&uneven) {
            return Ok(());
        }
        Err(format!(
            "{what}: its inertia is not symmetric about its axle: off by {uneven:.3e} of its largest moment, \
             at most {TOLERANCE:e}"
        ))
    }
}

/// A point of the axle and its direction.
fn axle(tree: &Tree, joint: usize, what: &str) -> Checked<(Point3<f64>, Vector3<f64>)> {
    let axis = Vector3::from(*tree.joints[joint].axis.xyz);
    finite(&format!("the axis of {what}"), axis.as_slice())?;
    let axis = axis.try_normalize(f64::MIN_POSITIVE).ok_or_else(|| format!("{what}: its axis has length 0"))?;
    // At joint angle zero the joint frame is the frame of the child link.
    let pose = tree.poses[tree.children[joint]];
    Ok((pose.translation.vector.into(), pose.rotation * axis))
}

/// Damping, friction and effort limit of a joint; zero if the file does not give them.
fn dynamics(joint: &Joint, what: &str) -> Checked<(f64, f64, f64)> {
    let range = joint.limit.upper - joint.limit.lower;
    if joint.joint_type == JointType::Revolute && range > 0.0 && range < TAU {
        return Err(format!("{what}: its limits leave {range} rad, but a wheel turns without end: make it continuous"));
    }
    let (damping, friction) = joint.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
    // From version 1.2 of the format on, "no limit" is written as infinity.
    let effort = if joint.limit.effort == f64::INFINITY { 0.0 } else { joint.limit.effort };
    for (name, value) in [("damping", damping), ("friction", friction), ("effort limit", effort)] {
        if !value.is_finite() || value < 0.0 {
            return Err(format!("{what}: {name} = {value} is out of range: it must be a finite number >= 0"));
        }
    }
    Ok((damping, friction, effort))
}
