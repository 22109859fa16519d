"""States, readings and commands of a ballbot as fields of ROS 2 messages, and back; without ROS.

Each function gives the fields of one message as nested dicts and lists, by the names of the message definitions.
Frames follow REP 103 and REP 105: `odom` is the inertial frame, `base_link` the body frame (x forward, y left, z along
the mast, origin at the ball's center), `ball` turns with the ball, and `imu_link` has the axes of `base_link`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb

Fields = dict[str, Any]

#: Joints of `bb.write_urdf`, in the order of the wheels.
WHEEL_JOINTS = ["wheel_joint_0", "wheel_joint_1", "wheel_joint_2"]


def time(nanoseconds: int) -> Fields:
    """`builtin_interfaces/Time`."""
    sec, nanosec = divmod(int(nanoseconds), 10**9)
    return {"sec": sec, "nanosec": nanosec}


def header(nanoseconds: int, frame: str) -> Fields:
    """`std_msgs/Header`."""
    return {"stamp": time(nanoseconds), "frame_id": frame}


def imu(
    readings: Mapping[str, npt.ArrayLike], nanoseconds: int, gyro_variance: float = 0.0, force_variance: float = 0.0
) -> Fields:
    """`sensor_msgs/Imu` from `Batch.readings(index)`, without orientation; the acceleration is the specific force.

    Both as in REP 145. The variances of an axis are in (rad/s)² and (m/s²)²; 0 is unknown.
    """
    return {
        "header": header(nanoseconds, "imu_link"),
        # Of a message without orientation.
        "orientation_covariance": [-1.0] + 8 * [0.0],
        "angular_velocity": _xyz(readings["gyro"]),
        "angular_velocity_covariance": diagonal(3 * [gyro_variance]),
        "linear_acceleration": _xyz(readings["specific_force"]),
        "linear_acceleration_covariance": diagonal(3 * [force_variance]),
    }


def imu_variances(sensors: Mapping[str, Any], control_dt: float) -> tuple[float, float]:
    """Variances of the white noise of gyroscope and accelerometer, from the options `sensors` of a batch."""
    sample_dt = 1.0 / sensors["imu_rate"] if sensors["imu_rate"] else control_dt
    return sensors["gyro_noise"] ** 2 / sample_dt, sensors["accelerometer_noise"] ** 2 / sample_dt


def joint_state(readings: Mapping[str, npt.ArrayLike], torques: npt.ArrayLike, nanoseconds: int) -> Fields:
    """`sensor_msgs/JointState` of the wheels from `Batch.readings(index)` and the torques commanded then, N·m.

    As in `SensorLog`, torques act from the stamp until the next one.
    """
    return {
        "header": header(nanoseconds, "base_link"),
        "name": WHEEL_JOINTS,
        "position": _floats(readings["wheel_angles"]),
        "velocity": _floats(readings["wheel_rates"]),
        "effort": _floats(torques),
    }


def odometry(
    state: bb.State,
    nanoseconds: int,
    pose_variances: Sequence[float] = (0.0,) * 6,
    twist_variances: Sequence[float] = (0.0,) * 6,
) -> Fields:
    """`nav_msgs/Odometry`: the pose in `odom`, the twist in `base_link`; variances of x, y, z, then about x, y, z."""
    velocity = rotation(state.body_quaternion).T @ state.body_velocity
    twist = {"linear": _xyz(velocity), "angular": _xyz(state.body_angular_velocity)}
    pose = {"position": _xyz(state.body_position), "orientation": quaternion(state.body_quaternion)}
    return {
        "header": header(nanoseconds, "odom"),
        "child_frame_id": "base_link",
        "pose": {"pose": pose, "covariance": diagonal(pose_variances)},
        "twist": {"twist": twist, "covariance": diagonal(twist_variances)},
    }


def transforms(state: bb.State, imu_position: npt.ArrayLike, nanoseconds: int) -> list[Fields]:
    """`geometry_msgs/TransformStamped` of body and ball in `odom`, and of the IMU in `base_link`."""
    poses: list[tuple[str, str, npt.ArrayLike, npt.ArrayLike]] = [
        ("odom", "base_link", state.body_position, state.body_quaternion),
        ("odom", "ball", state.ball_position, state.ball_quaternion),
        ("base_link", "imu_link", imu_position, (1.0, 0.0, 0.0, 0.0)),
    ]
    return [
        {
            "header": header(nanoseconds, parent),
            "child_frame_id": child,
            "transform": {"translation": _xyz(position), "rotation": quaternion(attitude)},
        }
        for parent, child, position, attitude in poses
    ]


def setpoint_pose(setpoint: Mapping[str, Any], height: float, nanoseconds: int) -> Fields:
    """`geometry_msgs/PoseStamped` of a setpoint of the ball's center at `height`, m: its position and heading."""
    half = 0.5 * setpoint["yaw"]
    pose = {
        "position": _xyz([*setpoint["position"], height]),
        "orientation": quaternion([math.cos(half), 0.0, 0.0, math.sin(half)]),
    }
    return {"header": header(nanoseconds, "odom"), "pose": pose}


def velocity_command(twist: Any, speed: float, yaw_rate: float) -> npt.NDArray[np.float64]:
    """Command of the task `velocity`, shape (3,), from a `geometry_msgs/Twist`: velocity (x, y), m/s, and rate, rad/s.

    A faster command is scaled to `speed` with its direction kept, and limited to `yaw_rate`.

    Raises:
        ValueError: a number that is not finite.
    """
    command = _finite("cmd_vel", [twist.linear.x, twist.linear.y, twist.angular.z])
    asked = math.hypot(command[0], command[1])
    if asked > speed:
        command[:2] *= speed / asked
    command[2] = np.clip(command[2], -yaw_rate, yaw_rate)
    return command


def wheel_torques(data: npt.ArrayLike, limit: float) -> npt.NDArray[np.float64]:
    """Wheel torques, shape (3,), N·m, from the data of a `std_msgs/Float64MultiArray`, limited as the motors are.

    Raises:
        ValueError: not three finite numbers.
    """
    torques = _finite("wheel_torques", data)
    return np.clip(torques, -limit, limit)


def quaternion(wxyz: npt.ArrayLike) -> Fields:
    """`geometry_msgs/Quaternion`, which ROS orders x, y, z, w."""
    w, x, y, z = _floats(wxyz)
    return {"x": x, "y": y, "z": z, "w": w}


def rotation(wxyz: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    w, x, y, z = _floats(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def diagonal(variances: Sequence[float]) -> list[float]:
    """A covariance with these variances, in rows one after the other."""
    return [float(value) for value in np.diag(variances).ravel()]


def _finite(what: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{what} = {array.tolist()}: expected three finite numbers")
    return array


def _xyz(values: npt.ArrayLike) -> Fields:
    return dict(zip("xyz", _floats(values), strict=True))


def _floats(values: npt.ArrayLike) -> list[float]:
    return [float(value) for value in np.asarray(values, dtype=np.float64)]
