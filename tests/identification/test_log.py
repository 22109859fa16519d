"""Logs: what a file must have, what is rejected, and the torques of the model's steps."""

import importlib.util
import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from ballbot_rs import InvalidInputError, Params, SensorLog, record_log
from ballbot_rs.identification.logs.log import COLUMNS
from ballbot_rs.identification.motors import Motors
from ballbot_rs.identification.windows import split

ROWS = 300


def log(**changes):
    rng = np.random.default_rng(0)
    time = 0.01 * np.arange(ROWS)
    fields = {
        "time": time,
        "torques": rng.uniform(-0.1, 0.1, (ROWS, 3)),
        "wheel_angles": np.cumsum(rng.uniform(-0.1, 0.1, (ROWS, 3)), axis=0),
        "gyro": rng.uniform(-1, 1, (ROWS, 3)),
        "accelerations": rng.uniform(-0.1, 0.1, (ROWS, 3)) + np.array([0, 0, 9.81]),
        "attitude": np.tile([0.6, 0.0, 0.0, -0.8], (ROWS, 1)),
        "position": rng.uniform(-1, 1, (ROWS, 3)),
    }
    return SensorLog(**{**fields, **changes})


def changed(name, place, value):
    array = getattr(log(), name).copy()
    array[place] = value
    return {name: array}


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
@pytest.mark.parametrize("without", [{}, {"accelerations": None}, {"attitude": None, "position": None}])
def test_a_file_restores_the_log_exactly(tmp_path, suffix, without):
    written = log(**without)
    written.write(tmp_path / f"log{suffix}")
    read = SensorLog.read(tmp_path / f"log{suffix}")
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))


def test_columns_may_have_any_order_and_additional_columns(tmp_path):
    log().write(tmp_path / "log.csv")
    rows = [line.split(",") for line in (tmp_path / "log.csv").read_text().splitlines()]
    rows = [[*row[::-1], "note"] for row in rows]
    (tmp_path / "log.csv").write_text("\n".join(" , ".join(row) for row in rows) + "\n\n")
    np.testing.assert_array_equal(SensorLog.read(tmp_path / "log.csv").gyro, log().gyro)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": np.zeros((ROWS, 2))}, r"gyro has the shape \(300, 2\), expected \(300, 3\)"),
        ({"torques": np.zeros((5, 3))}, r"torques has the shape \(5, 3\), expected \(300, 3\)"),
        ({"time": np.zeros((ROWS, 1))}, r"time has the shape \(300, 1\), expected \(n,\)"),
        (changed("gyro", (7, 1), np.nan), "gyro_y of row 7 is nan; 1 of 300 rows are not finite: leave them out"),
        (changed("torques", ([4, 9], 2), np.inf), "torque_2 of row 4 is inf; 2 of 300 rows"),
        (changed("time", 5, np.nan), "time of row 5 is nan"),
        (changed("time", 5, 0.04), "time of row 5 is 0.04 s, after 0.04 s: it must increase"),
        ({"time": 10.0 * np.arange(ROWS)}, "median time step is 10 s, the limit is 0.05 s.*give time in seconds"),
        (
            changed("gyro", (3, 2), 90.0),
            r"gyro_z of row 3 is 90 rad/s, the limit is ±35 rad/s: give rates in rad/s, not deg/s",
        ),
        (
            changed("wheel_angles", (8, 0), 20.0),
            "wheel_angle_0 changes by .* to row .*, the limit is 3.142 rad: unwrap",
        ),
        (
            {"accelerations": np.tile([0.0, 0, 1], (ROWS, 1))},
            "mean magnitude of acc_x, acc_y, acc_z is 1 m/s², expected 5 to 20",
        ),
        (
            {"attitude": np.ones((ROWS, 4))},
            r"attitude_w, .*attitude_z of row 0 have the norm 2, expected 1 ± 0\.01",
        ),
        ({"attitude": np.ones((ROWS, 3))}, r"attitude has the shape \(300, 3\), expected \(300, 4\)"),
        (
            {name: getattr(log(), name)[:1] for name in COLUMNS},
            "the log has 1 rows, at least 2 are needed",
        ),
    ],
)
def test_a_bad_log_is_rejected_with_value_and_limit(changes, message):
    with pytest.raises(ValueError, match=message):
        log(**changes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda text: text.replace("gyro_x", "gyrox"),
            "column gyro_x is missing; there are time, .*: did you mean 'gyrox'?",
        ),
        (
            lambda text: text.replace("acc_x", "a"),
            "column acc_x is missing; .*; columns= names columns with other titles",
        ),
        (lambda text: text.replace("gyro_x", "gyro_y"), "two columns have one name"),
        (lambda text: text + "1,2\n", "row 300 has 2 cells, the header has 20"),
        (lambda text: text.replace("\n0.0,", "\nzero,", 1), "time of row 0 is 'zero', not a number"),
        (lambda _: "", "column time is missing"),
    ],
)
def test_a_bad_file_is_rejected_with_its_name(tmp_path, change, message):
    path = tmp_path / "log.csv"
    log().write(path)
    path.write_text(change(path.read_text()))
    with pytest.raises(ValueError, match=f"{path}: {message}"):
        SensorLog.read(path)


