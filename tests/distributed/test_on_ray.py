"""Training on Ray, on a cluster of this machine; `make test-ray` installs it."""

import contextlib
import dataclasses
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ray = pytest.importorskip("ray", reason="Ray is not installed: make test-ray")
pytest.importorskip("stable_baselines3")

from ballbot_rs.analysis.episodes import evaluate  # noqa: E402
from ballbot_rs.cli import main  # noqa: E402
from ballbot_rs.control import sb3_policy  # noqa: E402
from ballbot_rs.control.onnx_policy import OnnxPolicy  # noqa: E402
from ballbot_rs.envs.registration import task_of  # noqa: E402
from ballbot_rs.envs.vector_env import BallbotVectorEnv  # noqa: E402
from ballbot_rs.training import config as config_module  # noqa: E402
from ballbot_rs.training import run_folder, seeds, train  # noqa: E402
from ballbot_rs.training.export import export  # noqa: E402
from ballbot_rs.training.on_ray.env_runner import BatchEnvRunner  # noqa: E402
from ballbot_rs.training.on_ray.fragments import Rollouts  # noqa: E402
from ballbot_rs.training.on_ray.learn import OnRay, algorithm, algorithm_config, cluster, iterate  # noqa: E402
from ballbot_rs.training.on_ray.settings import Ray  # noqa: E402
from tests.support.paths import ROOT  # noqa: E402
from tests.support.tiny_config import TINY_CONFIG  # noqa: E402

#: Episodes of an evaluation, and how many of them must succeed.
EPISODES, LEARNED = 100, 95


def balanced(policy):
    """How many episodes end upright and at the setpoint."""
    found = evaluate(str(policy), task="balance", episodes=EPISODES)
    return round(found.success_rate * EPISODES)


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    """The folder of a whole training with two workers of 64 robots, by the command."""
    folder = tmp_path_factory.mktemp("ray") / "run"
    command = ["train", "balance", "--on", "ray", "--workers", "2", "--run", str(folder)]
    assert main([*command, "--quiet", "--episodes", "0", "--no-report"]) == 0
    assert not ray.is_initialized()
    return folder


def test_two_workers_of_64_robots_learn_to_balance(learned):
    assert balanced(learned / run_folder.BEST) >= LEARNED


def test_the_run_is_an_ordinary_run(learned):
    evaluations = run_folder.read_evaluations(learned)
    assert evaluations.timesteps[-1] >= 280_000
    assert evaluations.returns.shape == (len(evaluations.timesteps), 50)
    assert run_folder.read_record(learned)["timesteps"] >= 280_000
    steps = [int(path.stem.split("_")[-2]) for path in run_folder.checkpoints(learned)]
    assert len(steps) >= 4
    assert steps[0] == evaluations.timesteps[-1]


def test_its_policy_is_exported_with_its_metadata(learned, tmp_path):
    target = tmp_path / "policy.onnx"
    assert export(learned, target) <= 1e-5
    assert OnnxPolicy(target).task == "balance"
    assert balanced(target) >= LEARNED


def test_a_killed_worker_is_replaced_and_training_continues(tmp_path):
    where, seen = Ray(2), {}

    def each(made, do):
        return made.env_runner_group.foreach_env_runner(do, local_env_runner=False)

    class Killing(OnRay):
        def __call__(self, session):
            with cluster(where), algorithm(where, session) as made:
                once, calls = made.train, []

                def train_and_kill():
                    calls.append(None)
                    if len(calls) == 20:
                        seen["before"] = each(made, lambda runner: (os.getpid(), runner.env.np_random_seed))
                        os.kill(seen["before"][0][0], signal.SIGKILL)
                    return once()

                made.train = train_and_kill
                iterate(session, made)
                seen["after"] = each(made, lambda runner: (os.getpid(), runner.env.np_random_seed))

    config, text = config_module.load("balance")
    policy = train.train(config, text, tmp_path / "run", learn=Killing(where), progress_bar=False)
    assert balanced(policy) >= LEARNED
    (killed, old), (other, others) = seen["before"]
    pids = [pid for pid, _ in seen["after"]]
    assert len(pids) == 2
    assert other in pids
    assert killed not in pids
    (new,) = (seeds for pid, seeds in seen["after"] if pid != other)
    assert len({*old, *others, *new}) == 3 * 64


