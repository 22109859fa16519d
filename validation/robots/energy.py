"""Drag force of losses on a moving robot."""

import ballbot_rs as bb


def drag(params: bb.Params, model: str, state: bb.State) -> float:
    """Power of the losses over the speed of the ball's surface against floor and body, N, with the loads at rest."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-4)
    robot.reset(state)
    if model == "rigid":
        # The losses of a step use the loads of the step before; `contact` starts with the loads at rest.
        robot.step((0.0, 0.0, 0.0))
    before, rate = robot.energy, robot.state.ball_angular_velocity
    robot.step((0.0, 0.0, 0.0))
    speed = params.ball_radius * max(abs(float(x)) for x in rate)
    return (before - robot.energy) / (speed * robot.sim_dt)
