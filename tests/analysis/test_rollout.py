"""Controllers as objects, rollouts and settling times."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.analysis.rollout import batch_for, rollout
from ballbot_rs.analysis.settling import censored_median, push_recovery_times, recovery_times, settling_times
from ballbot_rs.control.resolve import find

SHORT = {"model": "spatial", "max_episode_steps": 60}


class Proportional:
    """A user's own controller."""

    name = "mine"

    def __init__(self):
        self.regulator = bb.Lqr()

    def __call__(self, state):
        return self.regulator(state)

    def __deepcopy__(self, memo):
        return Proportional()


class Counting:
    """A controller with a memory: its torque grows with its calls."""

    def __init__(self):
        self.calls = 0

    def reset(self):
        self.calls = 0

    def __call__(self, _, position=None):
        assert position is not None
        self.calls += 1
        return np.full(3, 1e-4 * self.calls)


def test_an_object_is_compared_like_a_name():
    named, mine, regulator = bb.compare(["lqr", Proportional(), bb.Lqr()], episodes=3, **SHORT)
    assert (mine.controller, regulator.controller) == ("mine", "lqr")
    assert vars(regulator) == vars(named)
    assert mine.success_rate == named.success_rate
    assert mine.tilt_rms == pytest.approx(named.tilt_rms, rel=1e-6)


def test_a_function_is_a_controller():
    def still(_):
        return [0.0, 0.0, 0.0]

    named, mine = bb.compare(["zero", still], episodes=2, **SHORT)
    assert vars(mine) == {**vars(named), "controller": "still"}


def test_each_robot_has_separate_memory_and_each_run_starts_with_new_memory():
    law = Counting()
    results = [bb.evaluate(law, episodes=4, **SHORT) for _ in range(2)]
    assert results[0] == results[1]
    alone = bb.simulate(law, seconds=0.1, model="spatial", tilt=(0.05, 0.0))
    np.testing.assert_allclose(alone.torques[:5, 0], 1e-4 * np.arange(1, 6), rtol=1e-5)


def test_an_object_runs_at_its_rate():
    shown = bb.simulate(bb.Pid(control_dt=0.002), seconds=0.5, **SHORT, tilt=(0.05, 0.0))
    named = bb.simulate("pid", seconds=0.5, **SHORT, tilt=(0.05, 0.0))
    np.testing.assert_array_equal(shown.torques, named.torques)
    assert shown.times[1] == pytest.approx(0.002)


def test_a_pid_object_runs_on_several_robots():
    mine, named = (bb.evaluate(pid, episodes=4, **SHORT) for pid in (bb.Pid(), "pid"))
    assert vars(mine) == vars(named)


class Uncopied(Counting):
    def __deepcopy__(self, memo):
        raise TypeError("one of a kind")


def test_objects_that_cannot_be_copied_are_rejected_for_several_robots():
    with pytest.raises(TypeError, match="uncopied cannot be copied for 2 robots: one of a kind"):
        bb.evaluate(Uncopied(), episodes=2, **SHORT)


@pytest.mark.parametrize("source", ["lqr", Proportional()], ids=["in the core", "in Python"])
def test_chunks_of_a_rollout_equal_steps_of_the_batch(source):
    controller = find(source)
    batch, twin = (batch_for(controller, 3, task="balance", num_threads=1, seed=4, options=SHORT) for _ in range(2))
    twin.reset()
    steps = 0
    for chunk in rollout(batch, controller, 70):
        assert chunk.first == steps
        for i in range(len(chunk)):
            np.testing.assert_array_equal(chunk.states[i], twin.states())
            _, rewards, terminated, truncated = twin.step((chunk.torques[i] / twin.max_wheel_torque).astype(np.float32))
            np.testing.assert_array_equal(chunk.rewards[i], rewards)
            np.testing.assert_array_equal(chunk.truncated[i], truncated)
            assert not (chunk.success[i] & ~(terminated | truncated)).any()
            steps += 1
    assert steps == 70


