"""Recurrent policies: one state per robot, which is zero where an episode begins, in every way to run them."""

import pickle
from typing import ClassVar

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

import ballbot_rs as bb
from ballbot_rs.analysis.actors import make_actor
from ballbot_rs.analysis.closed_loop import ClosedLoop
from ballbot_rs.control import network_file
from ballbot_rs.control.onnx_policy import PREFIX
from ballbot_rs.control.resolve import find
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.viewer.session.drivers import PolicyDriver, TaskPolicy
from tests.support.onnx_policies import SHIPPED, recurrent_policy


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return recurrent_policy(tmp_path_factory.mktemp("recurrent") / "memory.onnx", cells=2, hidden=(4,))


def rows(count, steps=12, width=16, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 0.7, (steps, count, width)).astype(np.float32)


def in_time(policy, observations):
    """The actions of a sequence of observations, from the beginning of an episode."""
    state, actions = policy.initial_state(observations.shape[1]), []
    for seen in observations:
        action, state = policy.step(seen, state)
        actions.append(action)
    return np.array(actions)


class TestFile:
    def test_the_state_matters_and_is_of_each_robot_alone(self, file):
        policy = bb.OnnxPolicy(file)
        observations = rows(6)
        together = in_time(policy, observations)
        fresh = policy.step(observations[-1], policy.initial_state(6))[0]
        assert np.abs(together[-1] - fresh).max() > 0.05
        order = np.array([3, 0, 5, 1, 4, 2])
        np.testing.assert_allclose(in_time(policy, observations[:, order]), together[:, order], atol=1e-6)
        for robot in range(6):
            alone = in_time(policy, observations[:, robot : robot + 1])
            np.testing.assert_allclose(alone[:, 0], together[:, robot], atol=1e-6)
        # Without an axis of the batch.
        state = policy.initial_state()
        for step in range(3):
            action, state = policy.step(observations[step, 0], state)
            np.testing.assert_allclose(action, together[step, 0], atol=1e-6)
        assert (policy.state_len, state.shape, action.shape) == (20, (20,), (3,))

    def test_a_copy_acts_alike(self, file):
        policy = bb.OnnxPolicy(file)
        copied = pickle.loads(pickle.dumps(policy))
        np.testing.assert_array_equal(in_time(copied, rows(3)), in_time(policy, rows(3)))

    def test_a_policy_without_a_state_has_the_same_step(self):
        policy = bb.OnnxPolicy(SHIPPED)
        seen = rows(4)[0]
        action, state = policy.step(seen, policy.initial_state(4))
        np.testing.assert_array_equal(action, policy.act(seen))
        assert (policy.state_len, state.shape) == (0, (4, 0))

    def test_bad_input_is_named(self, file):
        policy = bb.OnnxPolicy(file)
        seen, state = np.zeros((2, 16)), policy.initial_state(2)
        with pytest.raises(ValueError, match=r"is a recurrent policy: step\(observation, state\)"):
            policy.act(seen)
        with pytest.raises(ValueError, match=r"state has shape \(2, 19\), expected \(20,\)"):
            policy.step(seen, state[:, 1:])
        with pytest.raises(ValueError, match=r"state has shape \(1, 20\) for an observation of shape \(2, 16\)"):
            policy.step(seen, state[:1])
        with pytest.raises(ValueError, match=r"observation has shape \(2, 15\)"):
            policy.step(seen[:, 1:], state)
        with pytest.raises(TypeError, match="state is"):
            policy.step(seen, "zero")
        # It would stay in the state.
        with pytest.raises(ValueError, match="observation has the value nan: all must be finite"):
            policy.step(np.where(np.arange(16) == 3, np.nan, seen), state)
        with pytest.raises(ValueError, match="state has the value inf: all must be finite"):
            policy.step(seen, np.full((2, 20), np.inf))
        with pytest.raises(ValueError, match="count = 0"):
            policy.initial_state(0)
        with pytest.raises(TypeError, match="count"):
            policy.initial_state(1.5)

    def test_a_next_state_of_another_shape_is_named(self, file, tmp_path):
        model = onnx.load(file)
        last = model.graph.node[-1]
        last.output[0] = "each"
        model.graph.initializer.append(numpy_helper.from_array(np.array([0]), "rows"))
        model.graph.node.append(helper.make_node("ReduceMean", ["each", "rows"], ["next_state"], keepdims=1))
        onnx.save(model, tmp_path / "mean.onnx")
        policy = bb.OnnxPolicy(tmp_path / "mean.onnx")
        with pytest.raises(ValueError, match=r"gives a next_state of shape \(1, 20\), expected \(3, 20\)"):
            policy.step(np.zeros((3, 16)), policy.initial_state(3))

    def test_a_file_with_another_state_is_rejected(self, file, tmp_path):
        def rejected(change, words):
            model = onnx.load(file)
            change(model)
            onnx.save(model, tmp_path / "changed.onnx")
            with pytest.raises(ValueError, match=words):
                bb.OnnxPolicy(tmp_path / "changed.onnx")

        def without_next(model):
            del model.graph.output[1]

        def larger(model):
            model.graph.input[1].type.tensor_type.shape.dim[1].dim_value = 21

        def text(model):
            model.metadata_props.add(key=PREFIX + "state", value='"LSTM"')

        rejected(without_next, "a state to an action and a next_state")
        rejected(larger, "a state to an action and a next_state|cannot|not an ONNX file")

        def whole_numbers(model):
            model.graph.input[1].type.tensor_type.elem_type = onnx.TensorProto.INT64
            for node in model.graph.node:
                node.input[:] = ["real" if name == "state" else name for name in node.input]
            model.graph.node.insert(0, helper.make_node("Cast", ["state"], ["real"], to=onnx.TensorProto.FLOAT))

        rejected(text, "state is 'LSTM', not a dict")
        rejected(whole_numbers, r"takes state as tensor\(int64\), expected tensor\(float\)")
        huge = recurrent_policy(tmp_path / "huge.onnx", units=400, cells=100)
        with pytest.raises(ValueError, match="has a state of 80000 numbers, more than 65536"):
            bb.OnnxPolicy(huge)


