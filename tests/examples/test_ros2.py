"""examples/ros2: the conversion to messages without ROS, and the node on a double of rclpy."""

import importlib
import math
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support import fake_ros
from tests.support.paths import ROOT

FOLDER = ROOT / "examples" / "ros2"
PAPER = bb.Params.paper()
LEFT = math.pi / 2.0


@pytest.fixture
def load(monkeypatch):
    """Imports a module of the folder, for this test only."""
    monkeypatch.syspath_prepend(FOLDER)

    def load(name):
        found = importlib.import_module(name)
        for module in ("conversion", "node"):
            sys.modules.pop(module, None)
        return found

    return load


@pytest.fixture
def conversion(load):
    return load("conversion")


def vector(fields):
    return np.array([fields[axis] for axis in "xyz"])


def turned(q, v):
    """The vector in the frame that the quaternion x, y, z, w of a message maps to."""
    axis, w, v = vector(q), q["w"], np.array(v)
    return v + 2.0 * np.cross(axis, np.cross(axis, v) + w * v)


def test_the_order_of_a_quaternion_is_of_ros(conversion):
    assert conversion.quaternion((0.5, -0.1, 0.2, 0.3)) == {"x": -0.1, "y": 0.2, "z": 0.3, "w": 0.5}


def test_a_robot_that_leans_forward_is_pitched_about_y(conversion):
    state = bb.State.at_rest(PAPER, tilt=(0.0, 0.2))
    attitude = conversion.odometry(state, 0)["pose"]["pose"]["orientation"]
    np.testing.assert_allclose([attitude[name] for name in "xyzw"], [0.0, math.sin(0.1), 0.0, math.cos(0.1)])
    np.testing.assert_allclose(turned(attitude, [0.0, 0.0, 1.0]), [math.sin(0.2), 0.0, math.cos(0.2)], atol=1e-15)


