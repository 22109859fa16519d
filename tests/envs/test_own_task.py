"""A task and a controller of another crate, one file each, and a preset: through batch, front ends and command line.

`make test-builds` runs these: they compile the bindings a second time, which takes minutes. The extension module of
tests/extension has the shuttle task and the feedback controller of the core's tests. The
package contains neither.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT

pytest.importorskip("stable_baselines3")
if "BALLBOT_EXTENSION" not in os.environ:
    pytest.skip("make test-builds runs these", allow_module_level=True)

CONFIG = """\
env_id = "ballbot/Shuttle-v0"
algorithm = "PPO"
total_timesteps = 768
num_envs = 8
num_threads = 1

[env]
model = "contact"
speed = 0.2
max_episode_steps = 60

[evaluation]
every_timesteps = 256
episodes = 4

[algorithm_arguments]
n_steps = 32
batch_size = 64
n_epochs = 1
"""

Run = Callable[..., str]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs Python with the extended module; the output."""
    cargo = shutil.which("cargo")
    if cargo is None:
        pytest.skip("cargo builds the extension")
    build = [cargo, "build", "--locked", "--quiet", "-p", "ballbot-extension", "--message-format=json"]
    messages = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False, timeout=1800)
    assert messages.returncode == 0, messages.stderr
    artifacts = [json.loads(line) for line in messages.stdout.splitlines()]
    names = [a["filenames"][0] for a in artifacts if a.get("target", {}).get("name") == "ballbot_extension"]
    folder = tmp_path_factory.mktemp("extended")

    def run(*arguments: str) -> str:
        command = [sys.executable, str(ROOT / "tests/support/extended.py"), names[-1], *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=600)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def test_front_ends_have_the_task(run: Run) -> None:
    code = """
import gymnasium, numpy as np
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
import ballbot_rs as bb
from ballbot_rs._core import TASKS

env = gymnasium.make("ballbot/Shuttle-v0", model="contact", speed=0.2)
check_env(env.unwrapped, skip_render_check=True)
rows = TASKS["shuttle"]["observation"]
assert env.observation_space.shape == (len(rows),) != (16,), rows
assert env.spec.max_episode_steps == 600
vector = gymnasium.make_vec("ballbot/Shuttle-v0", num_envs=11, model="contact", speed=0.2)
seen, _ = vector.reset(seed=5)
first, _ = env.reset(seed=5)
assert (seen[0] == first).all()
action = np.array([0.1, -0.2, 0.3], np.float32)
for _ in range(300):
    seen, rewards, *_ = vector.step(np.tile(action, (11, 1)))
    one, reward, terminated, truncated, info = env.step(action)
    assert (seen[0] == one).all() and rewards[0] == reward
    if terminated:
        break
print(terminated, env.unwrapped.metadata["terminations"][info["termination"]])
try:
    gymnasium.make("ballbot/Shuttle-v0", sped=0.2)
except TypeError as error:
    print(error)
PPO("MlpPolicy", bb.BallbotVecEnv(8, task="shuttle", model="contact"), n_steps=16, batch_size=64).learn(256)
"""
    printed = run("-c", code).splitlines()
    assert printed[0] in {"True tilt", "True off_track"}
    assert "unexpected keyword argument 'sped'" in printed[1]


def test_batch_follows_commands_under_the_controller(run: Run) -> None:
    code = """
import numpy as np
import ballbot_rs as bb

batch = bb.Batch(20, "shuttle", model="contact", autoreset="next_step", seed=3, reset_tilt=[0.0, 0.0], interval=1000)
batch.reset()
law = bb.Controller("feedback", control_dt=batch.control_dt)
runs = batch.rollout(law, 300, record=("states", "rewards", "terminated"))
velocity = runs["states"][-1][:, 7:9]
print(int(runs["terminated"].sum()), float(np.linalg.norm(velocity, axis=1).mean()))
print(sorted(batch.options))
"""
    printed = run("-c", code).splitlines()
    terminated, speed = printed[0].split()
    assert int(terminated) == 0
    assert float(speed) > 0.02, "the ball follows no command"
    assert "track" in printed[1]


def test_command_line_has_task_and_controller(run: Run, tmp_path: Path) -> None:
    robot = tmp_path / "tall.toml"
    text = (ROOT / "crates/ballbot-base/robots/paper.toml").read_text(encoding="utf-8")
    robot.write_text(text.replace("body_com_height = 0.142", "body_com_height = 0.2"), encoding="utf-8")
    assert "0.2" in robot.read_text(encoding="utf-8")
    (tmp_path / "shuttle.toml").write_text(CONFIG, encoding="utf-8")

    cli = ("-m", "ballbot_rs.cli")
    assert "shuttle" in run(*cli, "evaluate", "--help")
    assert "feedback" in run(*cli, "evaluate", "--help")
    options = ["--model", "contact", "--robot", str(robot), "--episodes", "4", "--json"]
    result = json.loads(run(*cli, "evaluate", "shuttle", "--controller", "feedback", *options))
    assert "feedback" in json.dumps(result)

    folder = tmp_path / "run"
    run(*cli, "train", "shuttle", "--config", str(tmp_path / "shuttle.toml"), "--run", str(folder), "--no-report")
    assert (folder / "best_model.zip").is_file()
    trained = json.loads(run(*cli, "evaluate", "shuttle", "--controller", str(folder), "--episodes", "4", "--json"))
    assert str(folder) in json.dumps(trained)
