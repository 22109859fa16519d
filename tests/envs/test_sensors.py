"""Sensors of environments: the same on every front end, from any source, in copies and files of policies."""

import copy
import json
import math
import pickle

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs import _core
from ballbot_rs.cli import main
from ballbot_rs.control.resolve import find
from ballbot_rs.viewer.session.drivers import PolicyDriver
from tests.envs.test_actuators import ACTIONS, front_ends
from tests.support.names import BALANCE

#: Every error at once.
EVERYTHING = {
    "gyro_noise": 0.001,
    "gyro_bias": 0.02,
    "gyro_bias_walk": 0.01,
    "gyro_range": 5.0,
    "accelerometer_noise": 0.01,
    "accelerometer_bias": 0.1,
    "accelerometer_bias_walk": 0.05,
    "accelerometer_range": 30.0,
    "imu_position": [0.01, 0.0, 0.2],
    "imu_misalignment": 0.02,
    "imu_rate": 200.0,
    "encoder_ticks": 4096.0,
    "encoder_rate": 1000.0,
    "latency": 0.02,
}
#: Ages of a history with gaps.
GAPS = [0, 1, 4, 9]
OBSERVED = {"sensors": EVERYTHING, "observation": "sensors", "history": 3}
ROWS = len(_core.TASKS["balance"]["observation"])


@pytest.mark.parametrize("model", _core.MODELS)
def test_every_front_end_has_the_same_sensors(model):
    ends = front_ends(model=model, **OBSERVED)
    expected = np.array(ends["Batch"](3))
    assert expected.shape == (len(ACTIONS) + 1, 3 * ROWS)
    assert not np.array_equal(expected[:, -ROWS:], np.array(front_ends(model=model)["Batch"](3)))
    for name, observations in ends.items():
        np.testing.assert_array_equal(np.array(observations(3)), expected, err_msg=name)


@pytest.mark.parametrize(
    "make",
    [
        lambda **options: bb.BalanceEnv(**options),
        lambda **options: bb.BallbotVectorEnv(2, **options),
        lambda **options: bb.BallbotVecEnv(2, **options),
    ],
)
def test_readings_and_the_true_rows_of_every_front_end(make):
    env, batch = make(sensors=EVERYTHING, observation="sensors"), bb.Batch(2, seed=5)
    if isinstance(env, bb.BallbotVecEnv):
        env.seed(5)
        observation = env.reset()
    else:
        observation, _ = env.reset(seed=5)
    privileged, readings = env.privileged_observations(), env.readings()
    truth = batch.reset()
    assert set(readings) == {"gyro", "specific_force", "wheel_angles", "wheel_rates"}
    if isinstance(env, bb.BalanceEnv):
        truth = truth[0]
    np.testing.assert_array_equal(privileged, truth)
    assert not np.array_equal(observation, truth)
    assert env.observation_space.shape in ((ROWS,), (2, ROWS))
    for part in readings.values():
        assert part.shape == (*truth.shape[:-1], 3)
        assert np.isfinite(part).all()
    np.testing.assert_allclose(np.linalg.norm(readings["specific_force"], axis=-1), 9.81, atol=1.5)


def test_readings_of_one_robot_are_its_row():
    batch = bb.Batch(9, sensors=EVERYTHING)
    batch.reset()
    batch.step(np.full((9, 3), 0.1))
    readings = batch.readings()
    for i in (0, 8):
        for name, part in batch.readings(i).items():
            np.testing.assert_array_equal(part, readings[name][i])
    envs = bb.BallbotVectorEnv(2, sensors={})
    envs.reset(seed=0)
    first, second = envs.call("readings")
    np.testing.assert_array_equal(envs.readings()["gyro"], [first["gyro"], second["gyro"]])
    for read in (batch.readings, batch.privileged_observations, batch.draws):
        for index in (9, 2**64 - 1):
            with pytest.raises(ValueError, match=r"environment index = .*below num_envs = 9"):
                read(index)
    for i in (0, 8):
        np.testing.assert_array_equal(batch.privileged_observations(i), batch.privileged_observations()[i])
    with pytest.raises(ValueError, match="the robots have no sensors"):
        bb.Batch(1).readings()