@pytest.fixture
def session(tmp_path):
    """What a training of eight robots hands to its loop."""
    config = config_module.parse(TINY_CONFIG, "tiny")
    got = []

    class Kept(OnRay):
        def __call__(self, session):
            got.append(session)

    train.train(config, TINY_CONFIG, tmp_path / "run", seed=3, learn=Kept(Ray(1)), progress_bar=False)
    return got[0]


def test_workers_have_different_seeds(session):
    where = Ray(4)
    with cluster(where), algorithm(where, session) as made:
        made.train()
        seeds = made.env_runner_group.foreach_env_runner(
            lambda runner: runner.env.np_random_seed, local_env_runner=False
        )
    base = seeds.first_seed(3)
    assert sorted(seed for each in seeds for seed in each) == list(range(base, base + 8))


def test_a_worker_sends_the_rollouts_of_its_policy(session):
    runner = BatchEnvRunner(config=algorithm_config(Ray(1), session.config, session.model, 3), worker_index=1)
    runner.module.policy.load_state_dict(session.model.policy.state_dict())
    episodes = [episode for _ in range(3) for episode in runner.sample()]
    metrics = runner.get_metrics()

    env = BallbotVectorEnv(8, task=task_of(session.config.env_id), num_threads=1, **session.config.env)
    base = seeds.first_seed(3)
    expected = Rollouts(env, base, np.random.default_rng(base))
    collected = [expected.collect(runner.module.distribution, 32) for _ in range(3)]
    fragments = [fragment for more, _ in collected for fragment in more]
    assert len(episodes) == len(fragments)
    for episode, fragment in zip(episodes, fragments, strict=True):
        np.testing.assert_array_equal(episode.get_observations(), fragment.observations)
        np.testing.assert_array_equal(episode.get_actions(), fragment.actions)
        np.testing.assert_array_equal(episode.get_rewards(), fragment.rewards)
        assert (episode.is_terminated, episode.is_truncated) == (fragment.terminated, fragment.truncated)
        assert (episode.t_started, episode.t) == (fragment.start, fragment.start + len(fragment))
    ended = [one for _, over in collected for one in over]
    assert metrics["episode_return_mean"].peek() == pytest.approx(np.mean([one.total_reward for one in ended]))
    assert metrics["num_env_steps_sampled"].peek() == sum(map(len, fragments))
    runner.stop()


def test_the_policy_of_a_worker_matches_the_model(session):
    runner = BatchEnvRunner(config=algorithm_config(Ray(1), session.config, session.model, 3), worker_index=1)
    state = {"rl_module": {f"policy.{name}": value for name, value in session.model.policy.state_dict().items()}}
    runner.set_state({**runner.get_state(), **state})
    observations = session.model.observation_space.sample()[None]
    means, _ = runner.module.distribution(observations)
    expected, _ = session.model.predict(observations, deterministic=True)
    np.testing.assert_allclose(np.clip(means, -1.0, 1.0), expected, atol=1e-6)


def test_another_autoreset_mode_fails_loudly(session):
    config = algorithm_config(Ray(1), session.config, session.model, 3)
    config.env_config["autoreset_mode"] = "same_step"
    runner = BatchEnvRunner(config=config, worker_index=1)
    with pytest.raises(ValueError, match="autoreset_mode = same_step: rollouts on Ray expect next_step"):
        runner.sample()


def adam_steps(path):
    """Updates that the optimizer of a checkpoint has made."""
    model, _ = sb3_policy.load(path)
    return {int(state["step"]) for state in model.policy.optimizer.state_dict()["state"].values()}


def run_tiny(folder, timesteps, *given):
    command = ["train", "--timesteps", str(timesteps), *given, "--quiet", "--episodes", "0", "--no-report"]
    assert main([*command, *(["--resume"] if folder.exists() else ["--run"]), str(folder)]) == 0
    return run_folder.checkpoints(folder)[0]


def test_a_run_resumes_from_its_checkpoint_with_or_without_ray(tmp_path):
    (tmp_path / "tiny.toml").write_text(TINY_CONFIG, encoding="utf-8")
    folder, on_ray = tmp_path / "run", ("--on", "ray", "--workers", "2")
    first = run_tiny(folder, 768, *on_ray, "--config", str(tmp_path / "tiny.toml"))
    (begun,) = adam_steps(first)
    second = run_tiny(folder, 1536, *on_ray)
    (resumed,) = adam_steps(second)
    assert begun >= 12
    assert resumed >= begun + 12
    third = run_tiny(folder, 2048)
    (alone,) = adam_steps(third)
    assert alone > resumed
    fourth = run_tiny(folder, 2560, *on_ray)
    (again,) = adam_steps(fourth)
    assert again > alone
    evaluations = run_folder.read_evaluations(folder)
    assert (np.diff(evaluations.timesteps) > 0).all()
    assert evaluations.timesteps[-1] >= 2560


