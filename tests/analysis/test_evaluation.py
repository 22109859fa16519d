"""Controllers compared on one task."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._text_table import print_table
from ballbot_rs.analysis.episodes import compare, evaluate
from tests.support.policies import edited_policy

SHORT = {"model": "spatial", "max_episode_steps": 60}


def test_controllers_compared_with_a_policy_run_its_task(tiny_run):
    results = compare([str(tiny_run), "lqr"], episodes=2)
    assert [result.model for result in results] == ["spatial", "spatial"]
    assert results[0].control_dt == results[1].control_dt


def test_policies_of_different_tasks_are_not_compared(tiny_run, tmp_path):
    other = tmp_path / "other.zip"
    edited_policy(
        tiny_run / "final_model.zip", other, lambda data: data["ballbot_metadata"]["env_options"].update(model="planar")
    )
    with pytest.raises(ValueError, match="not the same task"):
        compare([str(tiny_run), str(other)], episodes=1)


@pytest.mark.parametrize("sim_dt", [0.001, 0.002])
def test_the_pid_runs_at_500_hz(sim_dt):
    assert evaluate("pid", episodes=1, **SHORT, sim_dt=sim_dt).control_dt == 0.002


def test_a_time_step_that_does_not_divide_the_period_of_the_controller_is_rejected():
    options = {**SHORT, "sim_dt": 0.005}
    with pytest.raises(ValueError, match=r"control_dt = 0\.002 s, which is not a multiple of sim_dt = 0\.005 s"):
        evaluate("pid", episodes=1, **options)
    assert evaluate("pid", episodes=1, **options, control_dt=0.005).control_dt == 0.005


@pytest.mark.parametrize("control_dt", [0.001, 0.0033, 0.0125])
def test_a_law_runs_at_its_rate_whatever_the_default_time_step(control_dt):
    """0.0033 s became 0.004 s, two of the task's time steps."""

    class Law:
        def __init__(self):
            self.control_dt = control_dt

        def __call__(self, state):  # noqa: ARG002
            return np.zeros(3)

    result = evaluate(Law(), episodes=1, model="contact", max_episode_steps=10)
    assert result.control_dt == control_dt
    shown = bb.simulate(Law(), seconds=10 * control_dt)
    np.testing.assert_allclose(shown.times, control_dt * np.arange(11), rtol=1e-12)


def test_the_same_starts_give_the_same_result():
    assert evaluate("lqr", episodes=3, **SHORT) == evaluate("lqr", episodes=3, **SHORT)
    assert evaluate("lqr", episodes=3, **SHORT) != evaluate("lqr", episodes=3, seed=5, **SHORT)


def test_metrics_belong_to_the_episode_that_left_its_tile():
    # Once off its tile a robot starts again, and has moved a short distance when the last robot leaves.
    hills = {"kind": "hills", "slope": 0.0, "tiles": 1, "tile": 5.0}
    options = {"terrain": hills, "speed": 1.0, "max_episode_steps": 1000}
    result = evaluate("lqr", task="openballbot", episodes=8, **options)
    assert result.survival_rate == 1.0
    # 2.5 m at up to 1 m/s, after an acceleration of 0.3 m/s².
    assert result.metrics["speed"] == pytest.approx(2.5 / (2.5 + 0.5 * 1.0 / 0.3), rel=0.15)
    least, most = result.metric_intervals["speed"]
    assert most - least < 0.1


def pushes(size, every=(3.0, 3.0)):
    push = {"term": "push", "range": [size, size], "direction": 0.0, "height": 0.1, "every": list(every)}
    return {"events": [push], **dict.fromkeys(("reset_tilt", "reset_yaw", "reset_ball_speed", "reset_tilt_rate"), 0.0)}


def test_the_recovery_time_matches_a_single_push():
    result = evaluate("lqr", episodes=2, **pushes(0.5), max_episode_steps=600)
    alone = bb.simulate("lqr", pushes=[bb.Push((0.5, 0.0, 0.0), time=3.0, point=(0.0, 0.0, 0.1))], seconds=6.0)
    tilts = [state.tilt for state in alone.states]
    away = np.linalg.norm(alone.of_states("ball_position")[:, :2], axis=1)
    outside = (np.array(tilts) > np.deg2rad(1.0)) | (away > 0.1)
    assert result.recovery_time == pytest.approx(alone.times[np.flatnonzero(outside)[-1]] + 0.01 - 3.0)
    assert result.recovery_limits == pytest.approx((np.deg2rad(1.0), 0.1))


def test_pushes_that_are_all_alike_are_counted():
    """Their random numbers do not change from episode to episode."""
    result = evaluate("lqr", episodes=3, **pushes(0.1, (1.0, 1.0)), max_episode_steps=550)
    assert result.pushes == 3 * 5
    assert evaluate("lqr", episodes=3, **SHORT).pushes == 0


def test_recovery_distinguishes_controllers_with_equal_success_rates():
    """Before, success under pushes was 0 % for both, because of a push in its last 2 s."""
    options = pushes(0.5, (2.4, 2.4))
    brisk, slow = compare(["lqr", bb.Lqr(position=0.6)], episodes=2, **options)
    assert brisk.success_rate == slow.success_rate == 0.0
    assert brisk.survival_rate == slow.survival_rate == 1.0
    assert brisk.recovery_time < 1.4
    assert slow.recovery_time is None or slow.recovery_time > 1.2 * brisk.recovery_time
    (fallen,) = compare(["zero"], episodes=2, **options, model="contact")
    assert fallen.recovery_time is None


def test_a_law_in_python_recovers_as_in_the_core():
    law = bb.Lqr()

    class Python:
        control_dt = 0.01

        def __call__(self, state):
            return law(state)

    options = {"events": "hard", "max_episode_steps": 400}
    python, core = (evaluate(one, episodes=4, **options) for one in (Python(), "lqr"))
    assert python.pushes == core.pushes > 0
    assert python.recovery_time == pytest.approx(core.recovery_time, abs=0.011)


def test_the_table_of_pushed_robots_has_recovery_in_place_of_settling(capsys):
    options = pushes(0.3)
    print_table([evaluate("lqr", episodes=1, **options)], "balance", options)
    shown = capsys.readouterr().out
    assert "recovery" in shown
    assert "settling" not in shown
    assert "After a push near the end no controller can succeed" in shown
    print_table([evaluate("lqr", episodes=1, **SHORT)], "balance", SHORT)
    assert "recovery" not in capsys.readouterr().out