def test_exact_sensors_do_not_change_the_observation_of_the_truth():
    expected = np.array(front_ends()["Batch"](3))
    for sensors in (None, "exact", EVERYTHING):
        np.testing.assert_array_equal(np.array(front_ends(sensors=sensors)["Batch"](3)), expected)


@pytest.mark.parametrize("given", [GAPS, np.array(GAPS), tuple(GAPS)])
def test_history_with_gaps_has_the_observations_of_its_ages(given):
    gaps, once = front_ends(history=given), front_ends()
    single = np.array(once["BalanceEnv"](3))
    for name, episode in gaps.items():
        for k, found in enumerate(episode(3)):
            expected = [single[max(k - age, 0)] for age in reversed(GAPS)]
            np.testing.assert_array_equal(found, np.concatenate(expected), err_msg=name)
    env = bb.BalanceEnv(history=given)
    assert env.observation_space.shape == (len(GAPS) * ROWS,)
    assert env.observation_space.contains(env.reset(seed=0)[0])
    batch = bb.Batch(1, history=given)
    assert batch.history == batch.options["history"] == GAPS
    assert batch.observation_layout == {"state": (len(GAPS) * ROWS,)}


def test_ages_without_gaps_are_a_count():
    assert bb.Batch(1, history=[0, 1, 2]).options["history"] == 3
    assert bb.Batch(1, history=[0]).history == 1


def test_history_is_oldest_first_and_within_the_space():
    long, short = front_ends(history=4), front_ends()
    rows, single = np.array(long["BalanceEnv"](3)), np.array(short["BalanceEnv"](3))
    for k in range(len(single)):
        expected = [single[max(k - age, 0)] for age in (3, 2, 1, 0)]
        np.testing.assert_array_equal(rows[k], np.concatenate(expected))
    space = bb.BalanceEnv(history=4, scale_observations=False).observation_space
    once = bb.BalanceEnv(scale_observations=False).observation_space
    np.testing.assert_array_equal(space.high, np.tile(once.high, 4))
    batch = bb.Batch(3, history=4)
    assert (batch.history, batch.observation_len) == (4, 4 * ROWS)
    assert batch.reset().shape == batch.observations().shape == (3, 4 * ROWS)
    assert batch.rollout(bb.Lqr(), steps=2, record=("observations",))["observations"].shape == (3, 3, 4 * ROWS)


def test_readings_of_slow_sensors_are_held():
    batch = bb.Batch(2, model="contact", sensors={"gyro_noise": 0.01, "imu_rate": 50.0, "encoder_rate": 33.0})
    batch.reset()
    read = [batch.readings()]
    for _ in range(12):
        batch.step(np.full((2, 3), 0.01))
        read.append(batch.readings())
    for name, period in (("gyro", 2), ("specific_force", 2), ("wheel_angles", 3), ("wheel_rates", 3)):
        for k in range(1, 13):
            held = read[k][name] == read[k - 1][name]
            assert held.all() if k % period else not held.any(), (name, k)


