"""Logs with a column map: names, units, signs, different rates, gaps and clocks."""

import dataclasses
import json

import numpy as np
import pytest

from ballbot_rs import SensorLog, record_log
from ballbot_rs._core import ROBOTS
from ballbot_rs.identification.logs import clocks
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.merge import merged
from ballbot_rs.identification.logs.recording import Series, checked
from validation import clock_offsets

COLUMNS = {
    "torques": ["u0", "u1", "u2"],
    "wheel_angles": ["e0", "e1", "e2"],
    "gyro": ["wx", "wy", "wz"],
    "accelerations": ["ax", "ay", "az"],
}
PLAIN = ColumnMap.of({"columns": {"time": "t", **COLUMNS}})
MAP = """
[columns]
time = "t"
torques = ["u0", "u1", "u2"]
wheel_angles = ["e0", "e1", "e2"]
gyro = ["wx", "wy", "wz"]
accelerations = ["ax", "ay", "az"]
"""


@pytest.fixture(scope="module")
def log():
    return record_log(seconds=6.0, noise=None, sim_dt=0.0005, control_dt=0.005, seed=1)


def rows_of(log, names=tuple(COLUMNS), scale=None):
    """Columns of a log under the names of the map."""
    factors = scale or {}
    return {
        title: getattr(log, name)[:, axis] * np.broadcast_to(factors.get(name, 1.0), 3)[axis]
        for name in names
        for axis, title in enumerate(COLUMNS[name])
    }


def write_csv(path, columns):
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines).replace("nan", "") + "\n")


def written(tmp_path, columns, text=MAP):
    write_csv(tmp_path / "log.csv", columns)
    (tmp_path / "map.toml").write_text(text)
    return tmp_path / "log.csv", tmp_path / "map.toml"


def test_names_units_and_signs_of_a_map(tmp_path, log):
    units = {
        "torques": 1e3,
        "wheel_angles": np.array([1.0, -1.0, 1.0]) * 4096 / (2.0 * np.pi),
        "gyro": np.degrees(1.0),
        "accelerations": -1.0 / 9.80665,
    }
    # Nanoseconds since 1970, of which a double keeps steps of 256.
    stamps = 1_760_000_000_000_000_000 + np.round(log.time * 1e9).astype(np.int64)
    text = f"""ticks_per_turn = 4096
{MAP}
[units]
time = "ns"
torques = "mNm"
wheel_angles = "ticks"
gyro = "deg/s"
accelerations = "g"
[scale]
wheel_angles = [1, -1, 1]
accelerations = -1
"""
    files = written(tmp_path, {"t": stamps, **rows_of(log, scale=units)}, text)
    read = SensorLog.read(*files)
    np.testing.assert_allclose(read.time, log.time, atol=1e-6)
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(read, name), getattr(log, name), rtol=1e-12, atol=1e-12)
    assert read.report.clock_offset is None
    assert read.report.left_out == 0
    assert [one.rate for one in read.report.sources] == pytest.approx([200.0] * 4, rel=1e-4)


@pytest.mark.parametrize("kind", [np.int64, np.uint64])
def test_whole_nanoseconds_are_exact(tmp_path, log, kind):
    """Their difference does not wrap, and keeps the digits that a double of the date lacks."""
    nanoseconds = np.round(log.time * 1e9).astype(kind)
    imu = {"ti": nanoseconds + kind(3)}
    stamps = {"t": nanoseconds + kind(1_760_000_000_000_000_001), "ti": imu["ti"] + kind(1_760_000_000_000_000_001)}
    text = "clock_offset = 0\n" + MAP + '[times]\ngyro = "ti"\naccelerations = "ti"\n[units]\ntime = "ns"\n'
    np.savez(tmp_path / "log.npz", **stamps, **rows_of(log))
    (tmp_path / "map.toml").write_text(text)
    read = SensorLog.read(tmp_path / "log.npz", tmp_path / "map.toml")
    # The first row has no gyroscope yet.
    np.testing.assert_allclose(read.time, log.time[1:], rtol=0.0, atol=1e-12)


