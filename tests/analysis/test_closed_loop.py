"""The closed loop runs controllers of the core and in Python alike, and continues from call to call."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.analysis.actors import core_law, make_actor
from ballbot_rs.analysis.closed_loop import CONTACTS, ClosedLoop
from ballbot_rs.control.resolve import find

ROBOTS, STEPS = 3, 40
RECORD = ("states", "torques", "rewards", "terminated", "truncated", *CONTACTS)
POINTS = np.tile([0.0, 0.05, 0.1], (ROBOTS, 1))
REFERENCES = [bb.Reference.circle(0.3, period) for period in (8.0, 9.0, 10.0)]


class Mine:
    """LQR as a controller in Python, one object per robot."""

    def __init__(self, robot, control_dt):
        self.law = bb.Lqr(robot, control_dt, max_torque=robot.max_wheel_torque)

    def __call__(self, state, setpoint):
        return self.law(state, {part: setpoint[part] for part in self.law.setpoint_parts})


def pushes():
    impulses = np.zeros((STEPS, ROBOTS, 3))
    impulses[7, 1] = (0.2, -0.1, 0.0)
    return impulses


def loop(source):
    batch = bb.Batch(ROBOTS, num_threads=1, max_wheel_torque=bb.Params.paper().max_wheel_torque)
    controller = find(source)
    made = ClosedLoop(batch, core_law(controller, batch) or make_actor(controller, batch))
    made.reset(starts=[bb.State.at_equilibrium(bb.Params.paper(), tilt=(0.02 * i, -0.03)) for i in range(ROBOTS)])
    return made


@pytest.mark.parametrize("setpoints", [None, {"position": np.array([[0.2, 0.0], [0.0, 0.1], [0.0, 0.0]])}, REFERENCES])
def test_a_controller_in_python_has_the_rows_of_the_core(setpoints):
    core, mine = (loop(source).rows(STEPS, RECORD, setpoints, pushes(), POINTS) for source in ("lqr", Mine))
    assert core.keys() == mine.keys()
    for name, values in core.items():
        assert values.shape == mine[name].shape, name
        np.testing.assert_allclose(mine[name], values, atol=1e-3 if name in CONTACTS else 1e-5, err_msg=name)


@pytest.mark.parametrize("source", ["lqr", Mine])
def test_consecutive_parts_equal_the_whole_run(source):
    whole = loop(source).rows(STEPS, RECORD, REFERENCES, pushes(), POINTS)
    one = loop(source)
    parts = [one.rows(10, RECORD, REFERENCES, pushes()[k : k + 10], POINTS) for k in range(0, STEPS, 10)]
    for name in ("torques", "rewards"):
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), whole[name])
    np.testing.assert_array_equal(parts[-1]["states"][-1], whole["states"][-1])


def test_actions_are_applied_in_order():
    batch = bb.Batch(1, num_threads=1)
    actions = iter([np.full((1, 3), 0.01 * i, dtype=np.float32) for i in range(5)])
    loop = ClosedLoop(batch, lambda *_: next(actions))
    loop.reset()
    calls = []
    steps = loop.steps(5, before_decision=lambda k: calls.append(("decide", k)), before_motion=calls.append)
    assert [float(step.actions[0, 0]) for step in steps] == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])
    assert calls == [one for k in range(5) for one in (("decide", k), k)]
