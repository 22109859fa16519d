"""Motors of environments: the same on every front end, from any source, in files of policies and in a closed loop."""

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
from tests.support.names import BALANCE
from tests.support.paths import ASSETS
from tests.support.tiny_config import TINY_CONFIG

#: Every effect at once.
EVERYTHING = {
    "delay": 0.026,
    "strength": [0.9, 1.0, 1.1],
    "lag": 0.007,
    "stall_torque": 0.6,
    "no_load_speed": 40.0,
    "speed_limit": 20.0,
    "peak_torque": 0.4,
    "delay_jitter": 0.004,
}
#: Without a separate seed.
ACTIONS = 0.3 * np.sin(np.arange(60).reshape(20, 3)).astype(np.float32)


def front_ends(**options):
    """Functions from a seed to the observations of a first robot under `ACTIONS`."""

    def batch(seed):
        made = bb.Batch(2, autoreset="next_step", seed=seed, **options)
        first = made.reset()[0]
        return [first, *(made.step(np.tile(action, (2, 1)))[0][0] for action in ACTIONS)]

    def single(make):
        def observations(seed):
            env = make()
            first, _ = env.reset(seed=seed)
            return [first, *(env.step(action)[0] for action in ACTIONS)]

        return observations

    def vector(make):
        def observations(seed):
            env = make()
            first, _ = env.reset(seed=seed)
            return [first[0], *(env.step(np.tile(action, (2, 1)))[0][0] for action in ACTIONS)]

        return observations

    def sb3(seed):
        env = bb.BallbotVecEnv(2, seed=seed, **options)
        first = env.reset()
        return [first[0], *(env.step(np.tile(action, (2, 1)))[0][0] for action in ACTIONS)]

    return {
        "Batch": batch,
        "BalanceEnv": single(lambda: bb.BalanceEnv(**options)),
        "BallbotEnv": single(lambda: bb.BallbotEnv("balance", **options)),
        "gymnasium.make": single(lambda: gymnasium.make(BALANCE, **options)),
        "BalanceVectorEnv": vector(lambda: bb.BalanceVectorEnv(2, **options)),
        "BallbotVectorEnv": vector(lambda: bb.BallbotVectorEnv(2, **options)),
        "gymnasium.make_vec": vector(lambda: gymnasium.make_vec(BALANCE, num_envs=2, **options)),
        "BallbotVecEnv": sb3,
    }


@pytest.mark.parametrize("model", _core.MODELS)
def test_every_front_end_has_the_same_motors(model):
    ends = front_ends(model=model, actuators=EVERYTHING)
    expected = np.array(ends["Batch"](3))
    assert not np.array_equal(expected, np.array(front_ends(model=model)["Batch"](3)))
    for name, observations in ends.items():
        np.testing.assert_array_equal(np.array(observations(3)), expected, err_msg=name)


def test_motors_come_from_names_files_and_dicts(tmp_path):
    kugle = bb.load_actuators("kugle")
    path = tmp_path / "mine.toml"
    path.write_text("[actuators]\nstrength = 0.9\ndelay = 0.004\n")
    mine = {**bb.load_actuators("ideal"), "strength": [0.9] * 3, "delay": 0.004}
    assert bb.load_actuators(path) == bb.load_actuators(str(path)) == mine
    for given, expected in [
        (None, None),
        ({}, None),
        ("ideal", None),
        (bb.load_actuators("ideal"), None),
        ("kugle", kugle),
        (kugle, kugle),
        (path, mine),
        (str(path), mine),
        ({"delay": np.float32(0.0), "strength": np.full(3, 0.9)}, {**mine, "delay": 0.0}),
    ]:
        batch = bb.Batch(1, robot="kugle", actuators=given)
        assert batch.options["actuators"] == expected
        assert json.loads(json.dumps(batch.options))["actuators"] == expected
        again = bb.Batch(1, robot="kugle", **batch.options)
        assert again.options == batch.options


def test_a_robots_file_has_parameters_and_motors(tmp_path, capsys):
    path = tmp_path / "robot.toml"
    path.write_text(bb.Params.preset("kugle").to_toml() + "\n[actuators]\ndelay = 0.01\n")
    assert bb.Params.from_toml(path) == bb.Params.preset("kugle")
    env = bb.BalanceEnv(robot=path, actuators=path)
    assert env.task_options["actuators"]["delay"] == 0.01
    command = ["evaluate", "--episodes", "2", "--quiet", "--robot", str(path), "--actuators", str(path)]
    assert main(command) == 0
    capsys.readouterr()