def test_a_training_with_a_teacher_begins_with_the_fit(tmp_path):
    text = config_module.with_values(
        TINY_CONFIG,
        {"teacher.controller": "lqr", "teacher.rounds": 1, "teacher.steps": 20, "teacher.value_rollouts": 1},
    )
    printed = []
    train.train(
        config_module.parse(text, "tiny"),
        text,
        tmp_path / "run",
        learn=OnRay(Ray(1)),
        tell=printed.append,
        progress_bar=False,
    )
    assert printed[0].startswith("fitted to lqr: ")
    assert run_folder.read_evaluations(tmp_path / "run").timesteps[0] == 0


def test_workers_that_fail_to_start_end_the_training(session):
    config = dataclasses.replace(session.config, env={"model": "nothing"})
    with pytest.raises(RuntimeError, match=r"none of 2 workers could be started: their logs are in .*/logs"):
        OnRay(Ray(2))(dataclasses.replace(session, config=config))
    assert not ray.is_initialized()


def test_robots_that_cannot_be_divided_evenly_are_rejected(tmp_path, capsys):
    code = main(["train", "balance", "--on", "ray", "--workers", "3", "--run", str(tmp_path / "run"), "--quiet"])
    assert code == 1
    assert "num_envs = 128 robots are not a multiple of 3 workers" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


#: Where they find the package.
PATH = str(ROOT / "python")
#: The address by which the processes of a cluster find each other.
TOKEN = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}


@contextlib.contextmanager
def head(folder, path):
    """A separate cluster, with what is on its path; its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    program = Path(sys.executable).with_name("ray")
    command = [str(program), "start", "--head", "--block", f"--port={port}", "--num-cpus=2"]
    command.append("--include-dashboard=false")
    variables = {**os.environ, **TOKEN, "PYTHONPATH": path}
    with (folder / "head.txt").open("w") as log:
        process = subprocess.Popen(command, cwd=folder, env=variables, stdout=log, stderr=log)
        try:
            for _ in range(120):
                if "--block" in (folder / "head.txt").read_text():
                    break
                assert process.poll() is None, (folder / "head.txt").read_text()
                time.sleep(0.5)
            yield f"127.0.0.1:{port}"
        finally:
            process.terminate()
            process.wait(60)


def train_tiny(folder, address, workers, *arguments):
    """The output of the command, in a process that has not connected to another cluster."""
    (folder / "tiny.toml").write_text(TINY_CONFIG, encoding="utf-8")
    command = [sys.executable, "-m", "ballbot_rs.cli", "train", "--config", "tiny.toml", "--run", "run"]
    command += ["--on", "ray", "--ray-address", address, "--workers", str(workers)]
    command += ["--episodes", "0", "--no-report", "--quiet", *arguments]
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **TOKEN, "PYTHONPATH": PATH},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    return done.returncode, done.stderr


def test_a_cluster_is_joined(tmp_path):
    with head(tmp_path, PATH) as address:
        code, printed = train_tiny(tmp_path, address, 2)
        assert code == 0, printed
        code, printed = train_tiny(tmp_path, address, 4, "--overwrite")
        assert (code, "--workers 4 is out of range: the cluster has 2 cores" in printed) == (1, True), printed
    # The run of the first training, which the second was to overwrite.
    assert run_folder.read_evaluations(tmp_path / "run").timesteps[-1] >= 768


def test_a_cluster_without_the_package_is_rejected(tmp_path):
    with head(tmp_path, "") as address:
        code, printed = train_tiny(tmp_path, address, 1)
    assert code == 1
    assert f"ballbot_rs cannot be imported on the cluster {address}: " in printed


def test_an_interrupted_training_keeps_a_checkpoint(tmp_path):
    def interrupt(_):
        raise KeyboardInterrupt

    class Interrupted(OnRay):
        def __call__(self, session):
            session.keep_best.evaluate_and_log = interrupt
            super().__call__(session)

    config = config_module.parse(TINY_CONFIG, "tiny")
    with pytest.raises(KeyboardInterrupt):
        train.train(config, TINY_CONFIG, tmp_path / "run", learn=Interrupted(Ray(1)), progress_bar=False)
    assert run_folder.checkpoints(tmp_path / "run")
    assert not ray.is_initialized()
