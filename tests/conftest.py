"""What the test modules share. The learner is tiny, so one torch thread is faster than two."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbot_rs import Lqr, Params, State

try:
    import torch
except ModuleNotFoundError:
    # A core-only installation has neither torch nor Stable-Baselines3: leave out what needs them.
    collect_ignore = [
        "test_bad_policy.py",
        "test_cli.py",
        "test_evaluation.py",
        "test_export.py",
        "test_front_ends.py",
        "test_plotting.py",
        "test_readme.py",
        "test_report.py",
        "test_reset.py",
        "test_save.py",
        "test_sb3_vec_env.py",
        "test_sb3_learning.py",
        "test_training.py",
    ]
else:
    torch.set_num_threads(1)

ROOT = Path(__file__).parent.parent

#: A configuration that trains for a second: every part of a run, at the smallest size.
TINY_CONFIG = """\
env_id = "ballbot/Balance-v0"
algorithm = "PPO"
total_timesteps = 768
num_envs = 8
num_threads = 1

[env]
model = "spatial"
max_episode_steps = 60

[evaluation]
every_timesteps = 256
episodes = 4

[algorithm_arguments]
n_steps = 32
batch_size = 64
n_epochs = 1
learning_rate = 1e-3

[schedule]
learning_rate = "linear"

[policy]
net_arch = [8]
"""


@pytest.fixture(scope="session")
def paper() -> Params:
    return Params.paper()


@pytest.fixture(scope="session")
def assets() -> Path:
    return ROOT / "assets"


@pytest.fixture(scope="session")
def balance() -> Callable[[State], np.ndarray]:
    """Actions that keep a robot upright, for environments at the default rate and torque."""
    regulator = Lqr(control_dt=0.01)
    return lambda state: np.clip(regulator(state), -1.0, 1.0).astype(np.float32)


@pytest.fixture
def tiny_config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY_CONFIG, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished training run. Tests must not write into it: copy it first."""
    from ballbot_rs.training import config, train

    folder = tmp_path_factory.mktemp("tiny") / "run"
    train.train(config.parse(TINY_CONFIG, "tiny"), TINY_CONFIG, folder, seed=5, progress_bar=False)
    return folder
