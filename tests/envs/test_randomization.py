"""Events on every front end; tests/rust/core/randomization tests what they sample, and when."""

import copy
import json
import pickle

import gymnasium
import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import _toml
from ballbot_rs._core import EVENT_SETS
from ballbot_rs.cli import main
from ballbot_rs.control.resolve import ResolvedController, common_options

EVENTS = [
    {"term": "body_mass", "op": "scale", "range": [0.8, 1.2]},
    {"term": "body_mass", "op": "add", "range": [0.0, 0.5], "id": 1},
    {"term": "body_inertia", "op": "scale", "range": [0.95, 1.05]},
    {"term": "floor_dynamic_friction", "every": [0.05, 0.1], "range": [0.5, 1.0], "dist": "log_uniform"},
    {"term": "push", "at": 0.03, "range": [0.0, 0.1], "height": 0.2},
    {"term": "actuators.strength", "op": "scale", "range": [0.8, 1.2]},
    {"term": "actuators.delay", "range": [0.0, 0.02]},
]
SEED = 30


def same(found, expected):
    assert found.keys() == expected.keys()
    for term in expected:
        np.testing.assert_array_equal(found[term], expected[term], err_msg=term)


def test_sensors_of_each_robot_are_sampled():
    events = [{"term": "sensors.gyro_noise", "range": [0.0, 0.01]}, {"term": "sensors.latency", "range": [0.0, 0.03]}]
    with pytest.raises(ValueError, match="the robots have none"):
        bb.Batch(2, events=events)
    batch = bb.Batch(8, events=events, sensors="kugle", observation="sensors", seed=SEED)
    batch.reset()
    draws, nominal = batch.draws(), bb.load_sensors("kugle")
    for i in range(8):
        drawn = {"gyro_noise": draws["sensors.gyro_noise"][i], "latency": draws["sensors.latency"][i]}
        assert batch.sensors(i) == {**nominal, **drawn}
    assert len(set(draws["sensors.gyro_noise"])) == 8
    env = bb.BalanceEnv(events=events, sensors={})
    env.reset(seed=3)
    assert 0.0 <= env.draws()["sensors.gyro_noise"] <= 0.01
    with pytest.raises(ValueError, match=r"events\[0\] \(sensors.gyro_bias\).*within an episode"):
        bb.BalanceEnv(sensors={}, events=[{"term": "sensors.gyro_bias", "at": 1.0, "range": [0.0, 0.1]}])


def test_draws_have_an_entry_for_every_robot_and_number():
    batch = bb.Batch(5, events=EVENTS, seed=SEED, num_threads=1)
    assert all(np.isnan(values).all() for values in batch.draws().values())
    batch.reset()
    draws = batch.draws()
    terms = ["body_mass", "body_mass:1", "body_inertia", "floor_dynamic_friction", "push"]
    assert list(draws) == [*terms, "actuators.strength", "actuators.delay"]
    assert draws["body_mass"].shape == (5,)
    assert draws["body_inertia"].shape == draws["push"].shape == draws["actuators.strength"].shape == (5, 3)
    assert np.isnan(draws["push"]).all()
    assert np.isnan(draws["floor_dynamic_friction"]).all()
    nominal = bb.Params.paper()
    for i in range(5):
        params = batch.params(i)
        assert batch.nominal_params(i) == nominal
        assert params.body_mass == nominal.body_mass * draws["body_mass"][i] + draws["body_mass:1"][i]
        same(batch.draws(i), {term: values[i] for term, values in draws.items()})
        motors = batch.actuators(i)
        assert motors["strength"] == list(draws["actuators.strength"][i])
        assert motors["delay"] == draws["actuators.delay"][i]
        assert motors["lag"] == 0.0
        assert batch.repeated_draws(i) == 0
    for _ in range(11):
        batch.step(np.zeros((5, 3), np.float32))
    draws = batch.draws()
    assert (draws["push"][:, 2] == 0.2).all()
    assert ((draws["push"][:, 0] >= 0.0) & (draws["push"][:, 0] <= 0.1)).all()
    assert [batch.params(i).floor_dynamic_friction for i in range(5)] == list(draws["floor_dynamic_friction"])
    assert bb.Batch(5).draws() == {}
    assert bb.Batch(5, actuators={"lag": 0.1}).actuators(4)["lag"] == 0.1
    with pytest.raises(ValueError, match="num_envs = 5"):
        batch.draws(5)


