"""Several robots in one world, from Python."""

import copy
import itertools
import pickle

import numpy as np
import pytest

import ballbot_rs as bb

APART = [(0.0, 0.0), (0.6, 0.0)]


def _collided() -> bb.Crowd:
    crowd = bb.Crowd(["paper", "rezero"], APART, friction=0.4, restitution=0.2)
    crowd.push(0, (6.0, 0.0, 0.0))
    for _ in range(1000):
        crowd.step(np.zeros((2, 3)))
        if crowd.force_between(0, 1).any():
            return crowd
    raise AssertionError("the robots did not meet")


def test_robots_touch() -> None:
    crowd = _collided()
    on_second, on_first = crowd.force_between(0, 1), crowd.force_between(1, 0)
    assert on_second[0] > 0.0
    np.testing.assert_allclose(on_second, -on_first, rtol=1e-9)
    assert not crowd.force_between(0, 0).any()


def test_a_law_of_each_keeps_them_upright() -> None:
    crowd = bb.Crowd(["paper", "kugle", "asroballet"], [(0.0, 0.0), (0.8, 0.0), (0.0, 0.8)])
    laws = [bb.Lqr(params, control_dt=0.01) for params in crowd.params]
    crowd.push(0, (0.5, 0.2, 0.0))
    starts = crowd.states
    for _ in range(300):
        crowd.step(
            [
                law(state, position=start.ball_position[:2])
                for law, state, start in zip(laws, crowd.states, starts, strict=True)
            ],
            steps=10,
        )
    assert max(state.tilt for state in crowd.states) < 0.05
    assert crowd.energy.shape == (3,)
    assert crowd.payloads.shape == (3, 2, 6)
    assert all(contacts.floor_force[2] > 1.0 for contacts in crowd.contacts)


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda crowd: pickle.loads(pickle.dumps(crowd))])
def test_a_copy_continues(duplicate) -> None:
    crowd = _collided()
    other = duplicate(crowd)
    for one in (crowd, other):
        one.step(np.full((2, 3), 0.05), 200)
    assert crowd.states == other.states
    assert (crowd.friction, crowd.restitution, len(crowd)) == (other.friction, other.restitution, 2)
    other.reset()
    assert other.time == 0.0
    assert [tuple(state.ball_position[:2]) for state in other.states] == APART


def test_a_whole_heap() -> None:
    """Twelve robots fall on each other without interpenetrating, and nothing diverges."""
    places = list(itertools.product((0.0, 0.45, 0.9, 1.35), (0.0, 0.45, 0.9)))
    crowd = bb.Crowd(["paper"] * len(places), places, friction=0.5)
    for robot, (x, y) in enumerate(places):
        crowd.push(robot, (4.0 * (0.7 - x), 4.0 * (0.45 - y), 0.0), point=(0.0, 0.0, 0.5))
    for _ in range(30):
        crowd.step(np.zeros((len(places), 3)), 50)
        states = crowd.states
        balls = np.array([state.ball_position for state in states])
        gaps = np.linalg.norm(balls[:, None] - balls, axis=-1)[np.triu_indices(len(places), 1)]
        assert gaps.min() > 2 * crowd.params[0].ball_radius - 5e-3
    assert max(state.tilt for state in states) > 1.0


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: bb.Crowd("paper", [(0, 0)]), TypeError, "robots must be a list of robots, not one robot"),
        (lambda: bb.Crowd([], np.zeros((0, 2))), ValueError, "number of robots = 0"),
        (lambda: bb.Crowd(["paper"] * 65, [(i, 0) for i in range(65)]), ValueError, "number of robots = 65.* 64"),
        (lambda: bb.Crowd(["paper"] * 2, [(0, 0)]), ValueError, "positions"),
        (lambda: bb.Crowd(["paper"] * 2, [(0, 0), (0.05, 0)]), ValueError, "robots 0 and 1 overlap by"),
        (lambda: bb.Crowd(["paper"], [(0, 0)], terrain={"kind": "wav"}), ValueError, "unknown kind of terrain"),
        (lambda: bb.Crowd(["paper"], [(0, 0)], frction=1), TypeError, "friction"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).push(1, (0, 0, 0)), ValueError, "robot = 1 .* robots 0 to 0"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).push(-1, (0, 0, 0)), ValueError, "robot = -1"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).force_between(0, 2), ValueError, "on = 2 .* robots 0 to 0"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).step(np.zeros(3)), ValueError, r"wheel_torques has shape \(3,\)"),
        (
            lambda: bb.Crowd(["paper"], [(0, 0)]).step([[9e9, 0, 0]]),
            ValueError,
            r"wheel_torques\[0\]\[0\] = 9000000000 .* within",
        ),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).reset([]), ValueError, "states"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).reset([3]), TypeError, r"states\[0\] must be a State, not int"),
        (lambda: bb.Crowd(["paper"], [(0, 0)]).restore(b"x"), ValueError, "snapshot of a crowd"),
    ],
)
def test_bad_input(call, error, words) -> None:
    with pytest.raises(error, match=words):
        call()


def test_payloads_of_a_crowd_are_checked() -> None:
    loaded = bb.Params.paper().with_payload(0.3, position=(0.0, 0.0, 0.3), stiffness=90.0)
    crowd = bb.Crowd([loaded, "paper"], [(0.0, 0.0), (1.0, 0.0)])
    crowd.move_payload(0, (0.01, 0.0, 0.0))
    crowd.step(np.zeros((2, 3)), 50)
    assert crowd.payloads[0, 0, 0] > 1e-3
    before = crowd.payloads
    for robot, payload in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match="payload_mass = 0 kg"):
            crowd.move_payload(robot, (0.0, 0.0, 0.0), payload=payload)
    with pytest.raises(ValueError, match=r"payloads has shape \(1, 2, 6\), expected \(2, 2, 6\)"):
        crowd.set_payloads(np.zeros((1, 2, 6)))
    with pytest.raises(ValueError, match=r"payloads\[1\]\[0\] must be zero"):
        crowd.set_payloads(np.full((2, 2, 6), [[[0.01] * 6, [0.0] * 6]]))
    np.testing.assert_array_equal(crowd.payloads, before)
    crowd.set_payloads(np.zeros((2, 2, 6)))
    np.testing.assert_allclose(crowd.payloads, 0.0, atol=1e-15)
