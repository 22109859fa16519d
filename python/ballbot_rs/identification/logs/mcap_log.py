"""Series of an MCAP file: topics by their message types, or columns that a map names."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.logs.column_map import ColumnMap
from ballbot_rs.identification.logs.mcap_topics import Topic, read_topics
from ballbot_rs.identification.logs.recording import Series, checked

IMU: Final = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
JOINTS: Final = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
ODOMETRY: Final = ("nav_msgs/msg/Odometry", "nav_msgs/Odometry")
#: Quantities of an IMU: field and numbers.
_OF_IMU: Final = {
    "gyro": ("angular_velocity", "xyz"),
    "accelerations": ("linear_acceleration", "xyz"),
    "attitude": ("orientation", "wxyz"),
}
#: Quantities of joints.
_OF_JOINTS: Final = {"wheel_angles": "position", "torques": "effort"}
#: Quantities of a file of `Trajectory.to_mcap`: schema and field.
_OF_TRAJECTORY: Final = {
    "torques": ("ballbot.torque", "wheel_torque", "012"),
    "wheel_angles": ("ballbot.state", "wheel_angles", "012"),
    "gyro": ("ballbot.state", "body_angular_velocity", "xyz"),
    "attitude": ("ballbot.state", "body_quaternion", "wxyz"),
    "position": ("ballbot.state", "ball_position", "xyz"),
}
_POSITION: Final = "pose.pose.position"
#: Where the paths of numbers that are read by default begin.
_FIELDS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(IMU, (*(field for field, _ in _OF_IMU.values()), "orientation_covariance")),
    **dict.fromkeys(JOINTS, tuple(_OF_JOINTS.values())),
    **dict.fromkeys(ODOMETRY, (_POSITION,)),
    "ballbot.torque": ("wheel_torque",),
    "ballbot.state": tuple(field for schema, field, _ in _OF_TRAJECTORY.values() if schema == "ballbot.state"),
}


def read_mcap(contents: bytes, columns: ColumnMap | None) -> tuple[dict[str, Series], ColumnMap]:
    """The series of a file, and their map.

    Args:
        contents: of the file.
        columns: names numbers by topic and path, `/imu.angular_velocity.x`; None takes the only topic of IMU messages
            and the only topic of joint states, with three joints in the order of their names, and the position of the
            only odometry, or what `Trajectory.to_mcap` wrote.

    Raises:
        ValueError: a broken file, a missing topic or number, several topics of a type, or as `checked`.
        ModuleNotFoundError: a library is missing.
    """
    if columns is None:
        topics = read_topics(contents, _is_default)
        is_robot = _of_type(topics, (*IMU, *JOINTS))
        columns = ColumnMap.of({"columns": _of_robot(topics) if is_robot else _of_trajectory(topics)})
    else:
        for title in columns.times.values():
            raise InvalidInputError(f"time column {title}: messages have the time of their header, or of the log")
        names = columns.names
        topics = read_topics(
            contents,
            lambda topic, _, path: (
                f"{topic}.{path}" in names if path else any(one.startswith(f"{topic}.") for one in names)
            ),
        )
    found = {}
    origin = min((topic.first for topic in topics.values() if topic.rows), default=0)
    for name, titles in columns.columns.items():
        owners = {_owner(title, topics).name for title in titles}
        if len(owners) > 1:
            raise InvalidInputError(f"{name} has numbers of several topics: {', '.join(sorted(owners))}")
        topic = topics[owners.pop()]
        paths = [title[len(topic.name) + 1 :] for title in titles]
        values = np.stack([np.array(topic.columns[path]) for path in paths], axis=-1) * columns.scale(name)
        found[name] = checked(f"{topic.name} {', '.join(paths)}", topic.name, topic.times(origin), values)
    return found, columns


def _is_default(_: str, schema: str, path: str) -> bool:
    fields = _FIELDS.get(schema, ())
    return bool(fields) if not path else any(path.startswith(f"{field}.") for field in fields)


def _of_type(topics: Mapping[str, Topic], types: tuple[str, ...]) -> list[Topic]:
    return [topic for topic in topics.values() if topic.schema in types and topic.rows]


def _only(topics: Mapping[str, Topic], types: tuple[str, ...]) -> Topic:
    found = _of_type(topics, types)
    if len(found) != 1:
        names = ", ".join(f"{one.name} ({one.schema or 'no schema'})" for one in topics.values()) or "none"
        which = "no topic has" if not found else f"{len(found)} topics have"
        raise InvalidInputError(f"{which} messages {types[0]}; topics: {names}; select columns with a column map")
    return found[0]


def _of_robot(topics: Mapping[str, Topic]) -> dict[str, list[str]]:
    imu, joints = _only(topics, IMU), _only(topics, JOINTS)
    names = sorted(path.partition(".")[2] for path in joints.columns if path.startswith("position."))
    if len(names) != 3:
        raise InvalidInputError(
            f"{joints.name} has positions of {len(names)} joints, {', '.join(names)}, expected three wheels; name "
            "theirs by a column map"
        )
    if not any(path.startswith("effort.") for path in joints.columns):
        raise InvalidInputError(f"{joints.name} has no effort; select the torques with a column map")
    found = {name: [f"{joints.name}.{field}.{joint}" for joint in names] for name, field in _OF_JOINTS.items()}
    for name, (field, axes) in _OF_IMU.items():
        if name == "gyro" or _is_measured(imu, field):
            found[name] = [f"{imu.name}.{field}.{axis}" for axis in axes]
    odometry = _of_type(topics, ODOMETRY)
    if len(odometry) == 1 and _is_measured(odometry[0], _POSITION):
        found["position"] = [f"{odometry[0].name}.{_POSITION}.{axis}" for axis in "xyz"]
    return found


def _is_measured(topic: Topic, field: str) -> bool:
    """Whether the numbers of a field are not all zero, as an IMU sends what it does not measure."""
    own = [numbers for path, numbers in topic.columns.items() if path.startswith(f"{field}.")]
    # By REP 145 an IMU without orientation has a covariance that begins with -1.
    without = topic.columns.get(f"{field}_covariance.0")
    return any(map(any, own)) and (without is None or not without or without[0] != -1.0)


def _of_trajectory(topics: Mapping[str, Topic]) -> dict[str, list[str]]:
    return {
        name: [f"{_only(topics, (schema,)).name}.{field}.{axis}" for axis in axes]
        for name, (schema, field, axes) in _OF_TRAJECTORY.items()
    }


def _owner(title: str, topics: Mapping[str, Topic]) -> Topic:
    """The topic that a column belongs to: the longest whose name begins it."""
    owners = [topic for topic in topics.values() if title.startswith(f"{topic.name}.")]
    if not owners:
        raise InvalidInputError(f"column {title}: no topic name begins it; there are {', '.join(topics) or 'none'}")
    topic = max(owners, key=lambda one: len(one.name))
    path = title[len(topic.name) + 1 :]
    if path not in topic.columns:
        raise InvalidInputError(
            f"column {title}: messages of {topic.name} ({topic.schema}) have no number {path}"
            f"{did_you_mean(path, topic.columns)}"
        )
    return topic