def test_records_have_the_draws():
    batch = bb.Batch(4, events=EVENTS, seed=SEED, max_episode_steps=7, autoreset="same_step")
    batch.reset()
    rows = [batch.draws()]
    law = bb.Lqr(batch.params())
    records = batch.rollout(law, 12, record=("draws", "rewards"))["draws"]
    batch = bb.Batch(4, events=EVENTS, seed=SEED, max_episode_steps=7, autoreset="same_step")
    batch.reset()
    for _ in range(12):
        batch.step(batch.control(law))
        rows.append(batch.draws())
    same(records, {term: np.stack([row[term] for row in rows]) for term in rows[0]})
    assert len(set(records["body_mass"][:, 0])) == 2
    without = bb.Batch(1)
    without.reset()
    assert without.rollout(bb.Lqr(), 2, record=("draws",)) == {"draws": {}}


def test_trajectories_have_the_draws():
    trajectory = bb.simulate("lqr", seconds=0.2, events=EVENTS, tilt=(0.05, 0.0))
    rows = len(trajectory.times)
    assert {term: values.shape for term, values in trajectory.draws.items()} == {
        "body_mass": (rows,),
        "body_mass:1": (rows,),
        "body_inertia": (rows, 3),
        "floor_dynamic_friction": (rows,),
        "push": (rows, 3),
        "actuators.strength": (rows, 3),
        "actuators.delay": (rows,),
    }
    mass, friction = trajectory.draws["body_mass"], trajectory.draws["floor_dynamic_friction"]
    assert (mass == mass[0]).all()
    # From its first event on, the value of the params at the end.
    assert np.isnan(friction[0])
    assert friction[-1] == trajectory.params.floor_dynamic_friction
    assert bb.simulate("lqr", seconds=0.1, tilt=(0.05, 0.0)).draws == {}
    fallen = bb.simulate("lqr", seconds=2.0, tilt=(1.0, 0.0), events=EVENTS)
    assert fallen.fell_at is not None
    assert len(fallen.draws["body_mass"]) == len(fallen.times)


def test_a_controller_runs_on_motors_weaker_than_nominal():
    weak = {"term": "max_wheel_torque", "op": "scale", "range": [0.02, 0.5]}
    result = bb.evaluate("lqr", episodes=4, events=weak, max_episode_steps=50)
    assert result.episodes == 4


def test_front_ends_sample_the_same_values():
    pytest.importorskip("torch")
    batch = bb.Batch(3, events=EVENTS, seed=SEED)
    batch.reset()
    expected = batch.draws()
    vector = bb.BallbotVectorEnv(3, events=EVENTS)
    vector.reset(seed=SEED)
    made = gymnasium.make_vec("ballbot/Balance-v0", num_envs=3, events=EVENTS)
    made.reset(seed=SEED)
    sb3 = bb.BallbotVecEnv(3, events=EVENTS, seed=SEED)
    sb3.reset()
    for env in (vector, made.unwrapped, sb3):
        same(env.draws(), expected)
    for each in (vector.call("draws"), sb3.env_method("draws")):
        for i, draws in enumerate(each):
            same(draws, {term: values[i] for term, values in expected.items()})
    assert vector.get_attr("nominal_params") == (bb.Params.paper(),) * 3
    for env in (bb.BalanceEnv(events=EVENTS), gymnasium.make("ballbot/Balance-v0", events=EVENTS).unwrapped):
        env.reset(seed=SEED + 2)
        same(env.draws(), {term: values[2] for term, values in expected.items()})
        assert env.params == batch.params(2) != env.nominal_params == bb.Params.paper()


