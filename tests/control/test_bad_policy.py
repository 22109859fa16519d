"""Files that are not policies for the environment are rejected, and the message states why."""

import copy
import pickle
import zipfile

import numpy as np
import pytest

from ballbot_rs.analysis.episodes import evaluate
from ballbot_rs.control.onnx_policy import OnnxPolicy
from tests.support.paths import ASSETS
from tests.support.policies import edited_policy

#: (change of the data, what the message must have)
POLICY_EDITS = {
    "environment": (
        lambda d: d["ballbot_metadata"].update(env_id="ballbot/Walk-v0"),
        "another environment: env_id is 'ballbot/Walk-v0', expected one of ballbot/Balance-v0",
    ),
    "observation": (
        lambda d: d["ballbot_metadata"].update(observation=["tilt"]),
        r"another environment: observation is \['tilt'\]",
    ),
    "algorithm": (
        lambda d: d["ballbot_metadata"].update(algorithm="DQN"),
        "unknown algorithm 'DQN', expected one of PPO, A2C, SAC, TD3, DDPG",
    ),
    "wrong algorithm": (lambda d: d["ballbot_metadata"].update(algorithm="SAC"), "holds no SAC policy"),
    "no algorithm": (lambda d: d["ballbot_metadata"].pop("algorithm") and None, "does not name its algorithm"),
    "no options": (lambda d: d["ballbot_metadata"].pop("env_options") and None, "does not name its env_options"),
    "options": (lambda d: d["ballbot_metadata"].update(env_options=[1]), "does not name its env_options"),
    "metadata": (lambda d: d.update(ballbot_metadata=[1]), "does not name the environment"),
    "no metadata": (lambda d: d.pop("ballbot_metadata") and None, "does not name the environment"),
    "data": (lambda _: [1], "is not a policy file"),
}


@pytest.mark.parametrize("name", POLICY_EDITS)
def test_a_policy_for_something_else_is_rejected(name, tiny_run, tmp_path):
    edit, message = POLICY_EDITS[name]
    path = edited_policy(tiny_run / "best_model.zip", tmp_path / "policy.zip", edit)
    with pytest.raises(ValueError, match=message) as caught:
        evaluate(str(path), episodes=1)
    assert str(path) in str(caught.value)


def test_files_that_are_not_policies_are_rejected(tiny_run, tmp_path):
    whole = (tiny_run / "best_model.zip").read_bytes()
    contents = {"empty": b"", "text": b"hello", "cut": whole[: len(whole) // 2], "garbled": whole[:100] + whole[150:]}
    for name, content in contents.items():
        (tmp_path / f"{name}.zip").write_bytes(content)
        with pytest.raises(ValueError, match=rf"{name}\.zip is not a policy file"):
            evaluate(str(tmp_path / f"{name}.zip"), episodes=1)
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as other:
        other.writestr("a.txt", "no policy")
    with pytest.raises(ValueError, match=r"other\.zip is not a policy file .*: it has no 'data'"):
        evaluate(str(tmp_path / "other.zip"), episodes=1)
    with zipfile.ZipFile(tmp_path / "hollow.zip", "w") as hollow, zipfile.ZipFile(tiny_run / "best_model.zip") as old:
        hollow.writestr("data", old.read("data"))
    with pytest.raises(ValueError, match=r"hollow\.zip is not a policy file .*: it has no 'policy\.pth'"):
        evaluate(str(tmp_path / "hollow.zip"), episodes=1)
    for missing in (tmp_path / "nowhere.zip", tmp_path):
        with pytest.raises(FileNotFoundError, match="no policy at"):
            evaluate(str(missing), episodes=1)


def test_a_copy_of_a_policy_reads_its_file():
    policy = OnnxPolicy(ASSETS / "policies" / "balance.onnx")
    observation = np.linspace(-1.0, 1.0, 16)
    for copied in (pickle.loads(pickle.dumps(policy)), copy.deepcopy(policy)):
        np.testing.assert_array_equal(copied.act(observation), policy.act(observation))
        assert copied.task == "balance"


def test_a_python_file_without_a_controller_name_is_rejected(tmp_path):
    (tmp_path / "mine.py").write_text("def law(state): return [0.0, 0.0, 0.0]\n")
    for name in ("mine.py", "mine.py:"):
        with pytest.raises(ValueError, match=r"a law in Python is named by FILE.py:NAME"):
            evaluate(str(tmp_path / name), episodes=1)
