"""`ballbot list`."""

import pytest

from ballbot_rs import terrain_kinds
from ballbot_rs._core import MODELS, ROBOTS
from ballbot_rs.control.resolve import NAMES, find
from ballbot_rs.envs.registration import known_tasks
from tests.support.in_process import parse_json, run


def test_list_names_the_values_of_other_arguments(capsys):
    pytest.importorskip("onnxruntime")
    code, out, err = run(capsys, "list", "--json")
    assert (code, err) == (0, "")
    found = parse_json(out)
    assert list(found["tasks"]) == list(known_tasks())
    assert list(found["controllers"]) == list(NAMES)
    assert list(found["robots"]) == ROBOTS
    assert list(found["models"]) == MODELS
    assert list(found["terrains"]) == list(terrain_kinds())
    for path in found["policies"]:
        assert find(path).policy is not None
    code, out, _ = run(capsys, "list", "terrains")
    assert out.splitlines()[0] == "  plane    slope 0.1 rad, direction 0 rad"
    assert [line.split()[0] for line in out.splitlines() if line[2] != " "] == list(found["terrains"])
