"""The closed forms of the page on off-nominal robots hold, and its edges are where robots begin to fall."""

from types import SimpleNamespace

import pytest

pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")

from validation.robots import (
    BODY,
    MOTORS,
    com_offset,
    delay,
    friction,
    lag,
    payload,
    perturbed_floor,
    preload,
    products_of_inertia,
    ripple,
    rollers,
    rolling,
    slope,
    strength,
    sweep,
    torque_speed,
    uneven_wheels,
)

MODULES = (
    com_offset,
    products_of_inertia,
    uneven_wheels,
    friction,
    preload,
    rolling,
    rollers,
    ripple,
    slope,
    perturbed_floor,
    payload,
    delay,
    strength,
    lag,
    torque_speed,
)


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.rpartition(".")[2])
def test_claims_hold(module) -> None:
    claims = module.claims()
    assert claims
    assert not [str(claim) for claim in claims if not claim.holds]


def test_every_effect_is_on_the_page() -> None:
    assert {topic.name for topic in (*BODY, *MOTORS)} == {module.__name__.rpartition(".")[2] for module in MODULES}


@pytest.mark.parametrize(
    ("values", "threshold", "edge"),
    [
        ((0.0, 1.0, 2.0, 3.0), 1.7, 1.7),
        # From strong to weak, as strengths are.
        ((1.0, 0.5, 0.25), 0.4, 0.4),
        ((0.0, 1.0), 5.0, None),
    ],
)
def test_an_edge_is_found_between_the_values(monkeypatch, values, threshold, edge) -> None:
    """Here robots fall beyond a threshold."""
    falls = (lambda value: value > threshold) if values[0] < values[-1] else (lambda value: value < threshold)

    def evaluate(source, *, episodes, value):  # noqa: ARG001
        rate = 0.9 if falls(value) else 1.0
        return SimpleNamespace(survival_rate=rate, success_rate=0.5 * rate, ball_rms=0.01)

    monkeypatch.setattr(sweep.bb, "evaluate", evaluate)
    measured = sweep.Measured(sweep.Sweep("value", values, lambda value: {"value": value}, 0.01, "--nothing"))
    for name in ("LQR", "policy"):
        found = measured.edges[name]
        assert found is None if edge is None else abs(found - edge) <= 0.01
    assert measured.markdown().count("\n| ") == len(values) + 2
    assert ("| none |" in measured.markdown()) == (edge is None)


def test_a_sampled_parameter_does_not_change_the_controllers_of_the_nominal_robot() -> None:
    from ballbot_rs import Batch

    batch = Batch(1, **sweep.drawn("body_com_offset", "abs", (0.002, 0.0)))
    assert batch.params(0).body_com_offset == (0.002, 0.0)
    assert batch.nominal_params(0) == sweep.PAPER
    batch = Batch(1, **sweep.drawn("wheel_dynamic_friction", "abs", 0.5))
    assert batch.params(0) == friction.with_friction(0.5)
