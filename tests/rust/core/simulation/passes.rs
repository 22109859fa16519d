//! Passes over a step of `rigid` in which the bot touches the floor, or its body touches the ball.

use super::{Motion, Simulation};
use ballbot_core::{Params, State};
use nalgebra::{Vector2, Vector3};

/// The body is thrown at the floor while its ball goes the other way, in time steps of 10 ms: in the second step each
/// of eight passes changes the result of the next pass, though each finds the modes of its contacts at once.
#[test]
fn steps_whose_passes_do_not_settle_are_unsolved() {
    let mut robot = Simulation::Rigid.robot(&Params::paper(), 0.01);
    let mut start = State::tilted(&Params::paper(), Vector2::new(0.27, -0.75), 0.0);
    start.body_position.z += 0.05;
    start.body_velocity = Vector3::new(3.4, -0.52, -1.93);
    start.ball_velocity = Vector3::new(-4.92, 0.76, 0.0);
    robot.reset(&start).unwrap();
    for _ in 0..10 {
        robot.step([0.0; 3]);
    }
    let contacts = robot.contacts();
    assert_eq!((contacts.searched_steps, contacts.unsolved_steps), (1, 1));
}
