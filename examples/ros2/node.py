"""A ROS 2 node that simulates one ballbot, publishes what a robot publishes, and takes its commands."""

import math
import sys
from collections import deque
from collections.abc import Mapping
from typing import Any

import conversion
import numpy as np

import ballbot_rs as bb

try:
    import rclpy
    from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
    from nav_msgs.msg import Odometry
    from rclpy.clock import Clock as RosClock
    from rclpy.clock import ClockType
    from rclpy.exceptions import ParameterException
    from rclpy.executors import ExternalShutdownException
    from rclpy.node import Node
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import Imu, JointState
    from std_msgs.msg import Float64MultiArray
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError as missing:
    sys.exit(
        f"this node needs ROS 2, and Python did not find its module {missing.name}: source the setup script of ROS 2, "
        "and install ballbot-rs for the Python that ROS uses (examples/ros2/README.md)"
    )

#: Parameters of the node with their defaults; README.md explains them.
PARAMETERS: Mapping[str, Any] = {
    "robot": "paper",
    "model": "contact",
    "controller": "lqr",
    "sensors": "exact",
    "real_time_factor": 1.0,
    "command_timeout": 0.5,
    "seed": 0,
    "pose_covariance_diagonal": [0.0] * 6,
    "twist_covariance_diagonal": [0.0] * 6,
}
#: Of the parameter `controller`: no law, the node takes wheel torques.
NO_LAW = "none"
QUEUE = 10


