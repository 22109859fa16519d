"""`ballbot simulate`: the motion of `bb.simulate`, as a file."""

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.in_process import parse_json, run

#: A simulation as options of the command and as arguments.
OPTIONS = (
    *("--controller", "lqi", "--robot", "kugle", "--seconds", 1, "--tilt", 0.02, -0.01, "--yaw", 0.3),
    *("--push", 0.5, 0, 0, "--push-at", 0.2, "--push", "0,0.3,0", "--push-at", 0.4),
    *("--position", 0.1, 0.2, "--reference", "position=[0.3,0]"),
    *("--set", "actuators.delay=0.01", "--events", "mild", "--seed", 3),
)
ARGUMENTS = {
    "robot": "kugle",
    "seconds": 1.0,
    "tilt": (0.02, -0.01),
    "yaw": 0.3,
    "pushes": [bb.Push((0.5, 0.0, 0.0), 0.2), bb.Push((0.0, 0.3, 0.0), 0.4)],
    "position": (0.1, 0.2),
    "reference": {"position": (0.3, 0.0)},
    "actuators": {"delay": 0.01},
    "events": "mild",
    "seed": 3,
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_writes_what_simulate_returns(here, capsys):
    expected = bb.simulate("lqi", **ARGUMENTS).columns()
    assert run(capsys, "simulate", *OPTIONS, "-o", "a.npz")[0] == 0
    with np.load("a.npz") as found:
        assert list(found) == list(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)
    code, out, err = run(capsys, "simulate", *OPTIONS)
    assert code == 0, err
    assert out.endswith("wrote lqi.csv\n")
    table = np.genfromtxt(here / "lqi.csv", delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(table["wheel_torque_0_N_m"], expected["wheel_torque_0_N_m"])


def test_parquet_and_mcap_have_the_same_columns(here, capsys):
    pytest.importorskip("mcap", reason="needs 'ballbot-rs[mcap]'")
    assert run(capsys, "simulate", "--seconds", 0.2, "--push-at", 0.1, "-o", "a.mcap")[0] == 0
    assert (here / "a.mcap").stat().st_size > 1000
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs 'ballbot-rs[parquet]'")
    assert run(capsys, "simulate", *OPTIONS, "-o", "a.parquet")[0] == 0
    table = parquet.read_table("a.parquet")
    for name, values in bb.simulate("lqi", **ARGUMENTS).columns().items():
        np.testing.assert_array_equal(table[name].to_numpy(), values, err_msg=name)
    assert table.schema.metadata[b"controller"] == b"lqi"
    assert bb.Params.from_toml(table.schema.metadata[b"params"].decode()).body_mass > 0.0


def test_json_has_the_metrics(here, capsys):
    code, out, _ = run(capsys, "simulate", "--seconds", 0.5, "--json", "-o", "a.csv")
    assert code == 0
    report = parse_json(out)
    assert (report["file"], report["rows"], report["fell_at"]) == ("a.csv", 51, None)
    assert report["metrics"]["tilt_max"] == pytest.approx(np.hypot(0.08, 0.05), abs=0.01)
    assert (here / "a.csv").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "a.xls"), "a.xls: the name of the file must end in .csv, .npz, .mcap, .parquet"),
        (("--reference", "color=3"), "a setpoint has no part 'color'"),
        (("--reference", "position"), "--reference position: expected NAME=VALUE"),
        (("--controller", "lqrr"), "did you mean 'lqr'?"),
        (("--push", "0.1,0,0", "--push", "0,0.1,0"), "2 --push and 0 --push-at: name a time for each push"),
    ],
)
def test_wrong_options_are_named_and_nothing_is_written(options, message, here, capsys):
    code, _, err = run(capsys, "simulate", *options)
    assert code == 1
    assert message in err
    assert not list(here.iterdir())