def test_every_spelling_is_equivalent(tmp_path):
    full = bb.load_events(EVENTS)
    file = tmp_path / "mine.toml"
    file.write_text(_toml.dumps({"events": full}), encoding="utf-8")
    for given in (full, tuple(EVENTS), file, str(file), json.loads(json.dumps(full))):
        assert bb.load_events(given) == full
        assert bb.Batch(1, events=given).options["events"] == full
    assert bb.load_events(EVENTS[0]) == full[:1]
    arrays = [{**event, "range": np.array(event["range"])} for event in EVENTS]
    assert bb.load_events(arrays) == full
    env = bb.BalanceEnv(events=file)
    assert json.loads(json.dumps(env.task_options))["events"] == full
    assert bb.BalanceEnv(**env.task_options).task_options == env.task_options
    for nothing in (None, []):
        assert bb.Batch(1, events=nothing).options["events"] == []
    env.task_options["events"][0]["range"][0] = 0.0
    assert env.task_options["events"] == full


@pytest.mark.parametrize("name", EVENT_SETS)
def test_sets_by_name(name):
    env = bb.BalanceEnv(events=name)
    env.reset(seed=0)
    assert env.task_options["events"] == bb.load_events(name)
    assert np.isfinite(env.draws()["body_mass"])
    assert np.isnan(env.draws()["push"]).all()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_continue_bit_identically(copied):
    env = bb.BallbotVectorEnv(3, events=EVENTS, max_episode_steps=20, num_threads=1)
    env.reset(seed=SEED)
    actions = np.full((3, 3), 0.1, np.float32)
    for _ in range(7):
        env.step(actions)
    other = copied(env)
    for _ in range(50):
        np.testing.assert_array_equal(env.step(actions)[0], other.step(actions)[0])
        same(other.draws(), env.draws())


@pytest.mark.parametrize(
    ("events", "error", "message"),
    [
        ("wild", ValueError, "wild.*mild, hard"),
        ("none.toml", OSError, "none.toml"),
        (3, TypeError, "events must be .* not int"),
        ([3], TypeError, "not int"),
        ([{1: 2}], TypeError, r"events\[0\] has a key that is not text"),
        ({}, ValueError, "'term'"),
        ({"term": "color", "range": [0, 1]}, ValueError, r"events\[0\] \(color\): unknown term"),
        ({"term": "gravity", "range": [9, 10], "rate": 3}, ValueError, r"\(gravity\): unknown key 'rate'"),
        ({"term": "gravity", "range": [9, 10], "op": "mul"}, ValueError, r"\(gravity\): unknown op 'mul'"),
        ({"term": "gravity", "range": [9, 10], "dist": "x"}, ValueError, r"\(gravity\): unknown dist"),
        ({"term": "gravity", "range": [9, 10], "mode": "x"}, ValueError, r"\(gravity\): unknown mode"),
        ({"term": "gravity", "range": [10, 9]}, ValueError, r"\(gravity\): range\[1\] = 9"),
        ({"term": "gravity", "range": [float("nan"), 9]}, ValueError, r"\(gravity\): range\[0\] = NaN"),
        ({"term": "gravity", "range": [0, 9]}, ValueError, r"\(gravity\).*gravity = 0"),
        ({"term": "gravity", "range": None}, TypeError, "range is not"),
        ({"term": "gravity", "range": [9, 10], "id": 10**30}, ValueError, r"\(gravity\): id"),
        ({"term": "gravity", "range": [9, 10], "id": True}, ValueError, r"\(gravity\): id = true"),
        ({"term": "body_inertia", "op": "scale", "range": [0.5, 1.5]}, ValueError, r"\(body_inertia\).*triangle"),
        ([EVENTS[0], EVENTS[0]], ValueError, r"events\[1\] \(body_mass\).*another id"),
    ],
)
def test_invalid_events_are_rejected_with_their_term(events, error, message):
    for make in (bb.Batch, bb.BallbotVectorEnv):
        with pytest.raises(error, match=message):
            make(1, events=events)
    with pytest.raises(error, match=message):
        bb.BalanceEnv(events=events)


def test_controllers_and_evaluations_have_nominal_robots_by_default():
    nominal = bb.evaluate("lqr", episodes=10)
    randomized = bb.evaluate("lqr", episodes=10, events="hard")
    assert randomized != nominal
    assert randomized == bb.evaluate("lqr", episodes=10, events="hard", num_threads=1)
    # The same law, made for the nominal robot by hand.
    by_hand = bb.evaluate(bb.Lqr(), episodes=10, events="hard")
    assert by_hand.tilt_rms == pytest.approx(randomized.tilt_rms, rel=1e-6)


