"""Logs from MCAP files: ROS 2 messages in CDR, our own JSON, and broken files."""

import io
import json
import struct

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs import SensorLog, record_log
from ballbot_rs.identification.logs import mcap_topics

mcap_writer = pytest.importorskip("mcap.writer")
mcap_ros2 = pytest.importorskip("mcap_ros2.writer")

SEPARATOR = "\n" + 80 * "=" + "\n"
HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
IMU = SEPARATOR.join(
    [
        "std_msgs/Header header\ngeometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration",
        HEADER,
        VECTOR,
    ]
)
JOINTS = SEPARATOR.join(
    ["std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort", HEADER]
)
ODOMETRY = SEPARATOR.join(
    [
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist",
        HEADER,
        "MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance",
        "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
        VECTOR,
    ]
)
#: ns since 1970.
BEGIN = 1_760_000_000_123_456_789
NAMES = ["wheel_2", "wheel_0", "wheel_1"]


@pytest.fixture(scope="module")
def log():
    return record_log(seconds=4.0, noise=None, sim_dt=0.0005, control_dt=0.005, seed=1)


def stamp_of(nanoseconds):
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def imu_of(log, row, stamp):
    vectors = {"angular_velocity": log.gyro, "linear_acceleration": log.accelerations}
    return {
        "header": {"stamp": stamp_of(stamp), "frame_id": "body"},
        "angular_velocity_covariance": [0.0] * 9,
        **{name: dict(zip("xyz", values[row].tolist(), strict=True)) for name, values in vectors.items()},
    }


def joints_of(log, row, stamp):
    order = [2, 0, 1]
    return {
        "header": {"stamp": stamp_of(stamp), "frame_id": ""},
        "name": NAMES,
        "position": log.wheel_angles[row, order].tolist(),
        "velocity": [],
        "effort": log.torques[row, order].tolist(),
    }


def odometry_of(log, row, stamp):
    zero = dict.fromkeys("xyz", 0.0)
    angular = dict(zip("xyz", log.gyro[row].tolist(), strict=True))
    return {
        "header": {"stamp": stamp_of(stamp), "frame_id": "odom"},
        "child_frame_id": "body",
        "pose": {"pose": {"position": zero, "orientation": {**zero, "w": 1.0}}, "covariance": [0.0] * 36},
        "twist": {"twist": {"linear": zero, "angular": angular}, "covariance": [0.0] * 36},
    }


def recorded(log, offset=0.0, compression="zstd", imus=("/imu",), joints=joints_of):
    """A file as a robot records it: an IMU at each row with a separate clock, joint states at every second."""
    packed = io.BytesIO()
    kind = mcap_writer.CompressionType[compression.upper()]
    writer = mcap_ros2.Writer(packed, compression=kind, chunk_size=1 << 16)
    imu = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
    joint = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
    odometry = writer.register_msgdef("nav_msgs/msg/Odometry", ODOMETRY)
    for row, time in enumerate(log.time):
        stamp = BEGIN + round(time * 1e9)
        for topic in imus:
            message = imu_of(log, row, stamp + round(offset * 1e9))
            writer.write_message(topic, imu, message, log_time=stamp + 10**6)
        if row % 2 == 0:
            writer.write_message("/joint_states", joint, joints(log, row, stamp), log_time=stamp + 10**6)
            writer.write_message("/odom", odometry, odometry_of(log, row, stamp), log_time=stamp + 10**6)
    writer.finish()
    return packed.getvalue()


def read(tmp_path, contents, text=None):
    (tmp_path / "log.mcap").write_bytes(contents)
    if text is None:
        return SensorLog.read(tmp_path / "log.mcap")
    (tmp_path / "map.toml").write_text(text)
    return SensorLog.read(tmp_path / "log.mcap", tmp_path / "map.toml")


@pytest.mark.parametrize("compression", ["none", "zstd", "lz4"])
def test_ros_messages_are_a_log(tmp_path, log, compression):
    found = read(tmp_path, recorded(log, offset=0.02, compression=compression))
    assert found.report.clock_offset == pytest.approx(0.02, abs=0.001)
    # Rows are joint states that have both neighbors of the IMU's messages.
    places = np.searchsorted(log.time, found.time - 1e-6)
    np.testing.assert_allclose(found.time, log.time[places], atol=1e-9)
    np.testing.assert_allclose(found.wheel_angles, log.wheel_angles[places], atol=1e-12)
    np.testing.assert_allclose(found.torques, log.torques[places], atol=1e-12)
    assert np.abs(found.gyro - log.gyro[places]).max() < 0.1
    assert [one.name for one in found.report.sources] == [
        "/joint_states position.wheel_0, position.wheel_1, position.wheel_2",
        "/joint_states effort.wheel_0, effort.wheel_1, effort.wheel_2",
        "/imu angular_velocity.x, angular_velocity.y, angular_velocity.z",
        "/imu linear_acceleration.x, linear_acceleration.y, linear_acceleration.z",
    ]


