//! A sloped plane as the floor of a model whose floor is the plane z = 0.

use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use ballbot_base::terrain::Ground;
use nalgebra::{UnitQuaternion, Vector3};
use std::sync::Arc;

/// A plane through the origin.
#[derive(Clone, Debug)]
pub struct Slope {
    pub ground: Arc<Ground>,
    /// The smallest rotation from the inertial frame to the frame of the plane that takes its normal to z.
    pub rotation: UnitQuaternion<f64>,
}

impl Slope {
    /// The slope of a ground.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a ground that is not a plane, and for a robot that has a `floor_tilt`.
    pub fn new(ground: &Arc<Ground>, params: &Params) -> Result<Self> {
        let Some([x, y]) = ground.terrain().as_plane() else {
            return Err(Error::Inconsistent("the model 'spatial' simulates only planes, not this terrain".into()));
        };
        params.require_level("the model 'spatial' on a terrain")?;
        let normal = Vector3::new(-x, -y, 1.0);
        let rotation =
            UnitQuaternion::rotation_between(&normal, &Vector3::z()).expect("the normal of a plane points upwards");
        Ok(Self { ground: Arc::clone(ground), rotation })
    }

    /// The robot with the direction of gravity in the frame of the plane.
    pub fn params_of(&self, params: &Params) -> Params {
        // The floor's rotation is from its frame to the inertial frame.
        let tilt = self.rotation.inverse().scaled_axis();
        Params { floor_tilt: [tilt.x, tilt.y], ..params.clone() }
    }

    /// A state in the frame of the plane.
    pub fn level(&self, state: &State) -> State {
        turned(&self.rotation, state)
    }

    /// The inverse of [`Slope::level`].
    pub fn inertial(&self, state: &State) -> State {
        turned(&self.rotation.inverse(), state)
    }
}

fn turned(rotation: &UnitQuaternion<f64>, state: &State) -> State {
    State {
        ball_position: rotation * state.ball_position,
        ball_quaternion: rotation * state.ball_quaternion,
        ball_velocity: rotation * state.ball_velocity,
        ball_angular_velocity: rotation * state.ball_angular_velocity,
        body_position: rotation * state.body_position,
        body_quaternion: rotation * state.body_quaternion,
        body_velocity: rotation * state.body_velocity,
        ..state.clone()
    }
}