def test_the_velocity_of_a_urdf_is_the_speed_limit(tmp_path):
    expected = {**bb.load_actuators("ideal"), "speed_limit": 100.0}
    bot = ASSETS / "bot.urdf"
    for path in (bot, str(bot)):
        assert bb.load_actuators(path) == bb.Batch(1, actuators=path).options["actuators"] == expected
    broken = tmp_path / "bot.urdf"
    broken.write_text(bot.read_text().replace('velocity="100"', 'velocity="50"', 1))
    with pytest.raises(bb.UrdfError, match="the wheels differ: joint velocity limit = 100"):
        bb.BalanceEnv(actuators=broken)


def test_what_is_returned_is_a_copy():
    batch = bb.Batch(1, actuators=EVERYTHING)
    batch.options["actuators"]["delay"] = 5.0
    assert batch.options["actuators"]["delay"] == EVERYTHING["delay"]


@pytest.mark.parametrize(
    ("actuators", "kind", "message"),
    [
        ({"delai": 1.0}, ValueError, "unknown option of actuators 'delai': expected one of delay, strength"),
        (
            {"delay": 0.003},
            ValueError,
            r"delay / sim_dt = 1.5 .* \(delay = 0.003 s, sim_dt = 0.002 s; valid near it: 0.002 s and 0.004 s\)",
        ),
        ({"lag": -1.0}, ValueError, "actuators.lag = -1 is out of range: it must be >= 0 and <= 10 s"),
        ({"strength": [1.0, 2.0]}, ValueError, "actuators.strength has 2 values, expected 3"),
        ({"stall_torque": 1.0}, ValueError, "a torque-speed curve needs both above 0"),
        ({"peak_torque": 6.0}, ValueError, "params.max_wheel_torque = 5 N·m"),
        ({"delay": math.nan}, ValueError, "actuators.delay = NaN"),
        ({"delay": "fast"}, TypeError, "actuators.delay must be a number"),
        ({1: 2.0}, TypeError, "actuators has the key 1, expected names"),
        ("kugel", ValueError, "unknown actuators 'kugel': expected one of ideal, kugle"),
        ("nowhere.toml", FileNotFoundError, "nowhere.toml"),
        (3, TypeError, "actuators must be a dict of options, a name, the path .* or None, not int"),
        ([1.0], TypeError, "not list"),
    ],
)
def test_invalid_values_are_rejected_by_every_front_end(actuators, kind, message):
    for make in (
        lambda: bb.Batch(1, actuators=actuators),
        lambda: bb.BalanceEnv(actuators=actuators),
        lambda: bb.BallbotVectorEnv(2, actuators=actuators),
        lambda: bb.BallbotVecEnv(2, actuators=actuators),
        lambda: gymnasium.make(BALANCE, actuators=actuators),
    ):
        with pytest.raises(kind, match=message):
            make()


def test_motors_are_fixed_once_an_environment_is_made():
    with pytest.raises(AttributeError, match="actuators is fixed once an environment is made"):
        bb.BallbotVecEnv(1).set_attr("actuators", None)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_has_the_delayed_commands(copied):
    env = bb.BalanceEnv(actuators=EVERYTHING)
    env.reset(seed=1)
    for action in ACTIONS[:7]:
        env.step(action)
    other = copied(env)
    for action in ACTIONS[7:]:
        np.testing.assert_array_equal(other.step(action)[0], env.step(action)[0])