MAP = """
clock_offset = 0
[columns]
torques = ["/joint_states.effort.wheel_0", "/joint_states.effort.wheel_1", "/joint_states.effort.wheel_2"]
wheel_angles = ["/joint_states.position.wheel_0", "/joint_states.position.wheel_1", "/joint_states.position.wheel_2"]
gyro = ["/imu.angular_velocity.x", "/imu.angular_velocity.y", "/imu.angular_velocity.z"]
[scale]
gyro = [1, 1, -1]
"""


def test_a_map_names_topics_and_numbers(tmp_path, log):
    contents = recorded(log, imus=("/imu", "/imu/raw"))
    found = read(tmp_path, contents, MAP.replace('"/imu.', '"/imu/raw.'))
    assert found.accelerations is None
    np.testing.assert_allclose(found.gyro, log.gyro[::2] * [1, 1, -1], atol=1e-12)
    with pytest.raises(
        ValueError, match=r"2 topics have messages sensor_msgs/msg/Imu; topics: /imu .*, /imu/raw .*map"
    ):
        read(tmp_path, contents)


def test_a_map_takes_rates_from_odometry(tmp_path, log):
    text = MAP.replace("/imu.angular_velocity.", "/odom.twist.twist.angular.").replace("[1, 1, -1]", "1")
    found = read(tmp_path, recorded(log), text)
    np.testing.assert_allclose(found.gyro, log.gyro[::2], atol=1e-12)
    assert found.report.sources[2].name.startswith("/odom twist.twist.angular.x, ")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "/imu.ang",
            "/imus.ang",
            r"column /imus.angular_velocity.x: no topic name begins it; there are /imu, /joint_states",
        ),
        ("velocity.y", "velocity.w", r"messages of /imu \(sensor_msgs/msg/Imu\) have no number angular_velocity.w"),
        ('"/joint_states.effort.wheel_1"', '"/imu.linear_acceleration.x"', "torques has numbers of several topics"),
        ("[columns]", '[columns]\ntime = "/imu.t"', "time column /imu.t: messages have the time of their header"),
    ],
)
def test_a_map_that_does_not_fit_is_rejected(tmp_path, log, old, new, message):
    with pytest.raises(ValueError, match=message):
        read(tmp_path, recorded(log), MAP.replace(old, new))


def test_what_a_trajectory_writes_is_a_log(tmp_path):
    moved = bb.simulate("lqr", seconds=1.0, tilt=(0.05, 0.0))
    moved.to_mcap(tmp_path / "own.mcap")
    found = SensorLog.read(tmp_path / "own.mcap")
    rows = len(found.time)
    np.testing.assert_allclose(found.time, moved.times[:rows], atol=1e-9)
    np.testing.assert_allclose(found.gyro, moved.of_states("body_angular_velocity")[:rows])
    np.testing.assert_allclose(found.wheel_angles, moved.of_states("wheel_angles")[:rows])
    np.testing.assert_allclose(found.torques[:-1], moved.torques[: rows - 1])
    np.testing.assert_allclose(found.position, moved.of_states("ball_position")[:rows])
    np.testing.assert_allclose(found.attitude, moved.of_states("body_quaternion")[:rows], atol=1e-12)
    assert not found.report.separate_clocks


def test_files_that_lack_something_name_it(tmp_path, log):
    contents = recorded(log, imus=())
    with pytest.raises(ValueError, match=r"no topic has messages sensor_msgs/msg/Imu; topics: /joint_states \(sensor_"):
        read(tmp_path, contents)
    more = lambda *at: {**joints_of(*at), "name": [*NAMES, "arm"], "position": [0.0] * 4, "effort": [0.0] * 4}  # noqa: E731
    with pytest.raises(ValueError, match=r"/joint_states has positions of 4 joints, arm, wheel_0, .*expected three"):
        read(tmp_path, recorded(log, joints=more))
    without = lambda *at: {**joints_of(*at), "effort": []}  # noqa: E731
    with pytest.raises(ValueError, match="/joint_states has no effort; select the torques with a column map"):
        read(tmp_path, recorded(log, joints=without))
    back = lambda log, row, stamp: joints_of(log, row, stamp - (10**9 if row > 400 else 0))  # noqa: E731
    with pytest.raises(ValueError, match=r"/joint_states position.wheel_0, .*: time fails to increase 1 times, first"):
        read(tmp_path, recorded(log, joints=back))
    empty = io.BytesIO()
    mcap_ros2.Writer(empty).finish()
    with pytest.raises(ValueError, match=r"no topic has messages .*topics: none"):
        read(tmp_path, empty.getvalue())


