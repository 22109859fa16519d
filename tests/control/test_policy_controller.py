"""Policies as controllers in Rust: they act as in ONNX Runtime, and follow setpoints."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import _policy_controller
from ballbot_rs.control import network_file
from ballbot_rs.control.onnx_policy import ACTING, FOLLOWING
from ballbot_rs.control.resolve import find
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.viewer.session.drivers import PolicyDriver

POLICIES = Path("assets/policies")
NAMES = sorted(path.stem for path in POLICIES.glob("*.onnx") if bb.OnnxPolicy(path).task in FOLLOWING)


@pytest.mark.parametrize(("name", "robot"), [*((name, "paper") for name in NAMES), ("balance-any", "rezero")])
def test_a_controller_acts_as_onnx_runtime(name: str, robot: str) -> None:
    policy = bb.OnnxPolicy(POLICIES / f"{name}.onnx")
    law = policy.controller(robot)
    # The task push pushes.
    task = "balance" if policy.task == "push" else policy.task
    alike = {option: policy.env_options[option] for option in (*ACTING, "history") if option in policy.env_options}
    batch = new_batch(1, task=task, num_threads=1, options={**alike, "robot": robot, "sim_dt": 0.002})
    observations = batch.reset(seeds=[3])
    # Beyond the oldest observation of the history.
    for _ in range(40):
        state = bb.State.from_array(batch.states()[0])
        setpoint = {part: value for part, value in batch.setpoint(0).items() if part in law.setpoint_parts}
        if policy.task == "velocity":
            forward, left, rate = batch.command(0)
            cos, sin = np.cos(state.yaw), np.sin(state.yaw)
            setpoint = {"velocity": (cos * forward - sin * left, sin * forward + cos * left), "yaw_rate": rate}
        if "yaw" in law.setpoint_parts:
            setpoint["yaw"] = state.yaw
        action = policy.act(observations)
        np.testing.assert_allclose(law(state, **setpoint), action[0] * batch.max_wheel_torque, atol=1e-5)
        observations = batch.step(action)[0]


def test_the_page_moves_a_robot_that_rests_off_its_setpoint_as_the_controller_does() -> None:
    path, robot = POLICIES / "balance-any.onnx", bb.Params.preset("kugle")
    policy = bb.OnnxPolicy(path)
    assert policy.env_options["integral_rate"] > 0.0
    law, driver = policy.controller(robot), PolicyDriver(find(str(path)), robot, 1)
    rest = bb.State.at_rest(robot)

    def at(x: float, y: float) -> bb.State:
        place = np.array([x, y, 0.0])
        return rest.replace(ball_position=rest.ball_position + place, body_position=rest.body_position + place)

    def agreed(places: list[bb.State]) -> np.ndarray:
        expected = np.array([law(state) for state in places])
        torques = np.array([driver.torques([state], (0.0, 0.0))[0] for state in places])
        np.testing.assert_allclose(torques, expected, atol=1e-5 * driver.max_torque)
        law.reset()
        driver.reset()
        return torques

    torques = agreed([at(0.03, -0.02)] * 300)
    # The history has nothing new after 0.6 s.
    assert np.abs(torques[-1] - torques[70]).max() > 0.02 * driver.max_torque
    agreed([at(3.0, 0.3)] * 300)
    # From one side to the other, beyond all limits.
    agreed([at(0.3, 0.1)] * 600 + [at(-0.9, 0.2)] * 100)


def test_the_rate_of_an_integral_follows_the_robot() -> None:
    kugle = bb.Params.preset("kugle")
    for by_robot, time in ((False, 1.0), (True, kugle.scale("s"))):
        batch = bb.Batch(1, robot=kugle, integral_rate=0.8, scale_by_robot=by_robot, num_threads=1)
        assert batch.integral is not None
        assert batch.integral["rate"] == pytest.approx(0.008 / time)
    assert bb.Batch(1, num_threads=1).integral is None


def test_robots_follow_a_circle_together_and_alone() -> None:
    policy = bb.OnnxPolicy(POLICIES / "balance-any.onnx")
    for robot, limit in (("paper", 0.03), ("kugle", 0.03), ("asroballet", 0.03), ("rezero", 0.06)):
        law = policy.controller(robot)
        assert law.setpoint_parts == bb.Controller("lqr", robot).setpoint_parts
        circle = bb.Reference.circle(radius=0.5, period=12.0, robot=robot)
        alone = bb.simulate(law, robot=robot, seconds=12.0, reference=circle)
        assert alone.fell_at is None
        assert alone.metrics().position_error_rms < limit
        batch = bb.Batch(3, robot=robot, reset_tilt=0.02)
        batch.reset()
        found = batch.rollout(policy.controller(robot), 900, circle, record=("states", "terminated"))
        assert not found["terminated"].any()
        error = found["states"][-1, :, :2] - circle(9.0)["position"]
        assert np.linalg.norm(error, axis=1).max() < 3.0 * limit


def test_in_another_task_a_policy_follows_the_setpoints_of_the_task() -> None:
    source = str(POLICIES / "balance-any.onnx")
    assert find(source, task="balance").policy is not None
    result = bb.evaluate(source, task="velocity", episodes=10, yaw_rate=0.0, speed=0.2)
    assert result.survival_rate == 1.0
    assert result.metrics["velocity_error"] < 0.04


def test_a_robot_that_turns_on_a_ball_that_spins_keeps_its_heading() -> None:
    # Turned by the policy alone, its heading oscillates by 0.11 rad/s, and its velocity by 0.049 m/s.
    result = bb.evaluate(str(POLICIES / "balance-any.onnx"), task="velocity", episodes=20, robot="kugle", speed=0.5)
    assert result.survival_rate == 1.0
    assert result.metrics["velocity_error"] < 0.02
    assert result.metrics["yaw_rate_error"] < 0.01


def test_what_is_not_a_controller_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="task of a policy that follows setpoints 'path'"):
        bb.OnnxPolicy(POLICIES / "path.onnx").controller()
    with pytest.raises(ValueError, match="trained for another environment"):
        find(str(POLICIES / "path.onnx"), task="balance")
    onnx = pytest.importorskip("onnx")
    model = onnx.load(POLICIES / "balance.onnx")
    for node in model.graph.node:
        node.op_type = "Relu" if node.op_type == "Tanh" else node.op_type
    onnx.save(model, tmp_path / "relu.onnx")
    with pytest.raises(ValueError, match=r"operators Gemm, Relu, .* dense layers with tanh"):
        bb.OnnxPolicy(tmp_path / "relu.onnx").controller()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"task": "path"}, "'path'"),
        ({"layers": []}, "no layer"),
        ({"layers": [(np.zeros((1, 3, 16)),)]}, "pair"),
        ({"layers": [(np.zeros((3, 16)), np.zeros(3))]}, "layers"),
        ({"layers": [(np.full((1, 3, 16), np.nan), np.zeros((1, 3)))]}, "NaN"),
        ({"layers": [(np.zeros((1, 3, 17)), np.zeros((1, 3)))]}, "17, expected 16 rows"),
        ({"layers": [(np.zeros((1, 2, 16)), np.zeros((1, 2)))]}, "2, expected 3"),
        ({"history": [0, 10**9]}, "at most 1000"),
        ({"history": []}, "history"),
        ({"options": {"control_dt": -1.0}}, "control_dt"),
        ({"options": {"speed": 1.0}}, "speed"),
        ({"robot": "nobody"}, "nobody"),
    ],
)
def test_numbers_that_do_not_fit_are_named(changes: dict[str, Any], words: str) -> None:
    layers = [(np.zeros((1, 3, 16)), np.zeros((1, 3)))]
    right: dict[str, Any] = {"name": "p", "task": "balance", "layers": layers, "history": 1, "options": {}}
    assert _policy_controller(**right)(bb.State.at_rest("paper")).tolist() == [0.0] * 3
    with pytest.raises((TypeError, ValueError), match=words):
        _policy_controller(**{**right, **changes})


def test_a_network_that_is_not_a_chain_makes_no_controller(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")

    def changed(change: Callable[[Any], None]) -> bb.OnnxPolicy:
        model = onnx.load(POLICIES / "balance.onnx")
        change(model.graph)
        onnx.save(model, tmp_path / "changed.onnx")
        return bb.OnnxPolicy(tmp_path / "changed.onnx")

    def narrow(graph: Any) -> None:
        names = graph.node[-1].input
        for constant in graph.initializer:
            if constant.name in names[1:]:
                constant.CopyFrom(
                    onnx.numpy_helper.from_array(np.float32(0.1 * (1 - 2 * (constant.name == names[1]))), constant.name)
                )

    def skipping(graph: Any) -> None:
        graph.node[4].input[0] = graph.node[1].output[0]

    for change in (narrow, skipping):
        policy = changed(change)
        assert np.abs(policy.act(np.ones(16, np.float32))).max() <= 1.0
        with pytest.raises(ValueError, match="chain of dense layers"):
            policy.controller()


def test_biases_that_an_exporter_left_out_are_zero(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(POLICIES / "balance.onnx")
    dense = [node for node in model.graph.node if node.op_type == "Gemm"]
    for node in (dense[0], dense[-1]):
        del node.input[2]
    onnx.save(model, tmp_path / "unbiased.onnx")
    found = network_file.read(tmp_path / "unbiased.onnx")
    expected = network_file.read(POLICIES / "balance.onnx")
    for k, ((weights, biases), (kept, others)) in enumerate(zip(found, expected, strict=True)):
        np.testing.assert_array_equal(weights, kept)
        left_out = k in (0, len(expected) - 1)
        np.testing.assert_array_equal(biases, np.zeros_like(others) if left_out else others)
    network_file.write(tmp_path / "zero.onnx", found, bb.OnnxPolicy(POLICIES / "balance.onnx").metadata)
    torques = [
        bb.OnnxPolicy(tmp_path / name).controller("paper")(bb.State.at_rest("paper", tilt=(0.05, 0.0)))
        for name in ("unbiased.onnx", "zero.onnx")
    ]
    np.testing.assert_array_equal(*torques)
    assert np.abs(torques[0]).max() > 0.01


def test_weaker_motors_give_their_most() -> None:
    policy = bb.OnnxPolicy(POLICIES / "balance-recover.onnx")
    weak = bb.Params.paper().replace(max_wheel_torque=0.2)
    leaning = bb.State.at_rest("paper", tilt=(0.2, 0.0))
    strong, limited = policy.controller("paper")(leaning), policy.controller(weak)(leaning)
    assert np.abs(strong).max() > 0.25
    np.testing.assert_allclose(limited, strong * (0.2 / np.abs(strong).max()), rtol=1e-9)


def test_layers_are_read_as_they_were_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    layers = [(rng.normal(size=(5, 16)).astype(np.float32), rng.normal(size=5).astype(np.float32))]
    layers.append((rng.normal(size=(3, 5)).astype(np.float32), rng.normal(size=3).astype(np.float32)))
    network_file.write(tmp_path / "p.onnx", layers, bb.OnnxPolicy(POLICIES / "balance.onnx").metadata)
    for written, found in zip(layers, network_file.read(tmp_path / "p.onnx"), strict=True):
        for one, other in zip(written, found, strict=True):
            np.testing.assert_array_equal(one, other)
    assert bb.OnnxPolicy(tmp_path / "p.onnx").controller("kugle").name == "p"
