"""Evolution of policies: its runs, and their policies in every command."""

import json
import subprocess
import sys

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import TASKS
from ballbot_rs.cli import main
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.control.resolve import find
from ballbot_rs.training import config, evolution, run_folder
from ballbot_rs.training.symmetry import linear_policies, symmetries

#: Robots that start at rest: a policy of almost no torque keeps them upright for a while.
EASY = """
env_id = "ballbot/Balance-v0"
algorithm = "CMA"
total_timesteps = 20_000
max_timesteps = 20_000

[env]
model = "contact"
max_episode_steps = 210
reset_tilt = 0.0
reset_tilt_rate = 0.0
reset_ball_speed = 0.0

[evaluation]
every_timesteps = 1000
episodes = 20
success = 0.9

[algorithm_arguments]
sigma = 1e-6
"""


def trained(folder, text=EASY, **arguments):
    policy = evolution.train(config.parse(text, "test"), text, folder, seed=5, **arguments)
    return policy, run_folder.read_record(folder), run_folder.read_evaluations(folder)


def test_a_run_ends_with_a_policy_that_succeeds(tmp_path):
    done = []
    policy, record, evaluations = trained(tmp_path / "run", progress=lambda *of: done.append(of))
    assert (record["success"], record["required_success"], record["seed"]) == (1.0, 0.9, 5)
    assert run_folder.failure(record) is None
    assert evaluations.successes.shape == (len(done), 20)
    assert evaluations.successes[-1].all()
    assert record["timesteps"] == done[-1][0] == evaluations.timesteps[-1] + evaluations.lengths[-1].sum()
    loaded = OnnxPolicy(policy)
    assert loaded.metadata["algorithm"] == "CMA"
    assert loaded.env_options["max_episode_steps"] == 210
    result, _ = bb.compare([str(tmp_path / "run"), "lqr"], episodes=10)
    assert result.success_rate == 1.0


def test_a_run_is_reproducible(tmp_path):
    numbers = [
        trained(tmp_path / str(threads), config.with_values(EASY, {"num_threads": threads}))[0].read_bytes()
        for threads in (1, 2)
    ]
    assert numbers[0] == numbers[1]


@pytest.mark.parametrize("hidden", [[], [8, 4]])
def test_the_saved_policy_acts_as_the_searched_one(tmp_path, hidden):
    text = config.with_values(EASY, {"policy.net_arch": hidden, "algorithm_arguments.sigma": 1.0})
    search = evolution.Evolution(config.parse(text, "test"), 5)
    for _ in search.run():
        pass
    search.write(tmp_path)
    batch = bb.Batch(1, model="contact", max_episode_steps=210)
    batch.reset()
    network = search._space.network(search.best.numbers[None])
    runs = batch.rollout(policies=network, steps=30, record=["observations", "actions"])
    actions = find(str(tmp_path)).policy(runs["observations"][:-1, 0].astype(np.float32))
    np.testing.assert_allclose(actions, runs["actions"][:, 0], rtol=0, atol=1e-5)
    assert np.ptp(actions) > 1e-3


def test_a_policy_that_does_not_succeed_is_a_named_failure(tmp_path, capsys):
    run = tmp_path / "run"
    arguments = ["train", "balance", "--algorithm", "cma", "--timesteps", "20000", "--run", str(run), "--json"]
    assert main([*arguments, "--episodes", "0", "--no-report"]) == 1
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert (found["success"], found["required_success"]) == (0.0, 0.99)
    assert 20_000 <= found["timesteps"] < 40_000
    assert "the training has failed: after" in err
    assert run_folder.read_config_text(run) == config.with_values(
        evolution.adapted(config.default_text("balance")), {"total_timesteps": 20000, "max_timesteps": 20000}
    )
    assert main(["train", "--resume", str(run)]) == 1
    assert "a run of evolution keeps no checkpoints: begin it again with --overwrite" in capsys.readouterr().err
    assert main([*arguments, "--episodes", "0"]) == 1
    assert "holds an earlier run" in capsys.readouterr().err


def test_a_run_needs_no_torch(tmp_path):
    (tmp_path / "easy.toml").write_text(EASY, encoding="utf-8")
    arguments = ["train", "--config", str(tmp_path / "easy.toml"), "--run", str(tmp_path / "run"), "--no-report"]
    code = (
        "import sys; from ballbot_rs.cli import main; assert main(sys.argv[1:]) == 0; "
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, *arguments, "--quiet"], check=True, timeout=300)


