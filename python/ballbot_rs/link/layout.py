"""The frames of the link between a simulation and a controller: the one description of their bytes.

The struct formats of the peer in Python (`frames`), the C99 header (`ballbot_rs.deployment.link_header`) and the tables
of docs/link.md follow from it.
"""

import enum
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

#: Of this layout; the first byte of a frame.
VERSION: Final = 2

#: Readings with RESET that are at most as far behind the last readings are late, others are of a new simulation.
LATE: Final = 1024

#: Ends every frame on the wire, and is in none of them.
END: Final = b"\x00"


class Field(NamedTuple):
    """Numbers of one type in a frame."""

    name: str
    #: As of `struct`: B, H and I are unsigned integers of 1, 2 and 4 bytes, d is a float of 8 bytes.
    type: str
    length: int
    unit: str
    doc: str

    @property
    def size(self) -> int:
        """Bytes."""
        return self.length * struct.calcsize(f"<{self.type}")


class Kind(enum.IntEnum):
    """What a frame is."""

    READINGS = 1
    TORQUES = 2


class Flag(enum.IntFlag):
    """Flags of READINGS."""

    #: A new episode: the first reading of a robot at rest. The controller clears its memory and begins its estimator.
    RESET = 1
    #: The simulation ends; the controller may leave.
    STOP = 2


class Status(enum.IntEnum):
    """Status of the controller, the low byte of the flags of TORQUES."""

    RUNNING = 0
    #: It has not begun: there was no RESET since it was started.
    STARTING = 1
    #: Readings are not finite.
    NOT_FINITE = 2
    #: Watchdog: readings are stale.
    STALE = 3
    #: A limit was exceeded; the torques are zero.
    LIMIT = 4


HEADER: Final = (
    Field("version", "B", 1, "", f"version of the layout, {VERSION}"),
    Field("kind", "B", 1, "", "1 READINGS, 2 TORQUES"),
    Field("flags", "H", 1, "", "READINGS: bit 0 RESET, bit 1 STOP; TORQUES: status in the low byte"),
    Field("sequence", "I", 1, "", "number of the readings; torques repeat the number that they answer"),
    Field("time", "I", 1, "µs", "clock of the simulation, which wraps after 71.6 min; torques repeat it likewise"),
)

READINGS: Final = (
    Field("gyro", "d", 3, "rad/s", "gyroscope, body frame"),
    Field("specific_force", "d", 3, "m/s²", "accelerometer, body frame"),
    Field("wheel_angles", "d", 3, "rad", "encoders, since the start of the episode"),
    Field("position", "d", 2, "m", "setpoint of the ball, inertial frame"),
    Field("velocity", "d", 2, "m/s", "setpoint of its velocity, inertial frame"),
    Field("yaw", "d", 1, "rad", "setpoint of the heading"),
    Field("yaw_rate", "d", 1, "rad/s", "setpoint of its rate"),
    Field("acceleration", "d", 2, "m/s²", "of the setpoint's motion, inertial frame, else zero"),
    Field("jerk", "d", 2, "m/s³", "its derivative"),
    Field("snap", "d", 2, "m/s⁴", "the derivative of the jerk"),
)

TORQUES: Final = (Field("torques", "d", 3, "N·m", "of the wheels, for the next control step"),)

#: Fields after the header, by kind.
PAYLOADS: Final = {Kind.READINGS: READINGS, Kind.TORQUES: TORQUES}

#: CRC-32 of IEEE 802.3, as `zlib.crc32`, of header and payload.
CHECKSUM: Final = Field("crc", "I", 1, "", "CRC-32 of header and payload, as `zlib.crc32`")


def format_of(fields: Sequence[Field]) -> str:
    """The format of `struct` for fields, little-endian without padding."""
    return "<" + "".join(f"{field.length}{field.type}" for field in fields)


def size_of(kind: Kind) -> int:
    """Bytes of a frame with its checksum, before COBS."""
    return sum(field.size for field in (*HEADER, *PAYLOADS[kind], CHECKSUM))


def wire_size_of(kind: Kind) -> int:
    """Bytes of a frame on the wire: COBS adds one byte to frames below 255 bytes, and `END` is another."""
    return size_of(kind) + 2


#: Bytes of the longest frame on the wire.
LONGEST: Final = max(map(wire_size_of, Kind))
