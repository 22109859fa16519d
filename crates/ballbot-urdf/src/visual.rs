//! Visual shapes of two URDFs, in the frames of the simulated robot.

use super::bot::Bot;
use super::checked::{Checked, invalid_file, read_file};
use super::numbers::pose;
use super::tree::Tree;
use ballbot_base::error::Result;
use ballbot_base::params::Params;
use nalgebra::{Isometry3, Translation3, Vector3};
use std::path::{Path, PathBuf};
use urdf_rs::Geometry;

/// The link that a visual is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisualLink {
    /// The ball; the visual is placed in the frame with origin at the ball center.
    Ball,
    /// The body; the visual is placed in the body frame.
    Body,
    /// Wheel 0, 1 or 2; the visual is placed in the body frame at wheel angle zero.
    Wheel(usize),
}

/// A shape about its own origin. Lengths in m.
#[derive(Clone, Debug, PartialEq)]
pub enum VisualShape {
    /// Sphere: radius.
    Sphere(f64),
    /// Cylinder along z: radius and length.
    Cylinder(f64, f64),
    /// Box: lengths of its edges.
    Cuboid(Vector3<f64>),
    /// Path of a mesh file, and factors from its coordinates to m.
    Mesh(PathBuf, Vector3<f64>),
}

/// A visual element of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Visual {
    /// Link that the visual is fixed to.
    pub link: VisualLink,
    /// Pose in the frame of the link.
    pub pose: Isometry3<f64>,
    /// Geometry.
    pub shape: VisualShape,
    /// Red, green and blue in [0, 1], sRGB; `None` for a visual without color.
    pub color: Option<[f64; 3]>,
}

/// The visual elements of the ballbot described by the files `bot` and `ball`.
///
/// # Errors
/// As [`super::params_from_urdf`]; [`ballbot_base::Error::Urdf`] for a visual that is not a sphere, cylinder, box or mesh
/// file, or has a size that is not positive.
pub fn visuals_from_urdf(bot: &Path, ball: &Path) -> Result<Vec<Visual>> {
    read_visuals((bot, &read_file(bot)?), (ball, &read_file(ball)?))
}

/// The visual elements of the ballbot described by the texts `bot` and `ball`; mesh paths stay as written.
///
/// # Errors
/// As [`super::params_from_urdf_text`] and [`visuals_from_urdf`].
pub fn visuals_from_urdf_text(bot: &str, ball: &str) -> Result<Vec<Visual>> {
    read_visuals((Path::new("bot URDF"), bot), (Path::new("ball URDF"), ball))
}

/// Visuals from the (file or label, text) of both URDFs.
fn read_visuals((bot, bot_text): (&Path, &str), (ball, ball_text): (&Path, &str)) -> Result<Vec<Visual>> {
    let (bot_label, ball_label) = (bot.display().to_string(), ball.display().to_string());
    let params: Params = super::read_params((&bot_label, bot_text), (&ball_label, ball_text))?;
    let of_ball = |text: &str| -> Checked<Vec<Visual>> {
        let tree = Tree::read(text)?;
        let center = tree.masses()?.into_iter().flatten().next().map_or_else(Vector3::zeros, |body| body.center.coords);
        let links: Vec<usize> = (0..tree.links.len()).collect();
        visuals(&tree, &links, VisualLink::Ball, -center, ball)
    };
    let of_bot = |text: &str| -> Checked<Vec<Visual>> {
        let tree = Tree::read(text)?;
        let shift = Vector3::z() * -Bot::read(text, params.ball_radius)?.ball_height;
        let mut found = visuals(&tree, &tree.turned_by(None), VisualLink::Body, shift, bot)?;
        for (i, joint) in tree.turning_joints().into_iter().enumerate() {
            found.extend(visuals(&tree, &tree.turned_by(Some(joint)), VisualLink::Wheel(i), shift, bot)?);
        }
        Ok(found)
    };
    let mut found = of_ball(ball_text).map_err(invalid_file(&ball_label))?;
    found.extend(of_bot(bot_text).map_err(invalid_file(&bot_label))?);
    Ok(found)
}

fn visuals(tree: &Tree, links: &[usize], of: VisualLink, shift: Vector3<f64>, file: &Path) -> Checked<Vec<Visual>> {
    let mut found = Vec::new();
    for &link in links {
        for visual in &tree.links[link].visual {
            let what = format!("a visual of link '{}'", tree.links[link].name);
            let local = pose(&what, &visual.origin)?;
            let material = visual.material.as_ref();
            let own = material.and_then(|m| m.color.as_ref());
            let named = || tree.materials.iter().find(|m| Some(&m.name) == material.map(|m| &m.name));
            let color = own.or_else(|| named().and_then(|m| m.color.as_ref()));
            let color = color.map(|c| [c.rgba[0], c.rgba[1], c.rgba[2]].map(|x| x.clamp(0.0, 1.0)));
            found.push(Visual {
                link: of,
                pose: Translation3::from(shift) * tree.poses[link] * local,
                shape: shape(&what, &visual.geometry, file)?,
                color,
            });
        }
    }
    Ok(found)
}

fn shape(what: &str, geometry: &Geometry, file: &Path) -> Checked<VisualShape> {
    let positive = |name: &str, values: &[f64]| match values.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
        Some(value) => Err(format!("{what}: {name} = {value} is out of range: it must be > 0")),
        None => Ok(()),
    };
    match geometry {
        Geometry::Sphere { radius } => {
            positive("radius", &[*radius])?;
            Ok(VisualShape::Sphere(*radius))
        }
        Geometry::Cylinder { radius, length } => {
            positive("radius and length", &[*radius, *length])?;
            Ok(VisualShape::Cylinder(*radius, *length))
        }
        Geometry::Box { size } => {
            positive("size", &**size)?;
            Ok(VisualShape::Cuboid(Vector3::from(**size)))
        }
        Geometry::Mesh { filename, scale } => {
            let scale = scale.map_or_else(|| Vector3::repeat(1.0), |s| Vector3::from(*s));
            positive("scale", scale.as_slice())?;
            let relative = filename.strip_prefix("file://").unwrap_or(filename);
            if relative.contains("://") {
                return Err(format!("{what}: mesh '{filename}' must be a path, from the URDF's folder or absolute"));
            }
            Ok(VisualShape::Mesh(file.parent().unwrap_or(Path::new("")).join(relative), scale))
        }
        Geometry::Capsule { .. } => Err(format!("{what} is a capsule: use a sphere, a cylinder, a box or a mesh")),
    }
}