def reference(policy, batch, steps, seeds):
    """Actions of a policy on a batch, computed robot by robot."""
    n = batch.num_envs
    observations = batch.reset(seeds=seeds)
    states = [policy.initial_state() for _ in range(n)]
    taken, ends = [], 0
    for _ in range(steps):
        actions = np.zeros((n, 3), dtype=np.float32)
        for i in range(n):
            actions[i], states[i] = policy.step(observations[i], states[i])
        taken.append(actions)
        observations, _, terminated, truncated = batch.step(actions)
        for i in np.flatnonzero(terminated | truncated):
            states[i] = policy.initial_state()
            ends += 1
    return np.array(taken), ends


class TestCommands:
    #: Falls soon, at other times for each robot, and begins again.
    OPTIONS: ClassVar = {"max_episode_steps": 31, "fall_tilt": 0.12}

    def batch(self, count, **options):
        return new_batch(count, task="balance", num_threads=1, options={**self.OPTIONS, **options})

    def test_the_state_begins_again_with_each_episode(self, file):
        policy = bb.OnnxPolicy(file)
        seeds = list(range(5))
        expected, ends = reference(policy, self.batch(5), 90, seeds)
        batch = self.batch(5)
        loop = ClosedLoop(batch, make_actor(find(str(file)), batch))
        loop.reset(seeds=seeds)
        found = np.array([step.actions for step in loop.steps(90)])
        np.testing.assert_allclose(found, expected, atol=1e-5)
        assert ends > 8

    def test_the_state_begins_again_where_a_loop_is_reset(self, file):
        batch = self.batch(3)
        loop = ClosedLoop(batch, make_actor(find(str(file)), batch))
        found = []
        for _ in range(2):
            loop.reset(seeds=[1, 2, 3])
            found.append([step.actions for step in loop.steps(5)])
        np.testing.assert_array_equal(*found)

    def test_simulate_compare_scenarios_and_datasets(self, file):
        policy = bb.OnnxPolicy(file)
        run = bb.simulate(file, seconds=0.2, tilt=(0.03, 0.0))
        batch = new_batch(1, task="balance", num_threads=1, options=policy.env_options)
        start = bb.State.at_rest("paper", tilt=(0.03, 0.0))
        observation, state = batch.reset(starts=[start])[0], policy.initial_state()
        for torque in run.torques[:10]:
            action, state = policy.step(observation, state)
            np.testing.assert_allclose(torque, action * batch.max_wheel_torque, atol=1e-5)
            observation = batch.step(action[np.newaxis])[0][0]

        dataset = bb.record_dataset(file, episodes=3, seed=5, max_episode_steps=20)
        first, last = dataset.starts[1], dataset.starts[2] - 1
        alone = in_time(policy, dataset.observations[first:last, np.newaxis])[:, 0]
        np.testing.assert_allclose(dataset.actions[first:last], alone, atol=1e-5)

        several = bb.compare([file, "lqr"], episodes=4, seed=1, max_episode_steps=40)
        assert several[0].tilt_rms == bb.evaluate(file, episodes=4, seed=1, max_episode_steps=40).tilt_rms
        lean = bb.Scenario("lean", "Release at 3 deg", seconds=1.0, tilt=3.0, directions=3, score="rms_tilt")
        alone = bb.Scenario("one", "Release at 3 deg", seconds=1.0, tilt=3.0, score="rms_tilt")
        found = bb.run_scenarios(file, [lean, alone])
        np.testing.assert_allclose(found[0].metrics["rms_tilt"][0], found[1].metrics["rms_tilt"][0], rtol=1e-5)

    def test_the_viewer_keeps_a_state_of_each_robot(self, file):
        policy = bb.OnnxPolicy(file)
        params = bb.Params.paper()
        driver = PolicyDriver(find(str(file)), params, 3)
        states = [bb.State.at_rest(params, tilt=(0.02 * i, -0.01)) for i in range(3)]
        place = np.zeros((3, 2))
        given = [policy.initial_state() for _ in range(3)]
        for step in range(6):
            if step == 4:
                driver.reset(1)
                given[1] = policy.initial_state()
            seen = [driver.observe(i, state, place[i]) for i, state in enumerate(states)]
            expected = np.zeros((3, 3))
            for i in range(3):
                expected[i], given[i] = policy.step(seen[i], given[i])
            np.testing.assert_allclose(driver.torques(states, place), expected * driver.max_torque, atol=1e-5)

    def test_the_viewer_in_a_task(self, tmp_path):
        file = recurrent_policy(tmp_path / "goal.onnx", task="goal")
        found = find(str(file))
        policy, driver = bb.OnnxPolicy(file), TaskPolicy(found, bb.Params.paper(), "goal", {})
        observations = rows(4, width=policy._rows)
        expected = in_time(policy, observations) * driver.max_torque
        for seen, torques in zip(observations, expected, strict=True):
            np.testing.assert_allclose(driver.torques(seen), torques, atol=1e-5)
        driver.reset(2)
        again = driver.torques(observations[0])
        np.testing.assert_allclose(again[2], expected[0][2], atol=1e-5)
        assert np.abs(again[[0, 1, 3]] - expected[0][[0, 1, 3]]).max() > 1e-3
        driver.reset()
        np.testing.assert_allclose(driver.torques(observations[0]), expected[0], atol=1e-5)


