"""Controllers in Python: their forms, in rollouts and in the viewer, and errors of invalid controllers."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.control.laws import Laws, followed_parts
from ballbot_rs.control.resolve import find
from ballbot_rs.viewer.session.drivers import LawDriver

PARAMS = bb.Params.paper()
SHORT = {"model": "spatial", "max_episode_steps": 60, "setpoint": (0.05, -0.02)}


class WithSetpoint:
    def __init__(self, robot, control_dt):
        self.regulator = bb.Lqr(robot, control_dt)

    def __call__(self, state, setpoint):
        return self.regulator(state, **setpoint)


class WithPosition:
    def __init__(self, control_dt, robot):
        self.regulator = bb.Lqr(robot, control_dt)

    def __call__(self, state, position):
        return self.regulator(state, position=position)


class Batched:
    """LQR of all robots at once; `resets` are the masks it was given."""

    batched = True

    def __init__(self, robot, control_dt):
        self.law = bb.Lqr(robot, control_dt)
        self.resets, self.shapes = [], set()

    def __call__(self, states, setpoints):
        self.shapes.add((states.shape, *(setpoints[part].shape for part in ("position", "snap", "yaw"))))
        rows = [bb.State.from_array(row) for row in states]
        return [self.law(row, position=place) for row, place in zip(rows, setpoints["position"], strict=True)]

    def reset(self, mask):
        self.resets.append(mask.tolist())


@pytest.mark.parametrize("form", [WithSetpoint, WithPosition, Batched])
def test_each_form_does_what_the_core_does(form):
    """The same LQR, so the same numbers; both run at the rate of the task."""
    core, mine = bb.compare(["lqr", form], episodes=3, **SHORT)
    assert mine.controller == form.__name__.lower()
    assert mine.tilt_rms == pytest.approx(core.tilt_rms, rel=1e-5)
    assert mine.ball_rms == pytest.approx(core.ball_rms, rel=1e-5)
    assert mine.torque_rms == pytest.approx(core.torque_rms, rel=1e-4)


def test_a_class_is_made_with_the_robot_and_the_rate():
    found = {}

    class Asking:
        control_dt = 0.004

        def __init__(self, robot, control_dt):
            found.update(robot=robot, control_dt=control_dt)

        def __call__(self, state):  # noqa: ARG002
            return np.zeros(3)

    result = bb.evaluate(Asking, episodes=2, robot="kugle", max_episode_steps=5)
    assert result.control_dt == found["control_dt"] == 0.004
    assert found["robot"].ball_mass == bb.Params.preset("kugle").ball_mass


def test_a_batched_controller_has_arrays_and_is_notified_of_new_episodes():
    law = Batched(PARAMS, 0.01)
    batch = bb.Batch(3, model="spatial", max_episode_steps=20, num_threads=1)
    from ballbot_rs.analysis.rollout import rollout

    for _ in rollout(batch, find(law), 41):
        pass
    assert law.shapes == {((3, 32), (3, 2), (3, 2), (3,))}
    assert law.resets == [[True] * 3] * 3


@pytest.mark.parametrize(
    ("law", "follows"),
    [
        (lambda state: state, ()),
        (lambda state, gain=2.0: gain, ()),  # noqa: ARG005
        (lambda state, position=None: position, ("position",)),  # noqa: ARG005
        (lambda state, *, yaw, position: yaw, ("yaw", "position")),  # noqa: ARG005
        (lambda state, desired: desired, tuple(bb.Setpoint())),  # noqa: ARG005
        (lambda state, setpoint=None: setpoint, tuple(bb.Setpoint())),  # noqa: ARG005
        (bb.Pid(), ("tilt",)),
    ],
)
def test_the_parts_that_a_controller_follows_are_in_its_signature(law, follows):
    assert followed_parts(law) == follows


@pytest.mark.parametrize("batched", [False, True])
def test_torques_beyond_the_limit_keep_their_direction_in_rollouts_and_in_the_viewer(batched):
    desired = np.array([30.0, -10.0, 5.0])

    def law(states):
        return np.tile(desired, (len(states), 1)) if batched else desired

    law.batched = batched
    batch = bb.Batch(1, model="spatial")
    shown = bb.simulate(law, model="spatial", seconds=0.02)
    limit = shown.params.max_wheel_torque
    np.testing.assert_allclose(shown.torques[0], desired * limit / 30.0, rtol=1e-6)
    driver = LawDriver(find(law), PARAMS, 2)
    torques = driver.torques([batch.state(0)] * 2, (0.0, 0.0))
    np.testing.assert_allclose(torques, [desired * PARAMS.max_wheel_torque / 30.0] * 2)
    small = Laws("small", lambda: lambda state: desired / 100.0, 1, limit)  # noqa: ARG005
    np.testing.assert_array_equal(small.torques([batch.state(0)], [bb.Setpoint()])[0], desired / 100.0)


def test_the_viewer_gives_each_robot_its_setpoint():
    driver = LawDriver(find(lambda state, setpoint: [*setpoint.position, setpoint["yaw"]]), PARAMS, 2)  # noqa: ARG005
    assert driver.follows_position
    states = [bb.State.at_rest(PARAMS)] * 2
    np.testing.assert_array_equal(driver.torques(states, [[0.1, 0.2], [0.3, 0.0]]), [[0.1, 0.2, 0.0], [0.3, 0.0, 0.0]])


class Remembering:
    """Counts its calls, and cannot forget."""

    def __init__(self):
        self.calls = 0

    def __call__(self, _):
        self.calls += 1
        return np.full(3, 1e-3 * self.calls)


def test_the_viewer_instantiates_a_controller_class_again_for_one_robot():
    driver = LawDriver(find(Remembering), PARAMS, 2)
    states = [bb.State.at_rest(PARAMS)] * 2
    driver.torques(states, (0.0, 0.0))
    driver.reset(1)
    np.testing.assert_allclose(driver.torques(states, (0.0, 0.0))[:, 0], [2e-3, 1e-3])


def divides(_):
    return 1 / 0


def resets_badly(_):
    return np.zeros(3)


def refuse():
    raise RuntimeError("no")


resets_badly.reset = refuse


class Unmade:
    def __init__(self):
        raise RuntimeError("no license")

    def __call__(self, state):
        return state


class Demanding(Unmade):
    def __init__(self, robot, gain):
        pass


class Uncalled:
    pass


class Former:
    def __init__(self, params=None):
        self.params = params

    def __call__(self, state):
        return 0.0 * state.wheel_speeds


class Timeless:
    control_dt = -1.0

    def __call__(self, state):
        return state


@pytest.mark.parametrize(
    ("law", "error", "message"),
    [
        (divides, bb.ControllerError, "divides failed: ZeroDivisionError: division by zero"),
        (resets_badly, bb.ControllerError, "resets_badly failed: RuntimeError: no"),
        (Unmade, bb.ControllerError, "unmade failed: RuntimeError: no license"),
        (Demanding, TypeError, "demanding cannot be made: gain has no default"),
        (Former, TypeError, "former takes params: it is now robot"),
        (Uncalled, TypeError, "uncalled is not a class of controllers: its objects cannot be called"),
        (Timeless, ValueError, "timeless has control_dt = -1.0: it must be positive and finite"),
        (lambda _: [0.0, 0.0], ValueError, r"<lambda> gave torques of shape \(2,\): expected \(3,\), N·m"),
        (lambda _: "abc", TypeError, r"<lambda> gave 'abc': expected wheel torques of shape \(3,\), N·m"),
        (lambda _: ["1", "2", "3"], TypeError, r"<lambda> gave an array of dtype <U1: expected wheel torques"),
        (lambda _: np.ma.masked_all(3), TypeError, r"<lambda> gave a masked array: expected wheel torques .* fill it"),
        (lambda _: [0.1, np.ma.masked, 0.0], TypeError, r"<lambda> gave a masked array"),
        (lambda _: np.zeros(3, complex), TypeError, r"dtype complex128: expected wheel torques"),
        (lambda _: [None, 0.0, 0.0], TypeError, r"dtype object: expected wheel torques"),
        (
            lambda _: [0.0, np.nan, 0.0],
            ValueError,
            r"<lambda> gave the torques \[ 0. nan  0.\] N·m: they must be finite",
        ),
    ],
)
def test_a_bad_law_is_named(law, error, message):
    with pytest.raises(error, match=message):
        bb.evaluate(law, episodes=1, **SHORT)


def test_a_batched_law_of_a_wrong_shape_is_named():
    def flat(states):  # noqa: ARG001
        return np.zeros(3)

    flat.batched = True
    with pytest.raises(ValueError, match=r"flat gave torques of shape \(3,\): expected \(2, 3\), N·m"):
        bb.evaluate(flat, episodes=2, **SHORT)


def test_a_file_may_have_a_dataclass_and_is_made_for_the_robot(tmp_path):
    (tmp_path / "numpy.py").write_text(
        "from __future__ import annotations\nimport dataclasses\nimport ballbot_rs as bb\n\n\n"
        "@dataclasses.dataclass\nclass Mine:\n    robot: bb.Params\n    control_dt: float\n\n"
        "    def __post_init__(self):\n        self.law = bb.Lqr(self.robot, self.control_dt)\n\n"
        "    def __call__(self, state, setpoint):\n        return self.law(state, **setpoint)\n",
        encoding="utf-8",
    )
    core, mine = bb.compare(["lqr", f"{tmp_path}/numpy.py:Mine"], episodes=2, **SHORT)
    assert mine.tilt_rms == pytest.approx(core.tilt_rms, rel=1e-5)


def test_a_setpoint_is_read_only_and_checked():
    setpoint = bb.Setpoint(position=(1, 2), yaw=np.float32(0.5))
    assert dict(setpoint)["yaw"] == 0.5
    assert setpoint["position"].tolist() == [1.0, 2.0]
    assert "tilt" not in setpoint
    assert setpoint == bb.Setpoint(position=(1, 2), yaw=0.5) == dict(setpoint)
    assert setpoint not in (bb.Setpoint(position=(1, 2)), 3)
    with pytest.raises(ValueError, match="read-only"):
        setpoint.position[0] = 3.0
    with pytest.raises(ValueError, match=r"velocity of a setpoint has the shape \(3,\), expected \(2,\)"):
        bb.Setpoint(velocity=(1, 2, 3))
    with pytest.raises(ValueError, match="yaw of a setpoint is nan"):
        bb.Setpoint(yaw=float("nan"))
