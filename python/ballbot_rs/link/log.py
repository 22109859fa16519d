"""The exchange of a link as an MCAP file with JSON messages, by the time of the computer's clock."""

import contextlib
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _files
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._mcap import NUMBER, McapWriter, object_schema
from ballbot_rs.link.frames import Frame
from ballbot_rs.link.layout import READINGS, TORQUES, Field
from ballbot_rs.link.statistics import Statistics

_INTEGER: Final = {"type": "integer"}
_TEXT: Final = {"type": "string"}
_HEADER: Final = {
    "sequence": _INTEGER,
    "time": {**_INTEGER, "description": "clock of the simulation, µs"},
    "flags": _INTEGER,
}


def _schema_of(field: Field) -> dict[str, Any]:
    doc = {"description": f"{field.doc}, {field.unit}"}
    return {**NUMBER, **doc} if field.length == 1 else {"type": "array", "items": NUMBER, **doc}


#: Schemas of the messages, by topic.
_TOPICS: Final = {
    "readings": {**_HEADER, "repetition": _INTEGER, **{field.name: _schema_of(field) for field in READINGS}},
    "torques": {
        **_HEADER,
        "fate": {**_TEXT, "description": "accepted, late or duplicated"},
        **{field.name: _schema_of(field) for field in TORQUES},
    },
    "rejected": {
        "reason": {**_TEXT, "description": "broken, corrupted or unknown"},
        "bytes": {**_TEXT, "description": "as they came, hexadecimal, without the zero that ends them"},
    },
    "missed": {**_HEADER, "torques": {**_TEXT, "description": "held or zeroed"}},
}


def check_file(path: Path) -> None:
    """Raises ValueError for a name that does not end in .mcap."""
    if path.suffix != ".mcap":
        raise InvalidInputError(f"{path}: the name of the file must end in .mcap")


class ExchangeLog:
    """A file, which is complete once it is closed.

    Raises:
        ModuleNotFoundError: mcap is not installed.
        OSError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        with contextlib.ExitStack() as stack:
            unfinished = stack.enter_context(_files.replacing(path))
            self._writer = McapWriter(stack.enter_context(unfinished.open("wb")))
            self._stack = stack.pop_all()
        self._channels = {
            topic: self._writer.channel(f"/link/{topic}", f"ballbot.link.{topic}", object_schema(schema))
            for topic, schema in _TOPICS.items()
        }
        self._begin = time.time_ns() - time.perf_counter_ns()

    def sent(self, frame: Frame, repetition: int) -> None:
        """Readings that were sent."""
        self._add("readings", {**_head(frame), "repetition": repetition, **_numbers(frame, READINGS)})

    def received(self, frame: Frame, fate: str) -> None:
        """Torques that were received."""
        self._add("torques", {**_head(frame), "fate": fate, **_numbers(frame, TORQUES)})

    def rejected(self, stuffed: bytes, reason: str) -> None:
        """Bytes that are not a frame."""
        self._add("rejected", {"reason": reason, "bytes": stuffed.hex()})

    def missed(self, frame: Frame, torques: str) -> None:
        """Readings without an answer in time, and what the robot got."""
        self._add("missed", {**_head(frame), "torques": torques})

    def close(self, statistics: Statistics) -> None:
        """Ends the file."""
        with self._stack:
            self._writer.finish({"statistics": json.dumps(statistics.report())})

    def _add(self, topic: str, message: dict[str, Any]) -> None:
        self._writer.add(self._channels[topic], self._begin + time.perf_counter_ns(), message)


def _head(frame: Frame) -> dict[str, Any]:
    return {"sequence": frame.sequence, "time": frame.time, "flags": frame.flags}


def _numbers(frame: Frame, fields: Sequence[Field]) -> dict[str, Any]:
    """The numbers by field; JSON has no NaN and no infinity, they are null."""
    left = [number if math.isfinite(number) else None for number in frame.numbers]
    named: dict[str, Any] = {}
    for field in fields:
        part, left = left[: field.length], left[field.length :]
        named[field.name] = part[0] if field.length == 1 else part
    return named