def test_samples_that_are_not_numbers_are_counted_and_left_out(tmp_path, log):
    def joints(log, row, stamp):
        message = joints_of(log, row, stamp)
        return {**message, "position": [np.nan, *message["position"][1:]]} if 100 <= row < 140 else message

    found = read(tmp_path, recorded(log, joints=joints))
    angles = found.report.sources[0]
    assert (angles.missing, angles.gaps) == (20, 1)
    assert np.isfinite(found.wheel_angles).all()
    assert np.diff(found.time).max() == pytest.approx(0.21)


def test_messages_without_a_stamp_are_left_out_unless_none_has_one(tmp_path, log):
    """The time of the log has another clock than the stamps."""
    some = lambda log, row, stamp: joints_of(log, row, 0 if row in (100, 102, 300) else stamp)  # noqa: E731
    found = read(tmp_path, recorded(log, joints=some))
    assert found.report.sources[0].missing == 3
    assert "3 incomplete samples left out" in found.report.lines()[0]
    np.testing.assert_allclose(np.diff(found.time).max(), 0.03)
    none = lambda log, row, _: joints_of(log, row, 0)  # noqa: E731
    logged = read(tmp_path, recorded(log, joints=none))
    assert logged.report.sources[0].missing == 0
    # Logged 1 ms after the stamps.
    assert logged.report.clock_offset == pytest.approx(-0.001, abs=0.0008)


@pytest.mark.parametrize(
    ("stamp", "shown"),
    [({"sec": 1.5, "nanosec": 0}, "sec = 1.5, nanosec = 0"), (12.5, "12.5"), ({"secs": 1}, "{'secs': 1}")],
)
def test_stamps_that_are_not_whole_numbers_are_named(tmp_path, stamp, shown):
    packed = io.BytesIO()
    writer = mcap_writer.Writer(packed, compression=mcap_writer.CompressionType.NONE)
    writer.start()
    schema = writer.register_schema("ballbot.state", "jsonschema", b"{}")
    channel = writer.register_channel("/state", "json", schema)
    data = json.dumps({"header": {"stamp": stamp}, "wheel_angles": {"0": 0.0}}).encode()
    writer.add_message(channel, log_time=0, publish_time=0, data=data)
    writer.finish()
    with pytest.raises(ValueError, match="expected whole numbers sec and nanosec") as caught:
        read(tmp_path, packed.getvalue())
    assert f"log.mcap: a header.stamp of /state is {shown}: " in str(caught.value)


def test_broken_files_are_rejected(tmp_path, log):
    whole = recorded(log)
    rng = np.random.default_rng(0)
    for end in [0, 5, 30, *rng.integers(8, len(whole) - 8, 8).tolist()]:
        with pytest.raises(ValueError, match=r"log\.mcap: .*(truncated or broken|no topic has)"):
            read(tmp_path, whole[:end])
    for _ in range(30):
        place = int(rng.integers(8, len(whole)))
        broken = whole[:place] + rng.bytes(4) + whole[place + 4 :]
        try:
            read(tmp_path, broken)
        except ValueError as error:
            assert "log.mcap: " in str(error)  # noqa: PT017
    with pytest.raises(ValueError, match=r"truncated or broken .*invalid magic"):
        read(tmp_path, b"no log at all")


def test_a_chunk_takes_no_more_memory_than_it_declares(tmp_path, monkeypatch):
    zeros = bytes(1 << 24)
    import lz4.frame
    import zstandard

    for name, packed in (("zstd", zstandard.compress(zeros)), ("lz4", lz4.frame.compress(zeros))):
        body = struct.pack("<QQQI", 0, 0, 1000, 0) + struct.pack("<I", len(name)) + name.encode()
        body += struct.pack("<Q", len(packed)) + packed
        file = b"\x89MCAP0\r\n" + b"\x06" + struct.pack("<Q", len(body)) + body
        with pytest.raises(ValueError, match="truncated or broken"):
            read(tmp_path, file)
        monkeypatch.setattr(mcap_topics, "MAX_UNPACKED", 999)
        with pytest.raises(ValueError, match="more than 999 bytes when unpacked, the limit: `mcap filter`"):
            read(tmp_path, file)
        monkeypatch.undo()


def test_messages_with_too_many_numbers_are_rejected(tmp_path):
    packed = io.BytesIO()
    writer = mcap_writer.Writer(packed, compression=mcap_writer.CompressionType.NONE)
    writer.start()
    schema = writer.register_schema("ballbot.state", "jsonschema", b"{}")
    channel = writer.register_channel("/state", "json", schema)
    data = json.dumps({"wheel_angles": {str(i): 0.0 for i in range(300)}}).encode()
    writer.add_message(channel, log_time=0, publish_time=0, data=data)
    writer.finish()
    with pytest.raises(ValueError, match="/state has more than 256 numbers a message, the limit"):
        read(tmp_path, packed.getvalue())
