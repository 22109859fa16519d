"""The settings of a training on Ray, without Ray."""

import socket
import subprocess
import sys

import pytest

from ballbot_rs.cli import main
from ballbot_rs.training import config as config_module
from ballbot_rs.training.on_ray import settings
from ballbot_rs.training.on_ray.settings import Ray
from tests.support.paths import ROOT


def shipped(task, **values):
    text = config_module.with_values(config_module.default_text(task), values)
    return config_module.parse(text, task)


def test_arguments_have_the_names_of_rllib():
    found = settings.arguments(shipped("balance", **{"algorithm_arguments.ent_coef": 0.01}))
    assert found == {
        "lr": 3e-3,
        "gamma": pytest.approx(0.98003, abs=1e-5),
        "lambda_": 0.95,
        "clip_param": 0.2,
        "num_epochs": 5,
        "minibatch_size": 1024,
        "entropy_coeff": 0.01,
        "vf_loss_coeff": 0.5,
        "grad_clip": 0.5,
    }
    assert settings.steps_each(shipped("balance")) == 32


def test_defaults_match_stable_baselines3():
    stable_baselines3 = pytest.importorskip("stable_baselines3")
    import inspect

    theirs = inspect.signature(stable_baselines3.PPO.__init__).parameters
    assert {name: default for name, (_, default) in settings.ARGUMENTS.items()} == {
        name: theirs[name].default for name in settings.ARGUMENTS
    }
    assert theirs["n_steps"].default == settings.DEFAULT_STEPS


def test_a_decaying_learning_rate_resumes_at_its_value():
    config = shipped("path")
    assert settings.arguments(config)["lr"] == [[0, 3e-5], [204_800, 0.0]]
    assert settings.arguments(config, 153_600)["lr"] == [[0, pytest.approx(0.75e-5)], [51_200, 0.0]]


@pytest.mark.parametrize("task", ["balance", "velocity", "goal", "path", "push", "terrain", "openballbot"])
def test_every_configuration_of_the_package_fits(task):
    config = shipped(task)
    assert settings.arguments(config)["lr"]
    assert Ray(4).robots_each(config) == config.num_envs // 4


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"algorithm": "SAC"}, "algorithm = SAC: only PPO is available on Ray"),
        ({"algorithm_arguments.target_kl": 0.1}, "algorithm_arguments.target_kl = 0.1: not supported on Ray"),
        ({"algorithm_arguments.use_sde": True}, "algorithm_arguments.use_sde = True: not supported on Ray"),
        ({"algorithm_arguments.clip_range_vf": 0.2}, "algorithm_arguments.clip_range_vf = 0.2: not supported on Ray"),
        ({"algorithm_arguments.normalize_advantage": False}, "normalize_advantage = False: PPO of RLlib always"),
        (
            {"algorithm_arguments.clip_range": 0.2, "schedule.clip_range": "linear"},
            "schedule.clip_range = 'linear': on Ray only learning_rate has a schedule",
        ),
    ],
)
def test_settings_that_rllib_does_not_have_are_rejected_by_name(values, message):
    with pytest.raises(ValueError, match=message):
        settings.arguments(shipped("balance", **values))


def test_robots_are_divided_evenly_or_rejected():
    config = shipped("balance")
    assert Ray(2).robots_each(config) == 32
    with pytest.raises(ValueError, match="num_envs = 64 robots are not a multiple of 3 workers"):
        Ray(3).robots_each(config)
    with pytest.raises(ValueError, match="num_envs = 64 robots are not a multiple of 256 workers"):
        Ray(256).robots_each(config)


@pytest.mark.parametrize("workers", [0, -1, 1025, True, 1.5])
def test_a_number_of_workers_out_of_range_is_rejected(workers):
    with pytest.raises(ValueError, match=r"workers = .* is out of range: it must be from 1 to 1024"):
        Ray(workers)


@pytest.mark.parametrize(
    "address", ["", "here", "host:", ":1", "host:0", "host:65536", "ray://host:1", "host:x", "auto"]
)
def test_invalid_addresses_are_rejected(address):
    with pytest.raises(ValueError, match=r"is not an address: expected HOST:PORT with a port from 1 to 65535"):
        Ray(1, address)


def test_an_address_where_nothing_listens_is_rejected_at_once():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(ConnectionError, match=f"--ray-address {address}: no Ray cluster answers there: "):
            Ray(1, address).reach()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--workers", "2"], "--workers 2 requires --on ray"),
        (["--ray-address", "here:1"], "--ray-address here:1 requires --on ray"),
        (["--on", "ray", "--ray-address", "here"], "--ray-address here is not an address"),
    ],
)
def test_the_command_rejects_options_that_do_not_apply(given, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["train", "balance", *given]) == 1
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow("a process")
def test_without_ray_the_message_names_what_to_install():
    code = """
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "ray":
            raise ModuleNotFoundError(f"No module named {name!r}", name="ray")
sys.meta_path.insert(0, Hidden())
sys.stderr = sys.stdout
from ballbot_rs.cli import main
print(main(["train", "balance", "--on", "ray"]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=100, check=True
    )
    assert "training on Ray needs ray: install it with `pip install -e '.[rllib]'`" in done.stdout
    assert done.stdout.endswith("1\n")
