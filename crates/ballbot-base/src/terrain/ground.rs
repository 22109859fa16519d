//! A terrain as ground for balls of one radius.

use super::frame::Frame;
use super::patch::Patch;
use super::spline::Spline;
use super::{Terrain, normal_of};
use crate::error::{Error, Result, positive};
use crate::lanes::{Lane, Scalar, run_one};
use crate::params::Params;
use nalgebra::{Matrix2, Vector2, Vector3};
use std::sync::Arc;

/// Largest curvature of a valley as a fraction of the curvature of the ball.
const MOST_CURVED: f64 = 0.5;

/// Largest number of Newton steps to a point of contact, and the tolerance at which they end, m.
const MOST_STEPS: usize = 60;
const FOUND: f64 = 1e-13;

/// Bound on the rounding error of a gradient, as a multiple of height / cell.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// A terrain with the surface on which the centers of balls in contact lie, one ball radius along the normal from the
/// ground.
///
/// The normal of this surface equals the ground's normal at the contact point, so a robot needs one evaluation per
/// step. The surface is for one radius. The center of a ball of another radius is higher by the difference along the
/// normal; the normal then has an error of the curvature times the difference, in radians.
#[derive(Debug)]
pub struct Ground {
    terrain: Arc<Terrain>,
    centers: Spline,
    ball_radius: f64,
}

impl Ground {
    /// The ground for balls of a radius, m.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the ball does not fit the narrowest valley, whose curvature may be at most half the
    /// curvature of the ball.
    pub fn new(terrain: &Arc<Terrain>, ball_radius: f64) -> Result<Self> {
        Self::check_radius(terrain, ball_radius)?;
        let surface = terrain.surface();
        let nodes = surface.nodes();
        // Heights far from zero have rounding errors with steep slopes.
        let [lowest, highest] = terrain.heights();
        let grain = ROUNDING * lowest.abs().max(highest.abs()) * ball_radius / surface.cell();
        let mut heights = crate::memory::try_zeros::<f64>("heights of ball centers", &nodes)?;
        for (j, row) in heights.chunks_exact_mut(nodes[0]).enumerate() {
            for (i, height) in row.iter_mut().enumerate() {
                *height = center_height(surface, surface.node(i, j), ball_radius, grain)?;
            }
        }
        let centers = Spline::through(&heights, nodes, surface.node(0, 0), surface.cell());
        Ok(Self { terrain: Arc::clone(terrain), centers, ball_radius })
    }

    /// Checks that a ball fits the narrowest valley of a terrain.
    ///
    /// # Errors
    /// As [`Ground::new`].
    pub fn check_radius(terrain: &Terrain, ball_radius: f64) -> Result<()> {
        positive("ball_radius", ball_radius)?;
        let ([valley, _], limit) = (terrain.curvature(), MOST_CURVED / ball_radius);
        if valley > limit {
            return Err(Error::Inconsistent(format!(
                "the terrain's narrowest valley has a curvature of {valley:.3} 1/m, but a ball of ball_radius = {ball_radius} m \
                 takes at most {MOST_CURVED} / ball_radius = {limit:.3} 1/m: smooth or lower its heights, or take a larger cell"
            )));
        }
        Ok(())
    }

    /// The terrain.
    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    /// Checks that a ground has no obstacles; `what` begins the error.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a ground with obstacles.
    pub fn require_no_obstacles(ground: Option<&Arc<Self>>, what: &str) -> Result<()> {
        match ground.map_or(0, |ground| ground.terrain.obstacles().shapes().len()) {
            0 => Ok(()),
            count => Err(Error::Inconsistent(format!(
                "{what}: no obstacles, but the terrain has {count}; the models 'contact' and 'rigid' simulate them"
            ))),
        }
    }

    /// Ball radius of its design, m.
    pub fn ball_radius(&self) -> f64 {
        self.ball_radius
    }

    /// Gap of balls of `radius` centered at `ball`, m, and the frame of the ground below.
    #[inline(always)]
    pub fn under<L: Lane>(
        &self,
        token: L::Token,
        [x, y, z]: [L; 3],
        radius: L,
        patch: &mut Patch<L::Cell>,
    ) -> (L, Frame<L>) {
        let height = self.centers.at(token, [x, y], patch);
        let frame = Frame::of_gradient(height.gradient);
        let gap = (z - height.z).mul_add(frame.normal.z, -(radius - self.ball_radius));
        (gap, frame)
    }

    /// Gap of one ball, m, and the ground's normal at the point of contact.
    pub fn gap(&self, center: &Vector3<f64>, radius: f64) -> (f64, Vector3<f64>) {
        let (gap, frame) = run_one(
            #[inline(always)]
            || self.under::<f64>(Scalar, (*center).into(), radius, &mut Patch::default()),
        );
        (gap, Vector3::new(frame.normal.x, frame.normal.y, frame.normal.z))
    }

    /// Center of the robot's ball in contact with the ground, above x and y, and the normal at the contact.
    pub fn ball_center(&self, params: &Params, x: f64, y: f64) -> (Vector3<f64>, Vector3<f64>) {
        let jet = self.centers.jet(x, y);
        let normal = normal_of(jet.gradient);
        (Vector3::new(x, y, jet.z + (params.ball_radius - self.ball_radius) / normal.z), normal)
    }
}

/// Height of the center of a ball of radius `r` in contact with the surface, centered above `place`: the contact point
/// p solves p − r ∇h / √(1 + |∇h|²) = `place`. `grain`, m, is the accuracy that rounding errors permit.
fn center_height(surface: &Spline, place: [f64; 2], r: f64, grain: f64) -> Result<f64> {
    let place = Vector2::from(place);
    let found = grain.max(FOUND * (1.0 + place.norm()));
    let root = |gradient: &Vector2<f64>| (1.0 + gradient.norm_squared()).sqrt();
    let gradient_at = |p: &Vector2<f64>| Vector2::from(surface.jet(p.x, p.y).gradient);
    let first = gradient_at(&place);
    let mut p = place + first * (r / root(&first));
    let (mut least, mut step) = (f64::INFINITY, Vector2::zeros());
    for _ in 0..MOST_STEPS {
        let jet = surface.jet(p.x, p.y);
        let gradient = Vector2::from(jet.gradient);
        let length = root(&gradient);
        let miss = p - gradient * (r / length) - place;
        if miss.norm() <= found {
            return Ok(jet.z + r / length);
        }
        // A step too far across a crest is halved.
        if miss.norm() > least {
            step *= 0.5;
            p += step;
            continue;
        }
        least = miss.norm();
        let [xx, xy, yy] = jet.hessian;
        let hessian = Matrix2::new(xx, xy, xy, yy);
        let slope = Matrix2::identity() - gradient * gradient.transpose() / (length * length);
        let change = Matrix2::identity() - slope * hessian * (r / length);
        let Some(inverse) = change.try_inverse() else { break };
        step = inverse * miss;
        p -= step;
    }
    Err(Error::Inconsistent(format!(
        "no point of contact was found for a ball of ball_radius = {r} m above x = {} m, y = {} m of the terrain: smooth its \
         heights there",
        place.x, place.y
    )))
}