def test_a_policy_is_written_as_c(tmp_path, capsys):
    trained(tmp_path / "run")
    assert main(["export", str(tmp_path / "run"), "-o", str(tmp_path / "policy.h")]) == 0
    assert "A policy (CMA) of the task 'balance'" in (tmp_path / "policy.h").read_text(encoding="ascii")
    capsys.readouterr()
    assert main(["report", str(tmp_path / "run"), "--video-seconds", "0", "--episodes", "5"]) == 0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("algorithm_arguments.population", 2, "algorithm_arguments: population = 2, it must be at least 4"),
        ("algorithm_arguments.starts", 0.5, "algorithm_arguments: starts = 0.5 is not a whole number"),
        ("algorithm_arguments.sigma", 0.0, "algorithm_arguments: sigma = 0.0 is out of range"),
        ("algorithm_arguments.n_steps", 8, "algorithm_arguments got an unexpected keyword argument 'n_steps'"),
        ("algorithm_arguments.symmetric", 1, "algorithm_arguments: symmetric = 1 is not a boolean"),
        ("env.robot", ["paper", "kugle"], "robot: evolution tries each policy on one robot, not on several"),
        ("policy.net_arch", [0], "net_arch: a width of 0 is out of range"),
        ("policy.activation_fn", "relu", "evolution accepts only net_arch"),
    ],
)
def test_an_invalid_configuration_is_rejected(tmp_path, name, value, message):
    with pytest.raises(ValueError, match=message):
        trained(tmp_path / "run", config.with_values(EASY, {name: value}))
    assert not (tmp_path / "run").exists()


def test_a_search_that_is_stuck_begins_again_with_more_policies(monkeypatch):
    populations = []
    arguments = {"population": 8, "search_steps": 1}
    text = config.with_values(EASY, {"env.reset_tilt": 0.3, "algorithm_arguments": arguments})
    search = evolution.Evolution(config.parse(text, "test"), 5)
    made = search._cmaes.CMA

    def noted(**arguments):
        populations.append(arguments["population_size"])
        return made(**arguments)

    monkeypatch.setattr(search._cmaes, "CMA", noted)
    for _ in search.run():
        pass
    assert populations[:2] == [8, 16]


def space_of(**values):
    return evolution.Evolution(config.parse(config.with_values(EASY, values), "test"), 5)._space


def test_policies_are_symmetric_where_robots_are():
    assert space_of().size == 9
    assert space_of(**{"algorithm_arguments.symmetric": False}).size == 51
    uneven = {"env.robot": bb.Params.paper().replace(wheel_azimuths=(0.0, 2.0, 4.0)).to_dict()}
    assert space_of(**uneven).size == 51
    leaning = {"env.robot": bb.Params.paper().replace(body_com_offset=(0.003, 0.0)).to_dict()}
    assert space_of(**leaning).size == 51
    assert space_of(**leaning, **{"algorithm_arguments.symmetric": True}).size == 9
    assert space_of(**{"policy.net_arch": [8]}).size == 16 * 8 + 8 + 8 * 3 + 3
    expected = {"algorithm_arguments.symmetric": True}
    assert space_of(**expected).size == 9
    with pytest.raises(ValueError, match="symmetric = True: the wheels of robot 0 are not identical"):
        space_of(**expected, **uneven)
    assert space_of(**{"env.history": 5}).size == 9 * 5
    assert space_of(**{"env.history": 50}).size == 3 * (16 * 50 + 1)
    with pytest.raises(ValueError, match="symmetric = True: an observation has 800 rows, but at most 200 are"):
        space_of(**expected, **{"env.history": 50})
    with pytest.raises(ValueError, match=r"symmetric = True: only linear policies can be symmetric, but"):
        space_of(**expected, **{"policy.net_arch": [8]})


def test_coordinates_of_one_give_actions_of_one():
    """Independent of how much each row of an observation varies, and of how rows depend on each other."""
    names = tuple(row["name"] for row in TASKS["balance"]["observation"])
    basis = linear_policies(symmetries(names, 1))
    rng = np.random.default_rng(2)
    seen = rng.standard_normal((2000, 16)) * np.geomspace(0.5, 2.0, 16)
    space = evolution.Symmetric(basis).scaled(seen)
    ((weights, biases),) = space.network(rng.standard_normal((500, 9)))
    actions = np.einsum("poi,ni->pno", weights, seen) + biases[:, None]
    assert np.sqrt(np.square(actions).mean()) == pytest.approx(1.0, rel=0.05)
    # Robots at rest show nothing.
    quiet = np.zeros_like(seen)
    assert evolution.Symmetric(basis).scaled(quiet).network(np.eye(9))[0][0] == pytest.approx(basis)


@pytest.mark.slow("a training")
@pytest.mark.parametrize("robot", bb.Params.preset_names())
def test_linear_policies_balance(tmp_path, robot):
    text = config.with_values(evolution.adapted(config.default_text("balance")), {"env.robot": robot})
    _, record, _ = trained(tmp_path / "run", text)
    assert record["success"] == 1.0
