"""The benchmark's task in NumPy, a second derivation of the balance task, against this simulator's."""

from validation.benchmarks.comparability import task_error


def test_observations_rewards_and_falls_match_the_simulator() -> None:
    found = task_error()["task"]
    assert found["falls"] > 10, "too few falls to compare"
    assert found["falls_disagreeing"] == 0
    assert found["observation"] <= 1e-6
    assert found["reward"] <= 1e-6