def filled(message: Any, fields: Mapping[str, Any]) -> Any:
    """The message with its fields set from nested dicts."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


class BallbotNode(Node):
    """Steps one robot with sensors; the law and the odometry use the estimate from their readings.

    Raises:
        ValueError: a parameter out of range, or an unknown name.
        OSError: a file of a robot or of sensors that cannot be read.
    """

    def __init__(self) -> None:
        super().__init__("ballbot")
        p = {name: self.declare_parameter(name, default).value for name, default in PARAMETERS.items()}
        factor = p["real_time_factor"]
        if factor != 0.0 and not 1e-3 <= factor <= 1e3:
            raise ValueError(f"real_time_factor = {factor} is out of range: it must be 0, or from 0.001 to 1000")
        if not 0.0 <= p["command_timeout"] < math.inf:
            raise ValueError(f"command_timeout = {p['command_timeout']} is out of range: it must be finite and >= 0, s")
        self._variances = []
        for name in ("pose_covariance_diagonal", "twist_covariance_diagonal"):
            if len(p[name]) != 6 or not all(0.0 <= variance < math.inf for variance in p[name]):
                raise ValueError(f"{name} = {list(p[name])}: expected six finite variances >= 0")
            self._variances.append(list(p[name]))
        self._params = bb.Ballbot(p["robot"]).params
        self._law = None if p["controller"] == NO_LAW else bb.make_controller(p["controller"], self._params)
        if self._law is not None and "velocity" not in self._law.setpoint_parts:
            raise ValueError(f"controller = '{p['controller']}' does not follow a velocity: docs/laws.md has others")
        self._batch = bb.Batch(
            1,
            "velocity",
            autoreset="disabled",
            num_threads=1,
            seed=p["seed"],
            robot=self._params,
            model=p["model"],
            control_dt=0.01 if self._law is None else self._law.control_dt,
            max_wheel_torque=self._params.max_wheel_torque,
            sensors=p["sensors"],
            observation="sensors",
            max_episode_steps=2**31 - 1,
        )
        self._steps = 0
        self._step_nanoseconds = round(1e9 * self._batch.control_dt)
        self._sensors = self._batch.sensors(0)
        self._imu_variances = conversion.imu_variances(self._sensors, self._batch.control_dt)
        self._timeout = round(1e9 * p["command_timeout"])
        self._latency = round(self._sensors["latency"] / self._batch.control_dt)
        #: Commanded from the time of the readings on, and since, the oldest first.
        self._torques: deque[Any] = deque(maxlen=self._latency + 1)
        self._command, self._received, self._started = np.zeros(3), 0, 0
        kinds = {"imu/data_raw": Imu, "joint_states": JointState, "odom": Odometry, "setpoint": PoseStamped}
        kinds |= {"/tf": TFMessage, "/clock": Clock}
        self._publishers_of = {topic: self.create_publisher(kind, topic, QUEUE) for topic, kind in kinds.items()}
        if self._law is None:
            self.create_subscription(Float64MultiArray, "wheel_torques", self._on_torques, QUEUE)
        else:
            self.create_subscription(Twist, "cmd_vel", self._on_velocity, QUEUE)
        self._start()
        # The clock of the node may be the simulated clock, which this timer advances.
        steady = RosClock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self._batch.control_dt / factor if factor else 0.0, self.step, clock=steady)

    @property
    def nanoseconds(self) -> int:
        """Simulated time."""
        return self._steps * self._step_nanoseconds

    def step(self) -> None:
        """Simulates one control step, and publishes."""
        _, _, terminated, truncated = self._batch.step(self._action)
        self._steps += 1
        self._decide()
        self._publish()
        if terminated[0] or truncated[0]:
            reason, at = self._batch.ending(0)[1] or "time", f"{1e-9 * self.nanoseconds:.2f} s"
            self.get_logger().error(f"the motion ended by '{reason}' at {at}: the robot starts again at the origin")
            self._start()

    def _decide(self) -> None:
        """Takes the torques of the next control step; commands that come later act one step later."""
        is_old = self.nanoseconds - self._received > self._timeout
        command = np.zeros(3) if is_old else self._command
        if self._law is None:
            self._action = command[np.newaxis] / self._batch.max_wheel_torque
        else:
            if not np.array_equal(command, self._batch.command(0)):
                self._batch.set_command(0, command)
            self._action = self._batch.control(self._law)
        self._torques.append(self._action[0] * self._batch.max_wheel_torque)

    def _start(self) -> None:
        self._started = self.nanoseconds
        self._torques.clear()
        self._batch.reset(starts=[bb.State.at_equilibrium(self._params, tilt=self._params.slope_lean())])
        self._batch.set_command(0, np.zeros(3))
        self._decide()

    def _publish(self) -> None:
        now, readings, state = self.nanoseconds, self._batch.readings(0), self._batch.estimate(0)
        fields = {"/clock": {"clock": conversion.time(now)}}
        # Readings and the estimate from them are old by the latency. Before, the first readings are repeated.
        measured = now - self._latency * self._step_nanoseconds
        if measured >= self._started:
            transforms = conversion.transforms(state, self._sensors["imu_position"], measured)
            fields |= {
                "imu/data_raw": conversion.imu(readings, measured, *self._imu_variances),
                "joint_states": conversion.joint_state(readings, self._torques[0], measured),
                "odom": conversion.odometry(state, measured, *self._variances),
                "/tf": {"transforms": [filled(TransformStamped(), transform) for transform in transforms]},
            }
        if self._law is not None:
            height = self._params.ball_radius
            fields["setpoint"] = conversion.setpoint_pose(self._batch.setpoint(0), height, now)
        for topic, content in fields.items():
            publisher = self._publishers_of[topic]
            publisher.publish(filled(publisher.msg_type(), content))

    def _on_velocity(self, message: Any) -> None:
        options = self._batch.options
        self._receive(lambda: conversion.velocity_command(message, options["speed"], options["yaw_rate"]))

    def _on_torques(self, message: Any) -> None:
        self._receive(lambda: conversion.wheel_torques(message.data, self._batch.max_wheel_torque))

    def _receive(self, convert: Any) -> None:
        try:
            self._command = convert()
        except ValueError as error:
            self.get_logger().warning(f"ignored: {error}")
            return
        self._received = self.nanoseconds


def main() -> None:
    """Runs the node until it is interrupted."""
    rclpy.init(args=sys.argv)
    try:
        rclpy.spin(BallbotNode())
    except (ValueError, OSError, ParameterException) as error:
        sys.exit(f"ballbot: {error}")
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
