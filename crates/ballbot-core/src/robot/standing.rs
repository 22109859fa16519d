//! The ground under a robot.

use super::Ballbot;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::terrain::{Ground, Terrain, upright_on};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::PI;
use std::sync::Arc;

impl Ballbot {
    /// The terrain; `None` for level ground.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.ground.as_ref().map(|ground| ground.terrain())
    }

    /// Puts the robot on a terrain, or on level ground, upright at rest above the origin at time zero. The ground
    /// persists over resets and parameter changes. A robot whose ball leaves a terrain with edges has diverged.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if the ball does not fit the terrain's narrowest valley, and for a model that does not
    /// simulate the terrain: `planar` takes only level ground, `spatial` only planes. The robot is then unchanged.
    pub fn set_terrain(&mut self, terrain: Option<&Arc<Terrain>>) -> Result<()> {
        if terrain.is_some() {
            self.params().require_level("a robot on a terrain")?;
        }
        let ground = terrain.map(|terrain| Ground::shared(terrain, self.params().ball_radius)).transpose()?;
        let (before, motion, diverged) = (self.ground.clone(), self.model.save(), self.diverged.clone());
        self.set_ground(ground.as_ref())?;
        // An obstacle may be at the origin.
        if let Err(error) = self.model.accepts(&self.model.state()) {
            self.set_ground(before.as_ref())?;
            self.model.load(&motion)?;
            self.diverged = diverged;
            return Err(error);
        }
        Ok(())
    }

    /// [`Ballbot::set_terrain`] with ground that robots share.
    pub(crate) fn set_ground(&mut self, ground: Option<&Arc<Ground>>) -> Result<()> {
        self.model.set_ground(ground)?;
        self.ground = ground.cloned();
        self.diverged = None;
        Ok(())
    }

    /// The ground; `None` for level ground.
    pub(crate) fn ground(&self) -> Option<&Arc<Ground>> {
        self.ground.as_ref()
    }

    /// Another robot on the same ground, with the same model.
    pub(crate) fn alike(&self, params: &Params) -> Result<Self> {
        let mut robot = Self::new(params, self.kind, self.sim_dt())?;
        if self.ground.is_some() {
            robot.set_ground(self.ground())?;
        }
        Ok(robot)
    }

    /// State upright at rest with the ball on the ground above the origin.
    pub fn upright(&self) -> State {
        upright_on(self.ground.as_deref(), self.params())
    }

    /// Restarts at rest with the ball on the ground, its center above x and y, m, at the heading `yaw`, rad. `tilt` is
    /// the rotation vector (x, y) of its tilt from the equilibrium on level ground, rad; `None` is the lean at which it
    /// is at rest on the slope there.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a slope on which no lean holds the robot; the errors of [`Ballbot::reset`].
    pub fn place_on_ground(&mut self, x: f64, y: f64, yaw: f64, tilt: Option<Vector2<f64>>) -> Result<()> {
        self.reset(&at_rest_on(self.params(), self.ground(), x, y, yaw, tilt)?)
    }
}

/// A robot at rest on a ground, as [`Ballbot::place_on_ground`] places it.
pub(crate) fn at_rest_on(
    params: &Params,
    ground: Option<&Arc<Ground>>,
    x: f64,
    y: f64,
    yaw: f64,
    tilt: Option<Vector2<f64>>,
) -> Result<State> {
    for (name, value) in [("x", x), ("y", y), ("yaw", yaw)] {
        check(name, value, "finite", |_| true)?;
    }
    if let Some(terrain) = ground.map(|ground| ground.terrain()).filter(|terrain| !terrain.contains(x, y)) {
        let [half_x, half_y] = terrain.half_size();
        return Err(Error::Inconsistent(format!(
            "x = {x} m, y = {y} m is not on the terrain, which reaches to ±{half_x} and ±{half_y} m"
        )));
    }
    for (i, value) in tilt.iter().flatten().enumerate() {
        check(format_args!("tilt[{i}]"), *value, "within ±pi", |tilt| tilt.abs() <= PI)?;
    }
    Ok(match ground {
        Some(ground) => ground.at_rest(params, x, y, yaw, tilt)?,
        None => {
            let mut state = State::tilted_from_equilibrium(params, tilt.unwrap_or_default(), yaw);
            let offset = Vector3::new(x, y, 0.0);
            state.ball_position += offset;
            state.body_position += offset;
            state
        }
    })
}