def test_a_csv_file_takes_a_few_times_its_size_in_memory(tmp_path):
    log().write(tmp_path / "log.csv")
    header, *lines = (tmp_path / "log.csv").read_text().splitlines()
    rows = [line.partition(",")[2] for line in lines]
    many = (f"{0.01 * row!r},{rows[0]}" for row in range(10_000))
    (tmp_path / "log.csv").write_text("\n".join([header, *many]))
    tracemalloc.start()
    try:
        SensorLog.read(tmp_path / "log.csv")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * (tmp_path / "log.csv").stat().st_size


def test_columns_that_are_ignored_are_not_unpacked(tmp_path):
    log().write(tmp_path / "log.npz")
    with zipfile.ZipFile(tmp_path / "log.npz", "a") as archive:
        archive.writestr("other.npy", b"no array")
    np.testing.assert_array_equal(SensorLog.read(tmp_path / "log.npz").gyro, log().gyro)


@pytest.mark.parametrize("rows", [9 * 10**12, 2**62])
def test_a_header_that_claims_more_data_than_the_file_has_is_rejected(tmp_path, rows):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (rows,)})
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("time.npy", header.getvalue())
    with pytest.raises(
        InvalidInputError, match=rf"log\.npz: the columns have {8 * rows} bytes, the limit is 1073741824"
    ):
        SensorLog.read(tmp_path / "log.npz")


def test_other_files_are_rejected(tmp_path):
    (tmp_path / "log.npz").write_bytes(b"no archive")
    with pytest.raises(ValueError, match="not an npz file"):
        SensorLog.read(tmp_path / "log.npz")
    log().write(tmp_path / "log.npz")
    whole = (tmp_path / "log.npz").read_bytes()
    for broken in (whole[: len(whole) // 2], whole[:100] + b"\0" * 200 + whole[300:]):
        (tmp_path / "log.npz").write_bytes(broken)
        with pytest.raises(ValueError, match=r"log\.npz"):
            SensorLog.read(tmp_path / "log.npz")
    np.savez(tmp_path / "log.npz", time=np.array(["a"]))
    with pytest.raises(ValueError, match="time is of type <U1"):
        SensorLog.read(tmp_path / "log.npz")
    for method in (SensorLog.read, log().write):
        with pytest.raises(ValueError, match=r"must end in \.csv(,| or) \.npz"):
            method(tmp_path / "log.txt")


def test_torques_of_steps_are_the_commands_where_both_are_on_one_grid():
    commands = log()
    torques = Motors(delay=0.006, strength=(0.5, 1.0, 2.0)).torques(commands.time, commands.torques, 0.002, 1000, 5.0)
    expected = np.repeat(commands.torques, 5, axis=0)[: 1000 - 3] * [0.5, 1.0, 2.0]
    np.testing.assert_allclose(torques[3:], expected, atol=1e-12)
    np.testing.assert_allclose(torques[:3], np.tile(expected[0], (3, 1)), atol=1e-12)
    limited = Motors().torques(commands.time, commands.torques, 0.002, 1000, 0.05)
    assert np.abs(limited).max() == 0.05


def test_the_impulse_of_the_commands_is_kept_at_any_times_and_delay():
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.004, 0.016, 200))
    commands = np.zeros((200, 3))
    commands[20:180] = rng.uniform(-1, 1, (160, 3))
    torques = Motors(delay=0.0137).torques(time, commands, 0.0021, 1100, 5.0)
    np.testing.assert_allclose(
        0.0021 * torques.sum(axis=0), (commands[:-1] * np.diff(time)[:, None]).sum(axis=0), atol=1e-12
    )


