//! The link tree of a URDF: poses, and the joint that turns each link.

use super::checked::Checked;
use super::mass::RigidMass;
use super::numbers::pose;
use nalgebra::Isometry3;
use std::collections::HashMap;
use urdf_rs::{Joint, JointType, Link, Material};

/// Largest nesting depth of XML elements. A URDF has six levels; the XML reader is recursive.
const MAX_DEPTH: usize = 64;

/// A URDF whose joints form a tree, with all joints at zero.
pub(super) struct Tree {
    /// Links in document order.
    pub links: Vec<Link>,
    /// Joints in document order.
    pub joints: Vec<Joint>,
    /// Pose of each link in the root frame.
    pub poses: Vec<Isometry3<f64>>,
    /// Materials that visuals refer to by name.
    pub materials: Vec<Material>,
    /// The child link of each joint.
    pub children: Vec<usize>,
    /// The joint that turns each link; `None` for links fixed to the root.
    turned_by: Vec<Option<usize>>,
}

impl Tree {
    /// Parses `text` and computes the poses of its links.
    pub fn read(text: &str) -> Checked<Self> {
        check_depth(text)?;
        let urdf = urdf_rs::read_from_string(text).map_err(|e| format!("not a readable URDF: {e}"))?;
        let (links, joints, materials) = (urdf.links, urdf.joints, urdf.materials);
        let edges = edges(&links, &joints)?;
        let root = root(&links, &edges)?;
        let mut hanging = vec![Vec::new(); links.len()];
        for (joint, &(parent, child)) in edges.iter().enumerate() {
            hanging[parent].push((joint, child));
        }
        let mut poses = vec![Isometry3::identity(); links.len()];
        let mut turned_by = vec![None; links.len()];
        let mut pending = vec![root];
        let mut reached = vec![false; links.len()];
        while let Some(parent) = pending.pop() {
            reached[parent] = true;
            for &(joint, child) in &hanging[parent] {
                let what = format!("joint '{}'", joints[joint].name);
                poses[child] = poses[parent] * pose(&what, &joints[joint].origin)?;
                turned_by[child] = turning_joint(&joints, joint, turned_by[parent])?;
                pending.push(child);
            }
        }
        if let Some(link) = reached.iter().position(|r| !r) {
            return Err(format!("link '{}' does not hang on the root: its joints form a loop", links[link].name));
        }
        let children = edges.into_iter().map(|(_, child)| child).collect();
        Ok(Self { links, joints, poses, materials, children, turned_by })
    }

    /// Joints that turn, in document order.
    pub fn turning_joints(&self) -> Vec<usize> {
        (0..self.joints.len()).filter(|&j| turns(&self.joints[j])).collect()
    }

    /// Links turned by `joint`; links fixed to the root for `None`.
    pub fn turned_by(&self, joint: Option<usize>) -> Vec<usize> {
        (0..self.links.len()).filter(|&link| self.turned_by[link] == joint).collect()
    }

    /// Mass of each link in the root frame; `None` for a link without mass.
    pub fn masses(&self) -> Checked<Vec<Option<RigidMass>>> {
        self.links.iter().zip(&self.poses).map(|(link, pose)| RigidMass::of_link(link, pose)).collect()
    }

    /// Mass of the links turned by `joint`, as [`Tree::turned_by`]; `what` names them.
    pub fn mass(&self, joint: Option<usize>, what: &str) -> Checked<RigidMass> {
        let mut parts = Vec::new();
        for link in self.turned_by(joint) {
            parts.extend(RigidMass::of_link(&self.links[link], &self.poses[link])?);
        }
        let mass = RigidMass::combined(&parts)
            .ok_or_else(|| format!("{what} has mass = 0 kg: its links need an <inertial> with a mass > 0"))?;
        mass.check_inertia(what)?;
        Ok(mass)
    }
}

fn turns(joint: &Joint) -> bool {
    matches!(joint.joint_type, JointType::Continuous | JointType::Revolute)
}

/// The joint that turns the child of `joint`, given the joint that turns its parent.
fn turning_joint(joints: &[Joint], joint: usize, parent: Option<usize>) -> Checked<Option<usize>> {
    let Joint { name, joint_type, mimic, .. } = &joints[joint];
    if *joint_type == JointType::Fixed {
        return Ok(parent);
    }
    if !turns(&joints[joint]) {
        let kind = format!("{joint_type:?}").to_lowercase();
        return Err(format!("joint '{name}' is {kind}: joints must be fixed, or continuous or revolute for a wheel"));
    }
    if let Some(parent) = parent {
        return Err(format!("joint '{name}' hangs on the wheel of '{}': wheels hang on the body", joints[parent].name));
    }
    if let Some(mimic) = mimic {
        return Err(format!("joint '{name}' mimics '{}': each wheel has its own motor", mimic.joint));
    }
    Ok(Some(joint))
}

/// Parent and child link of each joint.
fn edges(links: &[Link], joints: &[Joint]) -> Checked<Vec<(usize, usize)>> {
    let mut index = HashMap::new();
    for (i, link) in links.iter().enumerate() {
        if index.insert(link.name.as_str(), i).is_some() {
            return Err(format!("two links are named '{}'", link.name));
        }
    }
    let find = |joint: &Joint, link: &str| {
        let known = index.get(link).copied();
        known.ok_or_else(|| format!("joint '{}' names the link '{link}', which does not exist", joint.name))
    };
    joints.iter().map(|j| Ok((find(j, &j.parent.link)?, find(j, &j.child.link)?))).collect()
}

/// The only link that is not the child of a joint.
fn root(links: &[Link], edges: &[(usize, usize)]) -> Checked<usize> {
    let mut hangs = vec![false; links.len()];
    for &(_, child) in edges {
        if std::mem::replace(&mut hangs[child], true) {
            return Err(format!("link '{}' is the child of two joints", links[child].name));
        }
    }
    let roots: Vec<usize> = (0..links.len()).filter(|&i| !hangs[i]).collect();
    match roots[..] {
        [root] => Ok(root),
        [] if links.is_empty() => Err("it has no links".into()),
        [] => Err("no link is the root: the joints form a loop".into()),
        [first, second, ..] => Err(format!(
            "{} links hang on no joint ('{}', '{}', ..), expected exactly one root",
            roots.len(),
            links[first].name,
            links[second].name
        )),
    }
}

/// Rejects text nested deeper than [`MAX_DEPTH`].
fn check_depth(text: &str) -> Checked<()> {
    let mut depth = 0_usize;
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let close = if rest.starts_with("!--") { "-->" } else { ">" };
        let Some(end) = rest.find(close) else { break };
        let tag = &rest[..end];
        rest = &rest[end + close.len()..];
        if tag.starts_with('/') {
            depth = depth.saturating_sub(1);
        } else if !tag.starts_with(['!', '?']) && !tag.ends_with('/') {
            depth += 1;
        }
        if depth > MAX_DEPTH {
            return Err(format!("XML elements are nested more than {MAX_DEPTH} deep"));
        }
    }
    Ok(())
}