def test_sensors_come_from_names_files_and_dicts(tmp_path):
    kugle = bb.load_sensors("kugle")
    path = tmp_path / "mine.toml"
    path.write_text(bb.Params.paper().to_toml() + "\n[sensors]\nencoder_ticks = 1000\nlatency = 0.02\n")
    exact = bb.load_sensors("exact")
    mine = {**exact, "encoder_ticks": 1000.0, "latency": 0.02}
    assert bb.load_sensors(path) == bb.load_sensors(str(path)) == mine
    for given, expected in [
        (None, None),
        ({}, exact),
        ("exact", exact),
        ("kugle", kugle),
        (kugle, kugle),
        (path, mine),
        ({"encoder_ticks": np.int64(1000), "latency": 0.02}, mine),
    ]:
        batch = bb.Batch(1, robot=path, sensors=given)
        assert batch.options["sensors"] == expected
        assert json.loads(json.dumps(batch.options))["sensors"] == expected
        assert bb.Batch(1, **batch.options).options == batch.options
    batch.options["sensors"]["latency"] = 5.0
    assert batch.options["sensors"]["latency"] == 0.02


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"sensors": {"gyro": 1.0}}, ValueError, "unknown option of sensors 'gyro': expected one of gyro_noise"),
        ({"sensors": {"gyro_noise": -1.0}}, ValueError, "sensors.gyro_noise = -1 is out of range: it must be >= 0"),
        ({"sensors": {"gyro_bias": math.nan}}, ValueError, "sensors.gyro_bias = NaN"),
        ({"sensors": {"imu_position": [1.0, 2.0]}}, ValueError, "sensors.imu_position has 2 values, expected 3"),
        ({"sensors": {"latency": 0.005}}, ValueError, r"sensors.latency / control_dt = 0.5 .*latency = 0.005 s"),
        ({"sensors": {"imu_rate": 1e-4}}, ValueError, "sensors.imu_rate = 0.0001 .*at least 0.001 Hz"),
        (
            {"sensors": {"encoder_rate": 50.0}, "observation": "sensors"},
            ValueError,
            "sensors.encoder_rate = 50 .*at least the control rate, 100 Hz",
        ),
        ({"sensors": {"latency": "late"}}, TypeError, "sensors.latency must be a number"),
        ({"sensors": {1: 2.0}}, TypeError, "sensors has the key 1, expected names"),
        ({"sensors": "kugel"}, ValueError, "unknown sensors 'kugel': expected one of exact, kugle"),
        ({"sensors": 3}, TypeError, "sensors must be a dict of options, a name, the path of .* or None, not int"),
        ({"observation": "camera"}, ValueError, "unknown observation 'camera': expected one of ground_truth, sensors"),
        ({"observation": 1}, TypeError, "observation must be the name of a kind of observation, not int"),
        ({"history": 0}, ValueError, "history = 0"),
        ({"history": 1001}, ValueError, "history = 1001 .*1000"),
        ({"history": 1.5}, ValueError, "history = 1.5 .* a whole number"),
        ({"history": "all"}, TypeError, "history must be a whole number, or a list of ages, not str"),
        ({"history": []}, ValueError, r"history = \[\]: the first age must be 0"),
        ({"history": [1, 2]}, ValueError, r"history = \[1, 2\]: the first age must be 0, the newest observation"),
        ({"history": [0, 2, 2]}, ValueError, r"history = \[0, 2, 2\]: ages must ascend, but 2 follows 2"),
        ({"history": [0, 1.5]}, ValueError, r"history\[1\] = 1.5 .* a whole number"),
        ({"history": [0, 1001]}, ValueError, r"history = \[0, 1001\]: the age 1001 must be at most 1000"),
    ],
)
def test_invalid_values_are_rejected_by_every_front_end(options, kind, message):
    for make in (
        lambda: bb.Batch(1, **options),
        lambda: bb.BalanceEnv(**options),
        lambda: bb.BallbotVectorEnv(2, **options),
        lambda: bb.BallbotVecEnv(2, **options),
        lambda: gymnasium.make(BALANCE, **options),
    ):
        with pytest.raises(kind, match=message):
            make()


@pytest.mark.parametrize("name", ["sensors", "observation", "history"])
def test_sensors_are_fixed_once_an_environment_is_made(name):
    with pytest.raises(AttributeError, match=f"{name} is fixed once an environment is made"):
        bb.BallbotVecEnv(1).set_attr(name, None)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_reads_the_same(copied):
    env = bb.BalanceEnv(**OBSERVED)
    env.reset(seed=1)
    for action in ACTIONS[:7]:
        env.step(action)
    other = copied(env)
    for action in ACTIONS[7:]:
        np.testing.assert_array_equal(other.step(action)[0], env.step(action)[0])