class TestController:
    @pytest.mark.parametrize(
        ("units", "cells", "hidden", "history"), [(5, 2, (4,), 1), (7, 1, (), [0, 2]), (3, 3, (5, 4), 1)]
    )
    def test_it_acts_as_onnx_runtime(self, units, cells, hidden, history, tmp_path):
        file = recurrent_policy(tmp_path / "p.onnx", units, cells, hidden, history=history, sim_dt=0.002)
        policy = bb.OnnxPolicy(file)
        batch = new_batch(1, task="balance", num_threads=1, options=policy.env_options)
        law = policy.controller("paper")
        for seed in (3, 4):
            observation, state = batch.reset(seeds=[seed])[0], policy.initial_state()
            law.reset()
            for _ in range(25):
                seen = bb.State.from_array(batch.states()[0])
                action, state = policy.step(observation, state)
                torques = law(seen, yaw=seen.yaw)
                np.testing.assert_allclose(torques, action * batch.max_wheel_torque, atol=1e-6)
                observation, _, fallen, _ = (rows[0] for rows in batch.step(action[np.newaxis]))
                if fallen:
                    state = policy.initial_state()
                    law.reset()

    def test_robots_of_a_batch_have_their_own_memory(self, file):
        policy, steps = bb.OnnxPolicy(file), 60
        batch = new_batch(9, num_threads=1, options=TestCommands.OPTIONS)
        batch.reset(seeds=[*range(9)])
        found = batch.rollout(
            policy.controller("paper"), steps, record=("states", "torques", "terminated", "truncated")
        )
        over = found["terminated"] | found["truncated"]
        assert over.sum() > 5
        largest = 0.0
        for i in range(9):
            law, forgetful = policy.controller("paper"), policy.controller("paper")
            for step in range(steps):
                state = bb.State.from_array(found["states"][step, i])
                torques = law(state)
                np.testing.assert_allclose(found["torques"][step, i], torques, atol=1e-6)
                forgetful.reset()
                largest = max(largest, np.abs(forgetful(state) - torques).max())
                if over[step, i]:
                    law.reset()
        assert largest > 0.01

    def test_layers_are_read_in_their_order(self, file):
        cells, layers = network_file.read_parts(file)
        assert [weights.shape for weights, _ in cells] == [(20, 21), (20, 10)]
        assert [weights.shape for weights, _ in layers] == [(4, 5), (3, 4)]
        with pytest.raises(ValueError, match="recurrent policy, of 2 LSTM cells"):
            network_file.read(file)

    @pytest.mark.parametrize("recurrent", [False, True])
    def test_weights_may_be_inputs_too(self, recurrent, file, tmp_path):
        """As in files of IR version 3."""
        model = onnx.load(file if recurrent else SHIPPED)
        for tensor in model.graph.initializer:
            model.graph.input.append(helper.make_tensor_value_info(tensor.name, tensor.data_type, tensor.dims))
        onnx.save(model, tmp_path / "old.onnx")
        state = bb.State.at_rest("paper", tilt=(0.03, -0.01))
        found, expected = (
            bb.OnnxPolicy(path).controller()(state) for path in (tmp_path / "old.onnx", file if recurrent else SHIPPED)
        )
        np.testing.assert_array_equal(found, expected)

    @pytest.mark.parametrize("change", ["gates", "state", "output", "tanh"])
    def test_another_network_makes_no_controller(self, change, file, tmp_path):
        model = onnx.load(file)
        if change == "gates":
            sigmoids = [node for node in model.graph.node if node.op_type == "Sigmoid"]
            first, second = sigmoids[0].input[0], sigmoids[1].input[0]
            sigmoids[0].input[0], sigmoids[1].input[0] = second, first
        elif change == "state":
            last = model.graph.node[-1]
            last.input[0], last.input[1] = last.input[1], last.input[0]
        elif change == "output":
            next(node for node in model.graph.node if node.op_type == "Concat").input[1] = "state_2"
        else:
            next(node for node in model.graph.node if node.op_type == "Tanh").op_type = "Sigmoid"
        onnx.save(model, tmp_path / "other.onnx")
        policy = bb.OnnxPolicy(tmp_path / "other.onnx")
        assert np.isfinite(in_time(policy, rows(2))).all()
        with pytest.raises(ValueError, match="after LSTM cells if it is recurrent"):
            policy.controller()
