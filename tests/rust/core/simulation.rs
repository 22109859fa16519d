//! The simulations with contacts, `rigid` and `contact`, against closed forms, against the models without slip, and
//! against each other where there is no closed form: lift-off, slip, falls and landings.

mod barrels;
mod coulomb;
mod falling;
mod flight;
mod friction;
mod general;
mod growth;
mod joints;
mod landing;
mod loads;
mod losses;
mod passes;
mod perturbed_floor;
mod preload;
mod pushes;
mod repetition;
mod ripple;
mod roller_angle;
mod rolling;
mod slipping;
mod slope;

use crate::motion::Motion;
use ballbot_core::sim::{ContactMotion, RigidMotion};
use ballbot_core::{Model, Params, State, Wheels};
use nalgebra::{Vector2, Vector3};

/// A simulation under test.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Simulation {
    Rigid,
    Contact,
}

impl Simulation {
    fn robot(self, params: &Params, sim_dt: f64) -> Box<dyn Model> {
        match self {
            Self::Rigid => Box::new(RigidMotion::new(params, sim_dt).unwrap()),
            Self::Contact => Box::new(ContactMotion::new(params, sim_dt)),
        }
    }

    /// At rest upright, 1 kHz.
    fn paper(self) -> Box<dyn Model> {
        self.robot(&Params::paper(), 1e-3)
    }

    /// The value for this simulation, of the values for both.
    fn pick<T>(self, rigid: T, contact: T) -> T {
        match self {
            Self::Rigid => rigid,
            Self::Contact => contact,
        }
    }
}

/// Generates a test of each gate for each simulation.
macro_rules! for_both {
    ($($gate:ident),* $(,)?) => {
        mod rigid {
            $(#[test] fn $gate() { super::$gate($crate::simulation::Simulation::Rigid); })*
        }
        mod contact {
            $(#[test] fn $gate() { super::$gate($crate::simulation::Simulation::Contact); })*
        }
    };
}
use for_both;

fn run(robot: &mut dyn Model, torques: impl Into<Wheels<f64>>, steps: usize) {
    let torques = torques.into();
    for _ in 0..steps {
        robot.step(torques);
    }
}

/// Upright at rest, lifted by `height`.
fn lifted(params: &Params, height: f64) -> State {
    let mut state = State::upright(params);
    state.ball_position.z += height;
    state.body_position.z += height;
    state
}

/// At rest, tilted by `degrees` towards an azimuth off the robot's symmetries.
fn leaning(params: &Params, degrees: f64) -> State {
    let azimuth: f64 = 0.4;
    State::tilted(params, Vector2::new(azimuth.cos(), azimuth.sin()) * degrees.to_radians(), 0.0)
}

/// Velocity of the body's CoM.
fn com_velocity(params: &Params, state: &State) -> Vector3<f64> {
    state.body_velocity + state.body_quaternion * state.body_angular_velocity.cross(&params.body_com())
}

/// Asserts |found − expected| ≤ limit and prints how close it was.
#[track_caller]
fn close(what: &str, found: f64, expected: f64, limit: f64) {
    let off = (found - expected).abs();
    println!("{what}: {found}, expected {expected}, off {off:.2e} of {limit:.1e}");
    assert!(off <= limit, "{what}: {found}, expected {expected} within {limit}");
}