def test_a_trajectory_is_of_a_sampled_robot():
    trajectories = [bb.simulate("lqr", seconds=0.5, events="hard", tilt=(0.05, 0.0)) for _ in range(2)]
    assert trajectories[0].params != bb.Params.paper()
    assert trajectories[0].params == trajectories[1].params
    np.testing.assert_array_equal(trajectories[0].torques, trajectories[1].torques)
    assert trajectories[0].states[0].ball_position[2] == trajectories[0].params.ball_radius


def test_events_of_a_training_are_left_out_by_default():
    def policy(name, events):
        return ResolvedController(name, {"model": "contact"}, lambda observations: observations[:, :3], events=events)

    mild, hard = policy("mild", bb.load_events("mild")), policy("hard", bb.load_events("hard"))
    assert "events" not in common_options([mild, hard])
    assert common_options([mild, hard], {"events": "hard"})["events"] == "hard"
    assert common_options([mild], {"events": "trained"})["events"] == bb.load_events("mild")
    for those in ([mild, hard], []):
        with pytest.raises(ValueError, match="trained"):
            common_options(those, {"events": "trained"})


def test_the_command_line_accepts_sets_and_files(capsys, tmp_path):
    def evaluated(*arguments):
        assert main(["evaluate", "balance", "--episodes", "5", "--json", *arguments]) == 0
        return json.loads(capsys.readouterr().out)["results"]

    file = tmp_path / "mine.toml"
    file.write_text(_toml.dumps({"events": bb.load_events("hard")}), encoding="utf-8")
    hard = evaluated("--events", "hard")
    assert evaluated() != hard == evaluated("--events", str(file))
    assert main(["evaluate", "balance", "--events", "wild"]) != 0
    assert "wild" in capsys.readouterr().err


def test_a_training_keeps_its_events(tmp_path):
    pytest.importorskip("stable_baselines3")
    from ballbot_rs.training import config
    from tests.support.tiny_config import TINY_CONFIG

    tiny, file, folder = tmp_path / "tiny.toml", tmp_path / "mine.toml", tmp_path / "run"
    tiny.write_text(TINY_CONFIG.replace('"spatial"', '"contact"'), encoding="utf-8")
    file.write_text(_toml.dumps({"events": EVENTS}), encoding="utf-8")
    arguments = ["train", "balance", "--config", str(tiny), "--run", str(folder), "--quiet", "--no-report"]
    assert main([*arguments, "--episodes", "0", "--events", str(file)]) == 0
    full = bb.load_events(EVENTS)
    assert config.load("balance", folder / "config.toml")[0].env["events"] == full
    from ballbot_rs.control.resolve import find

    found = find(folder)
    assert found.env_options["events"] == []
    assert found.events == full
    nominal, own = bb.evaluate(folder, episodes=4), bb.evaluate(folder, episodes=4, events="trained")
    assert nominal != own == bb.evaluate(folder, episodes=4, events=EVENTS)
    assert main(["evaluate", "--controller", str(folder), "--events", "trained", "--episodes", "2", "--quiet"]) == 0


def test_slopes_are_sampled_within_an_episode():
    event = {"term": "floor_tilt", "mode": "interval", "every": [0.03, 0.05], "range": [-0.05, 0.05]}
    env = bb.BalanceEnv(events=[event])
    env.reset(seed=SEED)
    slopes = set()
    for _ in range(20):
        env.step(np.zeros(3, np.float32))
        slopes.add(env.params.floor_tilt)
    assert len(slopes) >= 4
    assert env.nominal_params.floor_tilt == (0.0, 0.0)
    with pytest.raises(ValueError, match=r"\(floor_tilt\).*floor_tilt\[0\] = 1 "):
        bb.BalanceEnv(events=[{"term": "floor_tilt", "range": [0.0, 1.0]}])
    with pytest.raises(ValueError, match=r"\(floor_tilt\).*requires zeros"):
        bb.BalanceEnv(model="planar", events=[event])