def test_a_policy_keeps_its_motors(tmp_path, capsys):
    env = bb.BallbotVecEnv(1, model="spatial", actuators=EVERYTHING)
    path = bb.save(PPO("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, seed=0), tmp_path / "p.zip")
    assert find(path).env_options["actuators"] == EVERYTHING
    assert main(["export", str(path), "-o", str(tmp_path / "p.onnx")]) == 0
    assert find(tmp_path / "p.onnx").env_options["actuators"] == EVERYTHING
    given, own, ideal = (
        bb.evaluate(path, episodes=3, **options) for options in ({"actuators": EVERYTHING}, {}, {"actuators": None})
    )
    assert own == given
    assert own.tilt_rms != ideal.tilt_rms
    capsys.readouterr()


def test_a_run_keeps_its_motors(tmp_path, capsys):
    config = tmp_path / "tiny.toml"
    config.write_text(TINY_CONFIG)
    motors = tmp_path / "motors.toml"
    motors.write_text("[actuators]\ndelay = 0.01\nlag = 0.02\n")
    folder = tmp_path / "run"
    common = ["--config", str(config), "--run", str(folder), "--quiet", "--no-report", "--episodes", "0"]
    assert main(["train", "balance", *common, "--actuators", str(motors)]) == 0
    options = find(folder).env_options["actuators"]
    assert (options["delay"], options["lag"]) == (0.01, 0.02)
    motors.unlink()
    assert main(["train", "--resume", str(folder), "--quiet", "--no-report", "--episodes", "0"]) == 0
    assert find(folder).env_options["actuators"] == options
    capsys.readouterr()


def test_commands_accept_motors(tmp_path, capsys):
    def results(*arguments):
        assert main(["evaluate", "--episodes", "3", "--json", *arguments]) == 0
        return json.loads(capsys.readouterr().out)["results"]

    motors = tmp_path / "motors.toml"
    motors.write_text("[actuators]\ndelay = 0.02\n")
    ideal = results()
    assert results("--actuators", "ideal") == ideal
    delayed = results("--actuators", str(motors))
    assert delayed != ideal
    assert results("--set", "actuators.delay=0.02") == delayed
    still = ["--no-video", "--still", "0", "--size", "32", "24", "--seconds", "0.1", "-o", str(tmp_path / "a.mp4")]
    assert main(["record", "--actuators", str(motors), *still]) == 0
    figures = ["--figure", "phase_portrait", "--seconds", "0.1", "-o", str(tmp_path / "figures")]
    assert main(["plot", "balance", "--actuators", str(motors), *figures]) == 0
    assert main(["evaluate", "--actuators", "kugel"]) == 1
    assert "unknown actuators 'kugel': expected one of ideal, kugle" in capsys.readouterr().err
    assert main(["view", "--no-open", "--set", "actuators=kugle"]) == 1
    # Kugle's motors are too strong for the paper's wheels, on the page as in any environment.
    assert "actuators.stall_torque / actuators.no_load_speed = " in capsys.readouterr().err


#: s.
SIM_DT, CONTROL_DT = 0.002, 0.01
SUBSTEPS = 5


def closed_loop(delay_steps, lag):
    """The linear model under LQR with delay (model steps) and lag (s), over a control step, and how many states it has.

    Its state: the state of the linear model, the three lagging torques, and the commands of the control steps before.
    """
    linear = bb.LinearModel(bb.Params.paper())
    gain = bb.Lqr(control_dt=CONTROL_DT).gain
    a, b = linear.discretize(SIM_DT)
    kept = delay_steps // SUBSTEPS + 1
    size = 13 + 3 * kept
    state, torque = np.eye(10, size), np.eye(3, size, 10)
    # The present command, then those before it.
    commands = [-gain @ state, *(np.eye(3, size, 13 + 3 * age) for age in range(kept))]
    for step in range(SUBSTEPS):
        delayed = commands[-((step - delay_steps) // SUBSTEPS)]
        torque = torque + (1.0 - math.exp(-SIM_DT / lag) if lag else 1.0) * (delayed - torque)
        state = a @ state + b @ torque
    return np.vstack([state, torque, *commands[:kept]])


@pytest.mark.parametrize(("delay_steps", "lag"), [(0, 0.0), (7, 0.0), (0, 0.03), (12, 0.02), (35, 0.0)])
def test_a_closed_loop_matches_the_linear_model(delay_steps, lag):
    matrix = closed_loop(delay_steps, lag)
    batch = bb.Batch(
        1,
        model="spatial",
        sim_dt=SIM_DT,
        control_dt=CONTROL_DT,
        max_wheel_torque=5.0,
        actuators={"delay": delay_steps * SIM_DT, "lag": lag},
    )
    tilt = 1e-5
    batch.reset(starts=[bb.State.at_rest(batch.params(), tilt=(tilt, 0.0))])
    states = batch.rollout(bb.Lqr(control_dt=CONTROL_DT), 100, record=("states",))["states"][:, 0]
    expected = np.zeros(len(matrix))
    expected[2] = tilt
    worst = 0.0
    for row in states:
        found = bb.State.from_array(row).tilt_components
        worst = max(worst, float(np.abs(found - expected[2:4]).max()) / tilt)
        expected = matrix @ expected
    print(f"delay {delay_steps} steps, lag {lag} s: within {worst:.1e} of the linear model")
    assert worst < 1e-5


def test_the_delay_at_which_lqr_fails_matches_the_linear_model():
    radii = [np.abs(np.linalg.eigvals(closed_loop(steps, 0.0))).max() for steps in (28, 29)]
    assert radii[0] < 1.0 < radii[1]
    for delay, grows in ((0.05, False), (0.066, True)):
        batch = bb.Batch(1, model="spatial", max_wheel_torque=5.0, actuators={"delay": delay})
        batch.reset(starts=[bb.State.at_rest(batch.params(), tilt=(1e-6, 0.0))])
        found = batch.rollout(bb.Lqr(control_dt=CONTROL_DT), 400, record=("states",))["states"][:, 0]
        tilts = np.array([bb.State.from_array(row).tilt for row in found])
        assert (tilts[-50:].max() > 10.0 * tilts[:50].max()) == grows
