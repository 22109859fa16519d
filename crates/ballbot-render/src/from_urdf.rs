//! Scene of the visual shapes of two URDFs, with patterns on shapes whose rotation would be invisible.

use super::color::{Color, Paint, srgb};
use super::scene::{Link, Part, Scene};
use super::shape::Shape;
use ballbot_base::error::{Error, Result};
use ballbot_base::files;
use ballbot_base::params::Params;
use ballbot_urdf::{Visual, VisualLink, VisualShape, visuals_from_urdf};
use nalgebra::Vector3;
use std::io::Cursor;
use std::path::Path;

/// Maximum number of triangles of a mesh. Robot meshes have thousands.
const MAX_TRIANGLES: usize = 2_000_000;

/// Largest mesh file, bytes: the maximum number of triangles in binary, or a quarter of it as text.
const MAX_SIZE: u64 = 128 << 20;

impl Scene {
    /// The scene of the visual elements of two URDFs.
    ///
    /// # Errors
    /// As [`visuals_from_urdf`]; [`Error::Io`] and [`Error::Decode`] for a mesh that cannot be read. Meshes are STL.
    pub fn from_urdf(bot: &Path, ball: &Path) -> Result<Self> {
        let params: Params = ballbot_urdf::params_from_urdf(bot, ball)?;
        let parts = visuals_from_urdf(bot, ball)?.iter().map(part).collect::<Result<Vec<_>>>()?;
        Ok(Self::new(&params, parts))
    }
}

fn part(visual: &Visual) -> Result<Part> {
    let (link, default) = match visual.link {
        VisualLink::Ball => (Link::Ball, srgb(0xd9480f)),
        VisualLink::Body => (Link::Body, srgb(0xced4da)),
        VisualLink::Wheel(i) => (Link::Wheel(i), srgb(0x495057)),
    };
    let color = visual.color.map_or(default, |[r, g, b]| {
        let byte = |x: f64| (x * 255.0).round() as u32;
        srgb((byte(r) << 16) | (byte(g) << 8) | byte(b))
    });
    Ok(Part {
        link,
        position: visual.pose.translation.vector,
        attitude: visual.pose.rotation,
        shape: shape(&visual.shape)?,
        paint: paint(link, &visual.shape, color),
    })
}

fn paint(link: Link, shape: &VisualShape, color: Color) -> Paint {
    let lighter = color.lerp(&Color::repeat(1.0), 0.75);
    match (link, shape) {
        (Link::Ball, _) => Paint::Octants(color, lighter),
        (Link::Wheel(_), VisualShape::Cylinder(..)) => {
            let second = color.lerp(&Color::repeat(1.0), 0.2);
            Paint::Sectors { count: 12, first: color, second, mark: srgb(0xf2c037) }
        }
        _ => Paint::Plain(color),
    }
}

fn shape(shape: &VisualShape) -> Result<Shape> {
    Ok(match shape {
        VisualShape::Sphere(radius) => Shape::Sphere { radius: *radius },
        VisualShape::Cylinder(radius, length) => Shape::Cylinder { radius: *radius, half_length: 0.5 * length },
        VisualShape::Cuboid(size) => Shape::Cuboid { half_extents: size * 0.5 },
        VisualShape::Mesh(path, scale) => mesh(path, scale)?,
    })
}

fn mesh(path: &Path, scale: &Vector3<f64>) -> Result<Shape> {
    Shape::stl(&files::read(path, MAX_SIZE)?, scale).map_err(|error| match error {
        Error::Decode { reason, .. } => Error::Decode { what: path.display().to_string(), reason },
        other => other,
    })
}

impl Shape {
    /// The triangles of an STL, text or binary; its coordinates times `scale` are in m.
    ///
    /// # Errors
    /// [`Error::Decode`] for contents that are not an STL, for more than two million triangles, and as [`Shape::mesh`].
    pub fn stl(contents: &[u8], scale: &Vector3<f64>) -> Result<Self> {
        let invalid = |reason: String| Error::Decode { what: "mesh".into(), reason };
        let stl =
            stl_io::read_stl(&mut Cursor::new(contents)).map_err(|e| invalid(format!("not a readable STL: {e}")))?;
        if stl.faces.len() > MAX_TRIANGLES {
            return Err(invalid(format!("{} triangles, limit {MAX_TRIANGLES}", stl.faces.len())));
        }
        let point = |p: &stl_io::Vertex| Vector3::new(p[0], p[1], p[2]).cast::<f64>().component_mul(scale);
        let points: Vec<_> = stl.vertices.iter().map(point).collect();
        let triangles: Vec<_> = stl.faces.iter().map(|face| face.vertices.map(|i| i as u32)).collect();
        Self::mesh(&points, &triangles)
    }
}