def test_times_in_single_precision_are_named(tmp_path, log):
    message = "look like single precision, which has steps of 0.00781 at 1000"
    times = (log.time + 1e5).astype(np.float32)
    np.savez(tmp_path / "log.npz", t=times, **rows_of(log))
    (tmp_path / "map.toml").write_text(MAP)
    with pytest.raises(ValueError, match=message):
        SensorLog.read(tmp_path / "log.npz", tmp_path / "map.toml")
    with pytest.raises(ValueError, match=message):
        SensorLog.read(*written(tmp_path, {"t": times, **rows_of(log)}))
    with pytest.raises(ValueError, match=message):
        SensorLog(times, log.torques, log.wheel_angles, log.gyro)
    repeated = log.time.copy()
    repeated[5] = repeated[4]
    with pytest.raises(ValueError, match=r"it must increase$"):
        SensorLog(repeated, log.torques, log.wheel_angles, log.gyro)


def test_attitude_and_position_are_interpolated_and_may_change_sign(tmp_path, log):
    half = 0.25 * log.time
    attitude = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)
    attitude[::3] *= -1.0
    place = {"px": 1e3 * log.time, "py": -2e3 * log.time, "pz": 0.0 * log.time}
    turned = dict(zip(("qw", "qx", "qy", "qz"), attitude.T, strict=True))
    text = (
        MAP
        + """attitude = ["qw", "qx", "qy", "qz"]
position = ["px", "py", "pz"]
[times]
attitude = "tm"
position = "tm"
[units]
position = "mm"
"""
    )
    read = SensorLog.read(
        *written(tmp_path, {"t": log.time, "tm": log.time + 0.002, **rows_of(log), **turned, **place}, text)
    )
    np.testing.assert_allclose(read.position[:, 0], read.time - 0.002, atol=1e-9)
    angle = 2.0 * np.arctan2(read.attitude[:, 3], read.attitude[:, 0])
    np.testing.assert_allclose(np.cos(angle - 0.5 * (read.time - 0.002)), 1.0, atol=1e-9)
    with pytest.raises(ValueError, match=r"columns.attitude = .*, expected four names of columns"):
        ColumnMap.of({"columns": {"time": "t", **COLUMNS, "attitude": ["a", "b", "c"]}})


def test_an_npz_file_has_columns_of_different_lengths(tmp_path, log):
    half = slice(None, None, 2)
    imu = ("gyro", "accelerations")
    encoders = {name: one[half] for name, one in rows_of(log, ("torques", "wheel_angles")).items()}
    np.savez(tmp_path / "log.npz", t=log.time[half], ti=log.time, **encoders, **rows_of(log, imu))
    (tmp_path / "map.toml").write_text("clock_offset = 0\n" + MAP + '[times]\ngyro = "ti"\naccelerations = "ti"\n')
    read = SensorLog.read(tmp_path / "log.npz", tmp_path / "map.toml")
    np.testing.assert_array_equal(read.time, log.time[half])
    np.testing.assert_allclose(read.gyro, log.gyro[half])
    # The mean of both samples since the previous row.
    np.testing.assert_allclose(read.accelerations[1:], (log.accelerations[1::2] + log.accelerations[2::2])[:, :] / 2)
    np.testing.assert_array_equal(read.torques, log.torques[half])


def test_one_csv_file_has_rows_of_different_rates(tmp_path, log):
    columns = {"t": log.time, **rows_of(log)}
    for name in COLUMNS["torques"] + COLUMNS["wheel_angles"]:
        columns[name] = np.where(np.arange(len(log.time)) % 2 == 0, columns[name], np.nan)
    read = SensorLog.read(*written(tmp_path, columns))
    np.testing.assert_array_equal(read.time, log.time[::2])
    np.testing.assert_array_equal(read.wheel_angles, log.wheel_angles[::2])
    assert [(one.samples, one.missing) for one in read.report.sources] == [(601, 0), (601, 0), (1201, 0), (1201, 0)]


