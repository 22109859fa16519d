"""Fixtures of the test modules. The learner is tiny, so one torch thread is faster than two."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbot_rs import BalanceEnv, Lqr, Params, State
from tests.support.paths import ASSETS
from tests.support.tiny_config import TINY_CONFIG

try:
    import torch
except ModuleNotFoundError:
    pass  # for the modules that test only the core, on machines that PyTorch does not support
else:
    torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def _log_of_learners(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Learners without a log make a folder in the temporary folder, unless this names another folder."""
    os.environ["SB3_LOGDIR"] = str(tmp_path_factory.mktemp("sb3"))


@pytest.fixture(scope="session")
def paper() -> Params:
    return Params.paper()


@pytest.fixture(scope="session")
def assets() -> Path:
    return ASSETS


@pytest.fixture(scope="session")
def balance() -> Callable[[State], np.ndarray]:
    """Actions that keep a robot upright, for environments at the default rate and torque."""
    torque = BalanceEnv().max_wheel_torque
    regulator = Lqr(control_dt=0.01, max_torque=torque)
    return lambda state: (regulator(state) / torque).astype(np.float32)


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
