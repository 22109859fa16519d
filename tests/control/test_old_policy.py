"""A policy exported by 0.1.0 acts on observations in their units, with 1 N·m an action."""

from pathlib import Path

import pytest

import ballbot_rs as bb

pytest.importorskip("onnxruntime")

OLD = Path(__file__).with_name("policy_0_1_0.onnx")


def test_policy_of_0_1_0_still_balances() -> None:
    policy = bb.OnnxPolicy(str(OLD))
    assert policy.env_options["scale_observations"] is False
    assert policy.env_options["max_wheel_torque"] == 1.0
    result = bb.evaluate(str(OLD), episodes=20, model="contact")
    assert result.success_rate == 1.0, result