def test_torques_keep_their_impulse_and_irregular_samples_their_line():
    rng = np.random.default_rng(0)
    own = [np.cumsum(rng.uniform(0.003, 0.007, 400)) for _ in range(3)]
    commands = rng.uniform(-1, 1, (400, 3))
    line = np.array([1.0, -2.0, 3.0])
    series = {
        "torques": Series("u", "a", own[0], commands),
        "wheel_angles": Series("e", "a", own[1], own[1][:, None] * line),
        "gyro": Series("w", "a", own[2], 1.0 + own[2][:, None] * line),
    }
    fields, _ = merged(series, PLAIN)
    rows = fields["time"]
    np.testing.assert_allclose(fields["wheel_angles"], rows[:, None] * line, atol=1e-12)
    np.testing.assert_allclose(fields["gyro"], 1.0 + rows[:, None] * line, atol=1e-12)
    # The integral of the held commands, from samples at 10 us.
    fine = np.arange(rows[0], rows[-1], 1e-5)
    held = commands[np.searchsorted(own[0], fine, side="right") - 1]
    impulse = (fields["torques"][:-1] * np.diff(rows)[:, None]).sum(axis=0)
    np.testing.assert_allclose(impulse, 1e-5 * held.sum(axis=0), atol=1e-4)


def test_gaps_are_counted_and_their_rows_left_out(tmp_path, log):
    columns = {"t": log.time, **rows_of(log)}
    for first, last in ((200, 240), (700, 710)):
        for name in COLUMNS["gyro"]:
            columns[name][first:last] = np.nan
    columns["e1"][500] = np.nan
    read = SensorLog.read(*written(tmp_path, columns))
    by_name = {one.quantity: one for one in read.report.sources}
    assert (by_name["gyro"].gaps, by_name["gyro"].missing) == (2, 0)
    assert by_name["gyro"].longest_gap == pytest.approx(41 * 0.005)
    assert (by_name["wheel_angles"].gaps, by_name["wheel_angles"].missing) == (0, 1)
    assert read.report.left_out == 50
    assert np.diff(read.time).max() == pytest.approx(41 * 0.005)
    text = "\n".join(read.report.lines())
    assert "gyro: wx, wy, wz: 1151 samples at 200 Hz, 2 gaps, longest 0.205 s" in text
    assert "wheel_angles: e0, e1, e2: 1200 samples at 200 Hz, no gaps, 1 incomplete samples left out" in text
    assert "1150 rows, 50 left out in gaps" in text


@pytest.mark.parametrize("offset", [-0.0373, 0.0, 0.0124])
def test_the_offset_of_separate_clocks_is_estimated_and_corrected(tmp_path, log, offset):
    columns = {"t": log.time, "ti": log.time + offset, **rows_of(log)}
    files = written(tmp_path, columns, MAP + '[times]\ngyro = "ti"\naccelerations = "ti"\n')
    read = SensorLog.read(*files)
    # A tenth of a sample, and half of the model's step, by which its rates are older than its angles.
    assert read.report.clock_offset == pytest.approx(offset, abs=0.001)
    assert read.report.clock_offset_error < 0.001
    assert read.report.corrected == (offset != 0.0)
    if offset:
        text = "later" if offset > 0.0 else "earlier"
        assert f"ms {text} than stamps of the encoders (±" in read.report.lines()[-1]
    files[1].write_text(f"clock_offset = {offset}\n" + files[1].read_text())
    read = SensorLog.read(*files)
    assert (read.report.clock_offset, read.report.clock_offset_error) == (offset, None)
    # Times count from the first stamp of all.
    at = read.time + min(offset, 0.0)
    expected = [np.interp(at, log.time, one) for one in log.gyro.T]
    np.testing.assert_allclose(read.gyro, np.transpose(expected), atol=1e-9)


def test_an_offset_survives_noise_wrong_signs_and_a_gap():
    log = record_log(seconds=10.0, control_dt=0.005, sim_dt=0.0005, seed=2)
    kept = (log.time < 3.0) | (log.time > 3.3)
    gyro = Series("w", "a", log.time[kept] + 0.02, -np.degrees(log.gyro[kept])[:, [1, 0, 2]])
    found = clocks.estimated(gyro, Series("e", "b", log.time, log.wheel_angles))
    assert found.value == pytest.approx(0.02, abs=max(3.0 * found.error, 0.001))
    assert found.error < 0.002