@pytest.mark.parametrize("history", [3, [0, 2, 5]])
def test_a_policy_keeps_its_sensors_and_history(history, tmp_path):
    observed = {**OBSERVED, "history": history}
    env = bb.BallbotVecEnv(1, model="spatial", **observed)
    path = bb.save(PPO("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, seed=0), tmp_path / "p.zip")
    assert main(["export", str(path), "-o", str(tmp_path / "p.onnx")]) == 0
    for file in (path, tmp_path / "p.onnx"):
        options = find(file).env_options
        assert {name: options[name] for name in observed} == observed
    given, own, truth = (
        bb.evaluate(path, episodes=3, **options) for options in (observed, {}, {"observation": "ground_truth"})
    )
    assert own == given
    assert own.tilt_rms != truth.tilt_rms
    assert main(["evaluate", "--episodes", "2", "--quiet", "--controller", str(path), "--sensors", "kugle"]) == 0
    # The page's observations have the history of the training.
    driver = PolicyDriver(find(path), bb.Params.paper(), 2)
    states = [bb.State.at_rest(bb.Params.paper(), tilt=(0.02, 0.0))] * 2
    first, second = (driver.torques(states, (0.0, 0.0)) for _ in range(2))
    assert first.shape == (2, 3)
    assert not np.array_equal(first, second)
    driver.reset()
    np.testing.assert_array_equal(driver.torques(states, (0.0, 0.0)), first)


def test_robots_that_were_never_reset_read_at_rest():
    batch = bb.Batch(9, sensors={}, observation="sensors")
    readings = batch.readings()
    np.testing.assert_allclose(readings["specific_force"], np.tile([0.0, 0.0, batch.params(0).gravity], (9, 1)))
    assert not readings["gyro"].any()
    np.testing.assert_allclose(batch.estimates(), batch.states(), atol=1e-12)
    assert not batch.observations().any()


def test_estimates_are_recorded_with_the_states():
    batch = bb.Batch(9, sensors="kugle", observation="sensors", seed=3)
    batch.reset()
    np.testing.assert_allclose(batch.estimates()[:, 16:20], batch.states()[:, 16:20], atol=1e-12)
    batch.rollout(bb.Lqr(), steps=100)
    found, true = batch.estimates(), batch.states()
    assert found.shape == (9, 32)
    assert not np.array_equal(found, true)
    errors = np.abs(found - true)
    assert errors[:, 16:20].max() < 0.03, "attitude of the body"
    assert errors[:, 7:9].max() < 0.05, "velocity of the ball, m/s"
    assert errors[:, 0:2].max() < 0.05, "position of the ball, m"
    with pytest.raises(ValueError, match="no estimator"):
        bb.Batch(1, sensors="kugle").estimates()


@pytest.mark.parametrize("model", _core.MODELS)
def test_controllers_observe_what_the_task_observes(model):
    """The reference is the controller on the estimates, and for a teacher on the states, robot by robot."""
    batch = bb.Batch(11, model=model, sensors=EVERYTHING, observation="sensors", seed=3)
    batch.reset()
    limit = batch.max_wheel_torque
    law = bb.Lqr(control_dt=0.01, max_torque=limit)

    def actions_on(states):
        return np.float32([law(state) / limit for state in states])

    for _ in range(20):
        estimates = [batch.estimate(i) for i in range(11)]
        np.testing.assert_array_equal(batch.estimates(), [state.to_array() for state in estimates])
        found = batch.control(law)
        np.testing.assert_array_equal(found, actions_on(estimates))
        truth = actions_on(batch.state(i) for i in range(11))
        np.testing.assert_array_equal(batch.control(law, privileged=True), truth)
        assert not np.array_equal(found, truth)
        batch.step(np.clip(found, -1.0, 1.0))
    taught, own = (bb.Batch(11, model=model, sensors=EVERYTHING, observation="sensors", seed=3) for _ in range(2))
    records = []
    for batch, privileged in ((taught, True), (own, False)):
        batch.reset()
        records.append(batch.rollout(law, 50, record=("states", "actions"), privileged=privileged))
    truth = bb.Batch(11, model=model, seed=3)
    truth.reset()
    expected = truth.rollout(law, 50, record=("states", "actions"))
    for name in expected:
        np.testing.assert_array_equal(records[0][name], expected[name])
        assert not np.array_equal(records[1][name], expected[name])
    with pytest.raises(ValueError, match="no estimator"):
        truth.estimate(0)
    with pytest.raises(ValueError, match="environment index = 11"):
        own.estimate(11)


LQR = bb.Lqr(control_dt=0.01)


def law_in_python(state):
    return LQR(state)


def test_every_command_has_controllers_on_estimates(capsys):
    """A controller in Python observes the same as in the core, and neither observes the truth."""
    options = {"sensors": EVERYTHING, "observation": "sensors"}
    core, python = (bb.evaluate(law, episodes=5, **options) for law in ("lqr", law_in_python))
    assert core.tilt_rms == pytest.approx(python.tilt_rms, rel=1e-6)
    assert bb.evaluate("lqr", episodes=5).tilt_rms != core.tilt_rms
    runs = [bb.simulate(law, seconds=1.0, **options, tilt=(0.05, 0.0)) for law in ("lqr", law_in_python)]
    states = [np.array([state.to_array() for state in found.states]) for found in runs]
    np.testing.assert_allclose(states[0], states[1], atol=1e-6)
    seen = [state.to_array() for state in runs[0].estimates]
    assert not np.array_equal(seen, states[0])
    action = LQR(runs[0].estimates[3])
    np.testing.assert_allclose(runs[0].torques[3], action, atol=1e-6)
    given = ["--sensors", "kugle", "--set", "observation=sensors", "--quiet", "--json", "--episodes", "5"]
    assert main(["evaluate", "--controller", "lqr", *given]) == 0
    (found,) = json.loads(capsys.readouterr().out)["results"]
    kugle = bb.evaluate("lqr", episodes=5, sensors="kugle", observation="sensors")
    assert found["tilt_rms"] == pytest.approx(kugle.tilt_rms)


def errors_under_pushes(name, impulse, seed):
    """Errors of velocity, m/s, and position, m, on a circle that is scaled to the robot, with eight pushes."""
    azimuths = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 8)
    robot = bb.Params.preset(name)
    second = robot.scale("s")
    run = bb.simulate(
        "lqr",
        robot=robot,
        reference=bb.Reference.circle(0.5 * robot.scale("m"), 10.0 * second),
        seconds=20.0 * second,
        sensors="kugle",
        observation="sensors",
        pushes=[
            bb.Push((impulse * math.cos(azimuth), impulse * math.sin(azimuth), 0.0), time=(4.0 + 2.0 * k) * second)
            for k, azimuth in enumerate(azimuths)
        ],
        seed=seed,
    )
    assert run.fell_at is None
    assert min(contacts.wheel_normal_forces.min() for contacts in run.contacts[1:]) == 0.0, "no wheel lifts"
    errors = np.array(
        [estimate.to_array() - state.to_array() for estimate, state in zip(run.estimates, run.states, strict=True)]
    )
    return np.linalg.norm(errors[:, 7:9], axis=1), np.linalg.norm(errors[:, :2], axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_pushes_that_lift_a_wheel_do_not_mislead_the_estimator(seed):
    velocity, position = errors_under_pushes("paper", 0.3, seed)
    assert velocity.max() < 0.06
    assert position.max() < 0.01


@pytest.mark.parametrize("seed", [16, 17])
def test_nor_do_pushes_of_a_robot_that_topples_slowly(seed):
    """With the paper's `slip_walk` the velocity of rezero is lost for 8 and 5 steps in a row."""
    velocity, position = errors_under_pushes("rezero", 4.0, seed)
    off = np.flatnonzero(np.diff(np.concatenate(([0], velocity > 0.1, [0]))))
    assert (off[1::2] - off[::2]).max(initial=0) <= 2, "steps in a row"
    assert position.max() < 0.1