def test_a_robot_that_looks_left_and_drives_there_moves_forward_in_its_frame(conversion):
    facing = bb.State.at_rest(PAPER, yaw=LEFT).body_quaternion
    state = bb.State.rolling(PAPER, (0.0, 0.4), facing, (0.0, 0.0, 0.7))
    fields = conversion.odometry(state, 0)
    assert (fields["header"]["frame_id"], fields["child_frame_id"]) == ("odom", "base_link")
    twist = fields["twist"]["twist"]
    np.testing.assert_allclose(vector(twist["linear"]), [0.4, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(vector(twist["angular"]), [0.0, 0.0, 0.7], atol=1e-12)
    ahead = turned(fields["pose"]["pose"]["orientation"], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(ahead, [0.0, 1.0, 0.0], atol=1e-12)


def test_the_body_returns_from_its_odometry(conversion):
    numbers = np.random.default_rng(1)
    for _ in range(20):
        attitude = numbers.normal(size=4)
        state = bb.State(
            numbers.normal(size=3),
            numbers.normal(size=3),
            body_quaternion=attitude / np.linalg.norm(attitude),
            body_angular_velocity=numbers.normal(size=3),
        )
        fields = conversion.odometry(state, 0)
        pose, twist = fields["pose"]["pose"], fields["twist"]["twist"]
        np.testing.assert_allclose(vector(pose["position"]), state.body_position)
        np.testing.assert_allclose([pose["orientation"][name] for name in "wxyz"], state.body_quaternion)
        np.testing.assert_allclose(turned(pose["orientation"], vector(twist["linear"])), state.body_velocity)
        np.testing.assert_allclose(vector(twist["angular"]), state.body_angular_velocity)


def test_transforms_place_body_ball_and_imu(conversion):
    state = bb.State.at_rest(PAPER, tilt=(0.1, 0.0)).replace(ball_quaternion=(0.6, 0.8, 0.0, 0.0))
    body, ball, imu = conversion.transforms(state, (0.01, 0.02, 0.3), 2_500_000_000)
    assert [(f["header"]["frame_id"], f["child_frame_id"]) for f in (body, ball, imu)] == [
        ("odom", "base_link"),
        ("odom", "ball"),
        ("base_link", "imu_link"),
    ]
    assert body["header"]["stamp"] == {"sec": 2, "nanosec": 500_000_000}
    assert body["transform"]["translation"] == {"x": 0.0, "y": 0.0, "z": PAPER.ball_radius}
    assert ball["transform"]["rotation"] == {"x": 0.8, "y": 0.0, "z": 0.0, "w": 0.6}
    np.testing.assert_allclose(vector(imu["transform"]["translation"]), [0.01, 0.02, 0.3])


def test_readings_at_rest_are_gravity_upward_and_still_wheels(conversion):
    batch = bb.Batch(1, robot=PAPER, sensors={})
    batch.reset(starts=[bb.State.at_rest(PAPER)])
    imu = conversion.imu(batch.readings(0), 0, 0.01, 0.04)
    np.testing.assert_allclose(vector(imu["linear_acceleration"]), [0.0, 0.0, PAPER.gravity], atol=1e-9)
    assert imu["orientation_covariance"][0] == -1.0
    assert np.diag(np.reshape(imu["angular_velocity_covariance"], (3, 3))).tolist() == [0.01] * 3
    assert np.diag(np.reshape(imu["linear_acceleration_covariance"], (3, 3))).tolist() == [0.04] * 3
    joints = conversion.joint_state(batch.readings(0), (1.0, 2.0, 3.0), 0)
    assert joints["velocity"] == [0.0] * 3
    assert joints["effort"] == [1.0, 2.0, 3.0]


def test_the_joints_are_of_the_urdf(conversion, tmp_path):
    text = bb.write_urdf(PAPER, tmp_path / "robot.urdf").read_text(encoding="utf-8")
    assert re.findall(r'joint name="(\w+)" type="continuous"', text) == conversion.WHEEL_JOINTS


def test_covariances_are_on_the_diagonal(conversion):
    state = bb.State.at_rest(PAPER)
    fields = conversion.odometry(state, 0, [1, 2, 3, 4, 5, 6], [6, 5, 4, 3, 2, 1])
    np.testing.assert_array_equal(np.reshape(fields["pose"]["covariance"], (6, 6)), np.diag([1, 2, 3, 4, 5, 6]))
    np.testing.assert_array_equal(np.reshape(fields["twist"]["covariance"], (6, 6)), np.diag([6, 5, 4, 3, 2, 1]))


def test_noise_of_the_imu_is_of_its_sampling_rate(conversion):
    options = {"gyro_noise": 0.02, "accelerometer_noise": 0.1, "imu_rate": 0.0}
    assert conversion.imu_variances(options, 0.01) == pytest.approx((0.04, 1.0))
    assert conversion.imu_variances({**options, "imu_rate": 50.0}, 0.01) == pytest.approx((0.02, 0.5))


def test_the_setpoint_looks_along_its_heading(conversion):
    fields = conversion.setpoint_pose({"position": (1.0, 2.0), "yaw": LEFT}, 0.1, 0)["pose"]
    np.testing.assert_allclose(vector(fields["position"]), [1.0, 2.0, 0.1])
    np.testing.assert_allclose(turned(fields["orientation"], [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15)


def twist(x, y, turn):
    message = fake_ros.Twist()
    message.linear.x, message.linear.y, message.angular.z = x, y, turn
    return message


def test_commands_are_limited_and_checked(conversion):
    assert conversion.velocity_command(twist(0.1, -0.2, 0.3), 0.5, 1.0).tolist() == [0.1, -0.2, 0.3]
    np.testing.assert_allclose(conversion.velocity_command(twist(3.0, -4.0, -9.0), 0.5, 1.0), [0.3, -0.4, -1.0])
    with pytest.raises(ValueError, match=r"cmd_vel = \[nan, 0.0, 0.0\]: expected three finite"):
        conversion.velocity_command(twist(math.nan, 0.0, 0.0), 0.5, 1.0)
    assert conversion.wheel_torques([0.1, -7.0, 7.0], 2.0).tolist() == [0.1, -2.0, 2.0]
    for wrong in ([], [1.0, 2.0], [1.0, math.inf, 0.0]):
        with pytest.raises(ValueError, match=r"wheel_torques = .*: expected three finite numbers"):
            conversion.wheel_torques(wrong, 2.0)


@pytest.fixture
def ros(monkeypatch):
    return fake_ros.install(monkeypatch)


@pytest.fixture
def started(ros, load):
    """Makes a node with these parameters."""

    def start(**parameters):
        ros.parameters = parameters
        load("node").BallbotNode()
        return ros

    return start


def stamps(messages):
    return [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in messages]


def test_a_second_of_the_node_drives_the_robot_and_stamps_simulated_time(started):
    ros = started(robot="kugle", sensors="kugle")
    assert ros.timer[0] == pytest.approx(0.01)
    assert ros.timer[2] == "steady"
    for _ in range(10):
        ros.subscriptions["cmd_vel"](twist(0.3, 0.0, 0.4))
        ros.run(10)
    times = [10_000_000 * step for step in range(1, 101)]
    assert [m.clock.sec * 10**9 + m.clock.nanosec for m in ros.published("/clock")] == times
    for topic in ("odom", "imu/data_raw", "joint_states", "setpoint"):
        assert stamps(ros.published(topic)) == times, topic
    for message, time in zip(ros.published("/tf"), times, strict=True):
        for transform in message.transforms:
            fake_ros.check(transform, type(message.transforms[0]))
        assert stamps(message.transforms) == [time] * 3
    last = ros.published("odom")[-1]
    assert last.pose.pose.position.x > 0.01
    assert last.twist.twist.linear.x > 0.05
    assert last.twist.twist.angular.z > 0.05
    assert ros.published("setpoint")[-1].pose.position.x > 0.01
    assert ros.published("imu/data_raw")[0].angular_velocity_covariance[0] > 0.0
    assert np.abs(ros.published("joint_states")[-1].effort).max() > 0.0
    assert not ros.logged


def test_an_old_command_ends(started):
    ros = started(command_timeout=0.2)
    ros.subscriptions["cmd_vel"](twist(0.3, 0.0, 0.0))
    ros.run(1000)
    assert max(m.twist.twist.linear.x for m in ros.published("odom")) > 0.01
    assert abs(ros.published("odom")[-1].twist.twist.linear.x) < 0.01


def test_torques_move_the_wheels_until_the_robot_falls_and_starts_again(started):
    ros = started(controller="none", command_timeout=60.0, real_time_factor=0.0)
    assert ros.timer[0] == 0.0
    assert "cmd_vel" not in ros.subscriptions
    ros.subscriptions["wheel_torques"](SimpleNamespace(data=[0.05, -0.02, 1e9]))
    ros.run(200)
    efforts = ros.published("joint_states")[0].effort
    np.testing.assert_allclose(efforts, [0.05, -0.02, PAPER.max_wheel_torque], rtol=1e-6)
    assert any(re.search(r"ended by 'tilt' at 0\.\d\d s: the robot starts again", line) for line in ros.logged)
    assert np.diff(stamps(ros.published("odom"))).tolist() == [10_000_000] * 199
    assert not ros.published("setpoint")


def test_a_command_that_is_not_one_is_ignored(started):
    ros = started()
    ros.subscriptions["cmd_vel"](twist(math.inf, 0.0, 0.0))
    assert ros.logged == ["ignored: cmd_vel = [inf, 0.0, 0.0]: expected three finite numbers"]
    ros.run(20)
    assert abs(ros.published("odom")[-1].twist.twist.linear.x) < 1e-6


def test_late_readings_have_the_time_of_their_measurement(started, tmp_path):
    late = tmp_path / "late.toml"
    late.write_text(PAPER.to_toml() + "\n[sensors]\nlatency = 0.03\n", encoding="utf-8")
    ros = started(sensors=str(late))
    ros.run(10)
    # None before the first readings are published, and the estimate is as old as the readings.
    for topic in ("imu/data_raw", "joint_states", "odom"):
        assert stamps(ros.published(topic)) == [10_000_000 * step for step in range(8)]
    assert len(ros.published("/clock")) == 10


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_torques_act_from_the_stamp_of_their_message_on(started, tmp_path, latency):
    file = tmp_path / "robot.toml"
    file.write_text(PAPER.to_toml() + f"\n[sensors]\nlatency = {latency}\n", encoding="utf-8")
    ros = started(controller="none", sensors=str(file))
    ros.run(4)
    ros.subscriptions["wheel_torques"](SimpleNamespace(data=[0.05, 0.05, 0.05]))
    ros.run(6)
    joints = ros.published("joint_states")
    first = next(i for i, joint in enumerate(joints) if joint.effort[0] > 0.0)
    angles = [joint.position[0] for joint in joints]
    assert abs(angles[first]) < 1e-9 < 1e-4 < angles[first + 1]
    assert stamps(joints)[first] == 50_000_000


def test_messages_of_the_node_are_a_log(started):
    ros = started()
    numbers = np.random.default_rng(2)
    for _ in range(20):
        ros.subscriptions["cmd_vel"](twist(*numbers.uniform(-0.4, 0.4, 3)))
        ros.run(25)
    joints, imus = ros.published("joint_states"), ros.published("imu/data_raw")
    log = bb.SensorLog(
        1e-9 * np.array(stamps(joints)),
        [joint.effort for joint in joints],
        [joint.position for joint in joints],
        [[imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z] for imu in imus],
    )
    found = bb.identify(log, fields=("body_mass",))
    assert found.params.body_mass == pytest.approx(PAPER.body_mass, rel=1e-4)


def test_the_program_takes_parameters_and_ends(ros, load, monkeypatch):
    node = load("node")
    monkeypatch.setattr(sys, "argv", ["node.py", "--ros-args", "-p", "robot:=rezero", "-p", "real_time_factor:=2.0"])
    node.main()
    assert len(ros.published("/clock")) == 100
    assert ros.timer[0] == pytest.approx(0.005)
    assert ros.is_shut_down


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("robot:=nobody", "unknown robot preset 'nobody'"),
        ("controller:=nothing", "nothing"),
        ("controller:=pid", "'pid' does not follow a velocity"),
        ("model:=flat", "flat"),
        ("sensors:=all", "all"),
        ("real_time_factor:=-1.0", "real_time_factor = -1.0 is out of range"),
        ("command_timeout:=-1.0", "command_timeout = -1.0 is out of range"),
        ("pose_covariance_diagonal:=[1.0]", r"pose_covariance_diagonal = \[1.0\]: expected six"),
        ("seed:=-1", "-1 is out of range: .* seed"),
        ("robot:=1", "wrong type of robot"),
    ],
)
def test_wrong_parameters_end_the_program_with_a_message(given, message, ros, load, monkeypatch):
    node = load("node")
    monkeypatch.setattr(sys, "argv", ["node.py", "--ros-args", "-p", given])
    with pytest.raises(SystemExit, match=rf"^ballbot: .*{message}"):
        node.main()
    assert ros.is_shut_down


def test_without_ros_the_message_names_what_to_install(load, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(SystemExit, match="needs ROS 2, and Python did not find its module rclpy"):
        load("node")