def test_offsets_of_noisy_logs_are_within_a_tenth_of_a_sample():
    found = clock_offsets.errors("paper", 0.01, logs=3)
    assert np.abs(found.offsets).max() < 0.001
    assert np.abs(found.relative).max() < 3.0


@pytest.mark.slow("64 logs of half a minute")
def test_standard_errors_hold_in_random_logs():
    every = [clock_offsets.errors(robot, dt, logs=8, seed=2) for robot in ROBOTS for dt in (0.005, 0.01)]
    for name in ("relative", "relative_drifts"):
        errors = np.concatenate([getattr(one, name) for one in every])
        assert 0.8 < np.sqrt(np.mean(errors**2)) < 1.2
        assert np.abs(errors).max() < 4.0


@pytest.mark.parametrize("drift", [0.0, 150e-6, -80e-6])
def test_a_drift_is_estimated_and_removed(drift):
    log = record_log(seconds=40.0, sim_dt=0.001, control_dt=0.01, seed=3)
    imu = log.time + 0.02 + drift * log.time
    series = {
        "torques": Series("u", "a", log.time, log.torques),
        "wheel_angles": Series("e", "a", log.time, log.wheel_angles),
        "gyro": Series("w", "b", imu, log.gyro),
    }
    fields, report = merged(series, PLAIN)
    assert report.clock_drift == pytest.approx(drift, abs=max(4.0 * report.clock_drift_error, 5e-6))
    assert report.clock_drift_error < 20e-6
    assert report.drift_corrected == (drift != 0.0)
    assert f"; drift {1e6 * report.clock_drift:.3g} ±" in report.lines()[-1]
    if drift:
        constant, _ = merged(series, dataclasses.replace(PLAIN, clock_offset=0.02 + 20.0 * drift))
        rest = [
            np.std(one["gyro"] - np.transpose([np.interp(one["time"], log.time, gyro) for gyro in log.gyro.T]))
            for one in (fields, constant)
        ]
        assert rest[0] < 0.7 * rest[1]
    json.dumps(report.to_dict())


def test_a_robot_at_rest_does_not_determine_an_offset():
    log = record_log(seconds=5.0, excitation=0.0, seed=2)
    series = [Series(name, name, log.time, getattr(log, name)) for name in ("gyro", "wheel_angles", "torques")]
    assert clocks.estimated(*series[:2]) is None
    short = [Series(one.source, one.clock, one.time[:60], one.values[:60]) for one in series]
    assert clocks.estimated(*short[:2]) is None
    _, report = merged({"gyro": series[0], "wheel_angles": series[1], "torques": series[2]}, PLAIN)
    assert report.lines()[-1].startswith("clock offset of the IMU: not determined by the motion")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('time = "t"', "", "columns lacks time, and times has no torques"),
        ('time = "t"', 'time = "tt"', "column tt is missing; there are t, .*: did you mean 't'?"),
        ('"wy"', '"gyro"', "column gyro is missing"),
        ('gyro = ["wx", "wy", "wz"]', "", "columns lacks gyro"),
        ('gyro = ["wx", "wy", "wz"]', 'gyro = ["wx", "wy"]', r"columns.gyro = \['wx', 'wy'\], expected three names"),
        ('"wy"', '"wx"', "columns names 'wx' twice"),
        ('"wy"', '"t"', "columns names 't' twice"),
        ("[columns]", '[units]\ngyro = ["deg/s"]\n[columns]', r"units.gyro = \['deg/s'\], expected one of"),
        ("[columns]", "[colums]", "unknown key 'colums': .*did you mean 'columns'?"),
        ("gyro =", "giro =", "unknown quantity in columns 'giro': .*did you mean 'gyro'?"),
        ("[columns]", 'clock_offset = "guess"\n[columns]', "clock_offset = 'guess', expected 'estimate' or a number"),
        ("[columns]", "clock_offset = 1e9\n[columns]", "clock_offset = 1000000000.0, expected"),
        ("[columns]", "ticks_per_turn = 9\n[columns]", "ticks_per_turn needs units.wheel_angles = 'ticks'"),
        ("[columns]", '[units]\ngyro = "rpm"\n[columns]', "units.gyro = 'rpm', expected one of rad/s, deg/s"),
        ("[columns]", '[units]\nwheel_angles = "ticks"\n[columns]', "'ticks' needs ticks_per_turn"),
        ("[columns]", "[scale]\ngyro = [1, 0, 1]\n[columns]", r"scale.gyro = \[1, 0, 1\], expected a finite number"),
        ("[columns]", "[scale]\ngyro = true\n[columns]", "scale.gyro = True, expected"),
        ("[columns]", "times = 3\n[columns]", "times = 3, expected a table"),
        ("[columns]", "[times]\ngyro = 3\n[columns]", "times.gyro = 3, expected the name of a column"),
        ("[columns]", "[columns", "map.toml: "),
    ],
)
def test_a_bad_map_is_rejected_with_its_key(tmp_path, log, old, new, message):
    files = written(tmp_path, {"t": log.time, **rows_of(log)}, MAP.replace(old, new))
    with pytest.raises(ValueError, match=message):
        SensorLog.read(*files)


