"""A double of `rclpy` and its messages for examples/ros2, as strict about names and types as ROS."""

import ast
import copy
import dataclasses
import itertools
import sys
import types
from typing import Any

import pytest


def _message(name: str, /, **fields: Any) -> type:
    """A message with these fields and defaults: a class, a list, or a number or text; others cannot be set."""
    made = [
        (
            field,
            Any,
            dataclasses.field(default_factory=default if callable(default) else lambda d=default: copy.copy(d)),
        )
        for field, default in fields.items()
    ]
    return dataclasses.make_dataclass(name, made, slots=True)


Time = _message("Time", sec=0, nanosec=0)
Header = _message("Header", stamp=Time, frame_id="")
Vector3 = _message("Vector3", x=0.0, y=0.0, z=0.0)
Quaternion = _message("Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
Pose = _message("Pose", position=Vector3, orientation=Quaternion)
Twist = _message("Twist", linear=Vector3, angular=Vector3)
Transform = _message("Transform", translation=Vector3, rotation=Quaternion)
PoseWithCovariance = _message("PoseWithCovariance", pose=Pose, covariance=[0.0] * 36)
TwistWithCovariance = _message("TwistWithCovariance", twist=Twist, covariance=[0.0] * 36)
MESSAGES = {
    "rosgraph_msgs": [_message("Clock", clock=Time)],
    "geometry_msgs": [
        Twist,
        _message("PoseStamped", header=Header, pose=Pose),
        _message("TransformStamped", header=Header, child_frame_id="", transform=Transform),
    ],
    "nav_msgs": [
        _message("Odometry", header=Header, child_frame_id="", pose=PoseWithCovariance, twist=TwistWithCovariance)
    ],
    "sensor_msgs": [
        _message(
            "Imu",
            header=Header,
            orientation=Quaternion,
            orientation_covariance=[0.0] * 9,
            angular_velocity=Vector3,
            angular_velocity_covariance=[0.0] * 9,
            linear_acceleration=Vector3,
            linear_acceleration_covariance=[0.0] * 9,
        ),
        _message("JointState", header=Header, name=[], position=[], velocity=[], effort=[]),
    ],
    "std_msgs": [_message("Float64MultiArray", data=[])],
    "tf2_msgs": [_message("TFMessage", transforms=[])],
}


def check(message: Any, kind: type) -> None:
    """Asserts the types of all fields, and the lengths of arrays of fixed length."""
    assert type(message) is kind
    for field in dataclasses.fields(kind):
        value, default = getattr(message, field.name), field.default_factory()
        if dataclasses.is_dataclass(default):
            check(value, type(default))
        else:
            assert type(value) is type(default), field.name
        if isinstance(default, list) and default:
            assert len(value) == len(default), field.name
            assert all(type(number) is float for number in value), field.name


class ParameterException(Exception):
    """As of rclpy."""


class Publisher:
    """Keeps what it publishes."""

    def __init__(self, msg_type: type) -> None:
        self.msg_type, self.published = msg_type, []

    def publish(self, message: Any) -> None:
        check(message, self.msg_type)
        self.published.append(copy.deepcopy(message))


class Ros:
    """What the node did, and the parameters that it was given."""

    def __init__(self) -> None:
        self.parameters: dict[str, Any] = {}
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, Any] = {}
        self.timer: tuple[float, Any, Any] = (0.0, None, None)
        self.logged: list[str] = []
        self.is_shut_down = False

    def init(self, args: list[str]) -> None:
        for flag, text in itertools.pairwise(args):
            if flag == "-p":
                name, _, value = text.partition(":=")
                try:
                    self.parameters[name] = ast.literal_eval(value)
                except (ValueError, SyntaxError):
                    self.parameters[name] = value

    def try_shutdown(self) -> None:
        self.is_shut_down = True

    def run(self, steps: int) -> None:
        """Lets the timer fire."""
        for _ in range(steps):
            self.timer[1]()

    def published(self, topic: str) -> list[Any]:
        return self.publishers[topic].published


def _node_of(ros: Ros) -> type:
    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def declare_parameter(self, name: str, default: Any) -> Any:
            value = ros.parameters.get(name, default)
            if type(value) is not type(default):
                raise ParameterException(f"wrong type of {name}")
            return types.SimpleNamespace(value=value)

        def create_publisher(self, kind: type, topic: str, queue: int) -> Publisher:  # noqa: ARG002
            return ros.publishers.setdefault(topic, Publisher(kind))

        def create_subscription(self, kind: type, topic: str, callback: Any, queue: int) -> None:  # noqa: ARG002
            ros.subscriptions[topic] = callback

        def create_timer(self, period: float, callback: Any, *, clock: Any) -> None:
            ros.timer = (period, callback, clock)

        def get_logger(self) -> Any:
            return types.SimpleNamespace(warning=ros.logged.append, error=ros.logged.append)

    return Node


def install(monkeypatch: pytest.MonkeyPatch) -> Ros:
    """Puts the double in the place of ROS."""
    ros = Ros()
    clock_types = types.SimpleNamespace(STEADY_TIME="steady")
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {"init": ros.init, "try_shutdown": ros.try_shutdown, "spin": lambda _: ros.run(100)},
        "rclpy.clock": {"Clock": lambda clock_type: clock_type, "ClockType": clock_types},
        "rclpy.exceptions": {"ParameterException": ParameterException},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.node": {"Node": _node_of(ros)},
    }
    for package, kinds in MESSAGES.items():
        contents |= {package: {}, f"{package}.msg": {kind.__name__: kind for kind in kinds}}
    for name, members in contents.items():
        module = types.ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    return ros
