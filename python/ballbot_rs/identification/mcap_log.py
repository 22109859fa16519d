"""Series of an MCAP file: topics by their message types, or columns that a map names."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.identification.column_map import ColumnMap
from ballbot_rs.identification.mcap_topics import Topic, read_topics
from ballbot_rs.identification.recording import Series, checked

Array = npt.NDArray[np.float64]

IMU: Final = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
JOINTS: Final = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
#: Quantities of an IMU.
_OF_IMU: Final = {"gyro": "angular_velocity", "accelerations": "linear_acceleration"}
#: Quantities of joints.
_OF_JOINTS: Final = {"wheel_angles": "position", "torques": "effort"}
#: Quantities of a file of `Trajectory.to_mcap`: schema and field.
_OF_TRAJECTORY: Final = {
    "torques": ("ballbot.torque", "wheel_torque", "012"),
    "wheel_angles": ("ballbot.state", "wheel_angles", "012"),
    "gyro": ("ballbot.state", "body_angular_velocity", "xyz"),
}
_FIELDS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(IMU, tuple(_OF_IMU.values())),
    **dict.fromkeys(JOINTS, tuple(_OF_JOINTS.values())),
    "ballbot.torque": ("wheel_torque",),
    "ballbot.state": ("wheel_angles", "body_angular_velocity"),
}


def read_mcap(contents: bytes, columns: ColumnMap | None) -> dict[str, Series]:
    """The series of a file.

    Args:
        contents: of the file.
        columns: names numbers by topic and path, `/imu.angular_velocity.x`; None takes the only topic of IMU messages
            and the only topic of joint states, with three joints in the order of their names, or what
            `Trajectory.to_mcap` wrote.

    Raises:
        ValueError: a broken file, a missing topic or number, several topics of a type, or as `checked`.
        ModuleNotFoundError: a library is missing.
    """
    if columns is None:
        topics = read_topics(contents, _is_default)
        return _of_robot(topics) if _of_type(topics, (*IMU, *JOINTS)) else _of_trajectory(topics)
    for title in columns.times.values():
        raise InvalidInputError(f"time column {title}: messages have the time of their header, or of the log")
    names = columns.names
    topics = read_topics(
        contents,
        lambda topic, _, path: (
            f"{topic}.{path}" in names if path else any(one.startswith(f"{topic}.") for one in names)
        ),
    )
    found, origin = {}, _origin(topics)
    for name, titles in columns.columns.items():
        owners = {_owner(title, topics).name for title in titles}
        if len(owners) > 1:
            raise InvalidInputError(f"{name} has numbers of several topics: {', '.join(sorted(owners))}")
        topic = topics[owners.pop()]
        paths = [title[len(topic.name) + 1 :] for title in titles]
        found[name] = _series(topic, paths, topic.name, origin, columns.scale[name])
    return found


def _is_default(_: str, schema: str, path: str) -> bool:
    fields = _FIELDS.get(schema, ())
    return bool(fields) if not path else path.split(".")[0] in fields


def _of_type(topics: Mapping[str, Topic], types: tuple[str, ...]) -> list[Topic]:
    return [topic for topic in topics.values() if topic.schema in types and topic.stamps]


def _only(topics: Mapping[str, Topic], types: tuple[str, ...]) -> Topic:
    found = _of_type(topics, types)
    if len(found) != 1:
        names = ", ".join(f"{one.name} ({one.schema or 'no schema'})" for one in topics.values()) or "none"
        which = "no topic has" if not found else f"{len(found)} topics have"
        raise InvalidInputError(f"{which} messages {types[0]}; topics: {names}; name numbers by a column map")
    return found[0]


def _of_robot(topics: Mapping[str, Topic]) -> dict[str, Series]:
    imu, joints = _only(topics, IMU), _only(topics, JOINTS)
    names = sorted(path.partition(".")[2] for path in joints.columns if path.startswith("position."))
    if len(names) != 3:
        raise InvalidInputError(
            f"{joints.name} has positions of {len(names)} joints, {', '.join(names)}, expected three wheels; name "
            "theirs by a column map"
        )
    if not any(path.startswith("effort.") for path in joints.columns):
        raise InvalidInputError(f"{joints.name} has no effort; name the torques by a column map")
    origin = _origin(topics)
    found = {
        name: _series(joints, [f"{field}.{joint}" for joint in names], joints.name, origin)
        for name, field in _OF_JOINTS.items()
    }
    for name, field in _OF_IMU.items():
        if name == "gyro" or _is_measured(imu, field):
            found[name] = _series(imu, [f"{field}.{axis}" for axis in "xyz"], imu.name, origin)
    return found


def _is_measured(topic: Topic, field: str) -> bool:
    """Whether the numbers of a field are not all zero, as an IMU sends what it does not measure."""
    return any(any(topic.columns.get(f"{field}.{axis}", ())) for axis in "xyz")


def _of_trajectory(topics: Mapping[str, Topic]) -> dict[str, Series]:
    found, origin = {}, _origin(topics)
    for name, (schema, field, axes) in _OF_TRAJECTORY.items():
        # A simulation has one clock.
        found[name] = _series(_only(topics, (schema,)), [f"{field}.{axis}" for axis in axes], "simulation", origin)
    return found


def _owner(title: str, topics: Mapping[str, Topic]) -> Topic:
    """The topic that a column belongs to: the longest whose name begins it."""
    owners = [topic for topic in topics.values() if title.startswith(f"{topic.name}.")]
    if not owners:
        raise InvalidInputError(f"column {title}: no topic begins so; there are {', '.join(topics) or 'none'}")
    topic = max(owners, key=lambda one: len(one.name))
    path = title[len(topic.name) + 1 :]
    if path not in topic.columns:
        raise InvalidInputError(
            f"column {title}: messages of {topic.name} ({topic.schema}) have no number {path}"
            f"{did_you_mean(path, topic.columns)}"
        )
    return topic


def _origin(topics: Mapping[str, Topic]) -> int:
    """The first stamp of all, ns."""
    return min((min(topic.stamps) for topic in topics.values() if topic.stamps), default=0)


def _series(topic: Topic, paths: list[str], clock: str, origin: int, scale: Array | float = 1.0) -> Series:
    if missing := [path for path in paths if path not in topic.columns]:
        raise InvalidInputError(f"messages of {topic.name} ({topic.schema}) have no number {', '.join(missing)}")
    # Differences of integers are exact; nanoseconds since 1970 as a double are not.
    time = np.array([stamp - origin for stamp in topic.stamps], dtype=np.float64) * 1e-9
    values = np.stack([np.array(topic.columns[path]) for path in paths], axis=-1) * scale
    return checked(f"{topic.name} {', '.join(paths)}", clock, time, values)