def test_a_map_may_be_a_dictionary(tmp_path, log):
    table = {"columns": {"time": "t", **COLUMNS}, "scale": {"gyro": (1.0, -1.0, 1.0)}}
    text = MAP + "[scale]\ngyro = [1.0, -1.0, 1.0]\n"
    path, map_path = written(tmp_path, {"t": log.time, **rows_of(log)}, text)
    found, expected = SensorLog.read(path, table), SensorLog.read(path, map_path)
    for name in ("time", *COLUMNS):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    for key in ("unit", 5):
        with pytest.raises(ValueError, match=f"unknown key {key!r}"):
            SensorLog.read(path, {**table, key: {}})


def test_a_map_needs_a_regular_file(tmp_path, log):
    log.write(tmp_path / "log.csv")
    with pytest.raises(OSError, match=r"map\.toml"):
        SensorLog.read(tmp_path / "log.csv", tmp_path / "map.toml")
    with pytest.raises(ValueError, match="is not a regular file"):
        SensorLog.read(tmp_path / "log.csv", "/dev/zero")


def test_times_that_run_backwards_and_too_few_samples_are_rejected(tmp_path, log):
    columns = {"t": log.time.copy(), **rows_of(log)}
    columns["t"][600:] -= 1.0
    message = r"log\.csv: u0, u1, u2: time fails to increase 1 times, first from row 599 to row 600, by -0\.995 s"
    with pytest.raises(ValueError, match=message):
        SensorLog.read(*written(tmp_path, columns))
    for title in COLUMNS["gyro"]:
        columns[title] = np.full(len(log.time), np.nan)
    columns["t"] = log.time
    with pytest.raises(ValueError, match="wx, wy, wz has 0 complete samples, at least 16 are needed"):
        SensorLog.read(*written(tmp_path, columns))
    with pytest.raises(ValueError, match=r"log\.csv: column t is missing"):
        SensorLog.read(*written(tmp_path, {"a": []}))


def test_quantities_without_a_common_time_are_rejected():
    time, values = 0.01 * np.arange(50), np.zeros((50, 3))
    series = {
        "torques": checked("u", "a", time, values),
        "wheel_angles": checked("e", "a", time, values),
        "gyro": checked("w", "a", time + 9.0, values),
    }
    with pytest.raises(ValueError, match=r"no common time: torques 0.000 to 0.490 s, .*, gyro 9.000 to 9.490 s"):
        merged(series, PLAIN)


def test_a_default_map_has_si_units():
    assert all((PLAIN.scale(name) == 1.0).all() for name in COLUMNS)
    assert (PLAIN.time_scale, PLAIN.clock_offset) == (1.0, None)