@pytest.mark.parametrize(
    ("series", "expected"),
    [
        ([0, 0, 0], 0.0),
        ([2, 0, 0], 0.1),
        ([0, 2, 0], 0.2),
        ([0, -2, 0.5], 0.2),
        ([0, 0, 2], np.inf),
        ([2, np.nan], 0.1),
    ],
)
def test_settling_time(series, expected):
    assert settling_times(series, 1.0, 0.1) == pytest.approx(expected)
    columns = np.column_stack([series, np.zeros(len(series))])
    assert settling_times(columns, 1.0, 0.1) == pytest.approx([expected, 0.0])


def test_the_seed_of_a_trajectory_seeds_its_events():
    events = {"events": "mild", "max_episode_steps": 20}
    drawn = [bb.simulate("lqr", seconds=0.1, **events, seed=seed, tilt=(0.05, 0.0)) for seed in (0, 0, 5)]
    assert drawn[0].params == drawn[1].params != drawn[2].params
    assert np.array_equal(drawn[0].torques, drawn[1].torques)
    batch = bb.Batch(1, events="mild", seed=5)
    batch.reset()
    assert drawn[2].params == batch.params(0)
    for seed in (-1, 2**64, 1.5):
        with pytest.raises((ValueError, TypeError), match="seed"):
            bb.simulate("lqr", seconds=0.1, seed=seed, tilt=(0.05, 0.0))


def test_a_controller_in_a_python_file_is_taken_by_path(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "import ballbot_rs as bb\n\nregulator = bb.Lqr()\n\n\nclass Mine:\n"
        "    def __call__(self, state):\n        return regulator(state)\n",
        encoding="utf-8",
    )
    named, mine, shared = bb.compare(["lqr", f"{file}:Mine", f"{file}:regulator"], episodes=2, **SHORT)
    assert mine.controller == f"{file}:Mine"
    assert mine.success_rate == named.success_rate
    assert vars(shared) == {**vars(named), "controller": f"{file}:regulator"}
    with pytest.raises(ValueError, match="has no Mime: did you mean 'Mine'"):
        find(f"{file}:Mime")
    with pytest.raises(FileNotFoundError, match="no Python file at"):
        find(f"{tmp_path}/other.py:Mine")
    with pytest.raises(ValueError, match="unknown controller"):
        find(f"{file}:Mine", trusted=False)


def test_a_recovery_needs_a_second_within_the_limits():
    outside = np.zeros(60, dtype=bool)
    outside[[12, 25, 26, 55]] = True
    pushed = np.zeros(60, dtype=bool)
    pushed[[10, 20, 30]] = True
    times, known = push_recovery_times(outside, pushed, False, 0.1)
    assert times == pytest.approx([0.3, 0.7, 2.6])
    # Within the limits for 0.8 s, 0.4 s and 0.4 s: too short.
    assert known.tolist() == [False, False, False]
    times, known = push_recovery_times(outside[:50], pushed[:50], False, 0.1)
    assert times == pytest.approx([0.3, 0.7, 0.0])
    assert known.tolist() == [False, False, True]
    times, known = push_recovery_times(outside[:50], pushed[:50], True, 0.1)
    assert times[-1] == np.inf
    assert known[-1]
    assert recovery_times([2.0, *[0.0] * 10], 1.0, 0.1) == pytest.approx(0.1)
    assert recovery_times([2.0, *[0.0] * 9], 1.0, 0.1) == np.inf


def test_the_median_of_censored_times():
    times = np.array([6, 6, 6, 7, 10, 13, 16, 22, 23, 6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35], dtype=float)
    # Freireich et al., Blood 21, 1963: remission under 6-MP, the example of Kaplan-Meier curves, median 23 weeks.
    known = np.arange(len(times)) < 9
    assert censored_median(times, known) == 23.0
    assert censored_median(times, np.ones_like(known)) == np.median(times)
    assert censored_median(np.array([1.0, np.inf, np.inf]), np.ones(3, dtype=bool)) == np.inf