@pytest.mark.skipif(importlib.util.find_spec("scipy") is None, reason="SciPy is not installed")
def test_a_lag_answers_a_step_as_the_closed_form():
    time = 0.01 * np.arange(100)
    commands = np.where(time[:, None] < 0.5 - 1e-9, 0.0, 1.0) * np.ones(3)
    torques = Motors(lag=0.03).torques(time, commands, 0.002, 450, 5.0)
    after = 0.002 * np.arange(1, 201)
    np.testing.assert_allclose(torques[250:450, 0], 1.0 - np.exp(-after / 0.03), atol=1e-12)


def test_motors_of_a_curve_are_rejected():
    with pytest.raises(
        ValueError, match=r"stall_torque = 0\.5 is not supported by identification, which has delay, lag, strength"
    ):
        Motors.of({"stall_torque": 0.5, "no_load_speed": 50.0})
    with pytest.raises(ValueError, match=r"delay = 0\.2 is out of range: it must be from 0 to 0\.1"):
        Motors.of({"delay": 0.2})


def test_windows_have_no_gaps_and_no_common_rows():
    kept = np.ones(ROWS, dtype=bool)
    kept[100:110] = False
    fields = {name: getattr(log(), name)[kept] for name in COLUMNS}
    gapped = SensorLog(**fields)
    windows = split(gapped, 0.25, 0.002, 0.1)
    assert len(np.unique(windows.rows)) == len(windows.rows)
    times = gapped.time[windows.rows]
    assert times[0] == pytest.approx(0.1)
    for index in range(len(windows)):
        own = times[windows.rows_of(index)]
        assert np.diff(own).max() < 0.011
        assert own[-1] - own[0] == pytest.approx(0.24)
        assert own[0] == pytest.approx(0.002 * windows.starts[index])
    # All but the beginning, the gap, and less than a window before the gap and the end.
    assert len(windows) == 3 + 7


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3.0, 0.002, 0.0), r"window = 3.0 s is out of range: it must be from 0.05 to 2.0 s"),
        (
            (0.5, 0.02, 0.0),
            "sim_dt = 0.02 s is out of range: it must be above 0 and at most the log's median step, 0.01 s",
        ),
        ((0.5, 0.0, 0.0), "sim_dt = 0.0 s is out of range"),
        (
            (1.0, 0.002, 0.0),
            "has 3 windows of 1 s without a gap, at least 4 of 8 rows each are needed: it has 300 rows over 2.99 s",
        ),
        ((0.05, 0.002, 0.0), "has 0 windows of 0.05 s"),
    ],
)
def test_a_log_that_cannot_be_divided_is_rejected(arguments, message):
    with pytest.raises(ValueError, match=message):
        split(log(), *arguments)


def test_a_log_may_have_any_duration():
    assert len(record_log(Params.paper(), seconds=1.999).time) == 201
    with pytest.raises(ValueError, match="control_dt = 0"):
        record_log(Params.paper(), seconds=1.0, control_dt=0.0)
