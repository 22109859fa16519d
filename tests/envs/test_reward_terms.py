"""Terms of the rewards, recomputed in NumPy from states, commands and actions."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import _state_rows as rows
from ballbot_rs._core import TASKS

N, STEPS = 4, 150


def bounded(squared, scale):
    return squared / (squared + scale**2)


def heading_of(states):
    """What remains about the vertical once the tilt is undone."""
    w, _, _, z = states[:, rows.BODY_QUATERNION].T
    return 2.0 * np.arctan2(z, w)


def in_heading(states, vectors):
    cos, sin = np.cos(heading_of(states)), np.sin(heading_of(states))
    return np.stack([cos * vectors[:, 0] + sin * vectors[:, 1], cos * vectors[:, 1] - sin * vectors[:, 0]], axis=1)


def squares(vectors):
    return (vectors**2).sum(axis=1)


def effort(states, action, last):
    rate = squares(states[:, rows.BODY_RATE])
    return {
        "alive": np.ones(len(states)),
        "rate": np.minimum(rate, 100.0),
        "action": (action**2).mean(axis=1),
        "action_change": ((action - last) ** 2).mean(axis=1),
    }


def velocity(batch, states, options):
    command = batch.command()
    error = in_heading(states, states[:, rows.BALL_VELOCITY]) - command[:, :2]
    up = rows.body_axes_of(states)[:, 2, :]
    yaw_rate = (up * states[:, rows.BODY_RATE]).sum(axis=1) - command[:, 2]
    coarse, fine = options["velocity_scales"]
    slow, exact = options["yaw_rate_scales"]
    return {
        "velocity": bounded(squares(error), coarse),
        "velocity_precision": bounded(squares(error), fine),
        "yaw_rate": bounded(yaw_rate**2, slow),
        "yaw_rate_precision": bounded(yaw_rate**2, exact),
    }


def distance_from_setpoint(batch, states, options):
    point = batch.setpoint()["position"]
    return bounded(squares(point - states[:, rows.BALL_POSITION][:, :2]), options["position_scale"])


def terrain(batch, states, options):
    return {**velocity(batch, states, options), "position": distance_from_setpoint(batch, states, options)}


def goal(batch, states, options):
    away = batch.command() - states[:, rows.BALL_POSITION][:, :2]
    distance = np.sqrt(squares(away))
    speed = distance / (options["approach_time"] + np.sqrt(distance / (2.0 * options["approach_acceleration"])))
    expected = away / distance[:, np.newaxis] * speed[:, np.newaxis]
    return {
        "approach": bounded(squares(states[:, rows.BALL_VELOCITY][:, :2] - expected), 0.3),
        "distance": distance / (distance + 0.5),
        "position": bounded(distance**2, 0.05),
    }


class Water:
    """The water of `carry`: a pendulum in the glass, by the exponential of its matrix."""

    def __init__(self):
        self.velocity = self.water = None

    def __call__(self, batch, states, options):
        turned = rows.body_axes_of(states)
        arm = np.array([0.0, 0.0, options["glass_height"]])
        turning = np.cross(states[:, rows.BODY_RATE], arm)
        velocity = states[:, rows.BODY_VELOCITY] + np.einsum("nij,nj->ni", turned, turning)
        change = np.zeros((N, 3)) if self.velocity is None else velocity - self.velocity
        lifted = change / batch.control_dt - batch.params(0).gravity_vector
        force = np.einsum("nij,ni->nj", turned, lifted)
        rest = force[:, :2] / force[:, 2:]
        if self.velocity is None:
            self.water = np.stack([rest, np.zeros((N, 2))])
        else:
            omega = 2.0 * np.pi * options["slosh_frequency"]
            values, vectors = np.linalg.eig([[0.0, 1.0], [-(omega**2), -2.0 * options["slosh_damping"] * omega]])
            moved = (vectors * np.exp(values * batch.control_dt)) @ np.linalg.inv(vectors)
            still = np.stack([rest, np.zeros((N, 2))])
            self.water = still + np.einsum("ij,jnk->ink", moved.real, self.water - still)
        self.velocity = velocity
        height = 0.5 * options["freeboard"] / options["glass_radius"]
        return {**goal(batch, states, options), "slosh": bounded(squares(self.water[0]), height)}


def ride(batch, states, options):
    setpoints = batch.setpoint()
    velocity, turned = setpoints["velocity"], setpoints["yaw"]
    # The command is along the axes of its heading, which differs from the robot's.
    cos, sin = np.cos(turned), np.sin(turned)
    commanded = np.stack(
        [cos * velocity[:, 0] + sin * velocity[:, 1], cos * velocity[:, 1] - sin * velocity[:, 0]], axis=1
    )
    present = in_heading(states, states[:, rows.BALL_VELOCITY])
    turning = (rows.body_axes_of(states)[:, 2, :] * states[:, rows.BODY_RATE]).sum(axis=1)
    coarse, fine = options["velocity_scales"]
    return {
        "velocity": bounded(squares(commanded - present), coarse),
        "velocity_precision": bounded(squares(commanded - present), fine),
        "wish": bounded(squares(batch.command()[:, :2] - present), options["eagerness"]),
        "yaw_rate": bounded((turning - batch.command()[:, 2]) ** 2, 0.3),
    }


def path(batch, states, options):
    point = batch.setpoint()["position"]
    squared = squares(point - states[:, rows.BALL_POSITION][:, :2])
    distance = np.sqrt(squared)
    return {"position": bounded(squared, options["position_scale"]), "distance": distance / (distance + 0.3)}


def standing(batch, states, options):
    away = states[:, rows.BALL_POSITION][:, :2] - np.array(options["setpoint"])
    tilt = rows.tilt_of(states, batch.params(0).body_com)
    scale = options.get("position_scale", options.get("success_radius"))
    return {
        "tilt": np.minimum((tilt / options["fall_tilt"]) ** 2, 1.0),
        "position": bounded(squares(away), scale),
        "velocity": np.minimum(squares(states[:, rows.BALL_VELOCITY][:, :2]), 1.0),
        "yaw_rate": bounded(states[:, rows.BODY_RATE][:, 2] ** 2, 0.02),
    }


def navigate(batch, states, _options):
    setpoints = batch.setpoint()
    place, velocity = setpoints["position"], setpoints["velocity"]
    ball = states[:, rows.BALL_POSITION][:, :2]
    return {
        "guided_position": bounded(squares(place - ball), 0.1),
        "guided_velocity": bounded(squares(velocity - states[:, rows.BALL_VELOCITY][:, :2]), 0.2),
        "position": bounded(squares(batch.command() - ball), 0.05),
        "collision": batch.contacts()["on_obstacle"].astype(float),
    }


def published(_batch, states, _options):
    return {"progress": states[:, rows.BALL_VELOCITY][:, 1] * 5.0}


OF_TASKS = {
    "balance": standing,
    "velocity": velocity,
    "goal": goal,
    "path": path,
    "carry": Water,
    "navigate": navigate,
    "ride": ride,
    "push": standing,
    "terrain": terrain,
    "openballbot": published,
}


def test_every_task_is_here():
    assert set(OF_TASKS) == set(TASKS)


@pytest.mark.parametrize(
    ("task", "floor"), [*((task, {}) for task in OF_TASKS), ("carry", {"floor_tilt": (0.03, -0.02)})]
)
def test_terms_match_the_documentation(task, floor):
    # Terms that count for nothing by default count here.
    reward = {term["name"]: term["scale"] or 0.2 for term in TASKS[task]["rewards"]}
    robot = bb.Params.paper().replace(**floor)
    batch = bb.Batch(N, task, autoreset="disabled", seed=3, robot=robot, max_wheel_torque=0.5, reward=reward)
    lqr = bb.Lqr(batch.params(0).replace(max_wheel_torque=0.5), batch.control_dt)
    batch.reset()
    names = [term["name"] for term in TASKS[task]["rewards"]]
    signs = [-1.0 if term["cost"] else 1.0 for term in TASKS[task]["rewards"]]
    scales = {name: sign * batch.options["reward"][name] for name, sign in zip(names, signs, strict=True)}
    last = np.zeros((N, 3))
    recomputed = OF_TASKS[task]() if isinstance(OF_TASKS[task], type) else OF_TASKS[task]
    for step in range(STEPS):
        action = batch.control(lqr)
        # Different from the regulator's action, so that actions change.
        action = np.clip(action + 0.1 * np.sin(np.arange(3) + step), -1.0, 1.0).astype(np.float32)
        before = batch.command()
        _, rewards, terminated, _ = batch.step(action)
        assert not terminated.any()
        if (batch.command() != before).any():
            # The step was rewarded for the command before.
            last = action.astype(float)
            continue
        states = batch.states()
        expected = {
            **effort(states, action.astype(float), last),
            **recomputed(batch, states, batch.options),
        }
        if task == "openballbot":
            # Sums over steps of 2 ms.
            norm = squares(action.astype(float))
            expected = {"progress": expected["progress"], "alive": np.full(N, 5.0), "action": 5.0 * norm}
        terms = batch.reward_terms()
        assert set(names) == set(expected)
        for k, name in enumerate(names):
            np.testing.assert_allclose(terms[:, k], scales[name] * expected[name], rtol=1e-6, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(rewards, terms.sum(axis=1), rtol=1e-9)
        last = action.astype(float)
