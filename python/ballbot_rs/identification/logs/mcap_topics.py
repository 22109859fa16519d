"""Numbers of the messages in an MCAP file: ROS 2 messages in CDR, and JSON."""

import array
import dataclasses
import io
import json
import math
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._errors import InvalidInputError
from ballbot_rs._extras import require
from ballbot_rs.identification.logs.tables import MAX_LOG_FILE

Array = npt.NDArray[np.float64]

#: Most numbers of a topic that are read, longest array of a message, and deepest nesting.
MAX_COLUMNS: Final = 256
MAX_ARRAY: Final = 64
MAX_DEPTH: Final = 8
#: Most bytes of all chunks when unpacked.
MAX_UNPACKED: Final = 4 * MAX_LOG_FILE


@dataclasses.dataclass
class Topic:
    """Messages of a topic as columns."""

    name: str
    schema: str
    #: Of each message: the stamp of its header, 0 without one, and the time it was logged, ns.
    stamps: list[int] = dataclasses.field(default_factory=list)
    logged: list[int] = dataclasses.field(default_factory=list)
    #: By path within the message, as `angular_velocity.x`, or `position.NAME` of a joint; NaN where there is no number.
    columns: dict[str, "array.array[float]"] = dataclasses.field(default_factory=dict)

    def add(self, stamp: int, logged: int, numbers: Mapping[str, float]) -> None:
        """Adds a message."""
        rows = self.rows
        for name, value in numbers.items():
            if name not in self.columns:
                if len(self.columns) == MAX_COLUMNS:
                    raise InvalidInputError(f"{self.name} has more than {MAX_COLUMNS} numbers a message, the limit")
                self.columns[name] = array.array("d", [math.nan]) * rows
            self.columns[name].append(value)
        self.stamps.append(stamp)
        self.logged.append(logged)
        for column in self.columns.values():
            if len(column) == rows:
                column.append(math.nan)

    @property
    def rows(self) -> int:
        """Number of messages."""
        return len(self.stamps)

    @property
    def first(self) -> int:
        """The first time of a message, ns."""
        return min(filter(None, self.stamps), default=min(self.logged))

    def times(self, origin: int) -> Array:
        """Times of the messages after an origin, s: stamps of their headers, or log times if all stamps are zero.

        A message without a stamp among others is NaN: the log time has another clock.
        """
        chosen = self.stamps if any(self.stamps) else self.logged
        is_known = np.array([bool(one) for one in self.stamps]) | (chosen is self.logged)
        # Differences of integers are exact; nanoseconds since 1970 as a double are not.
        time = np.array([stamp - origin for stamp in chosen], dtype=np.float64) * 1e-9
        return np.asarray(np.where(is_known, time, np.nan))


def read_topics(contents: bytes, wanted: Callable[[str, str, str], bool]) -> dict[str, Topic]:
    """The topics of a file, by name; topics without a wanted number have no messages.

    Args:
        contents: of the file.
        wanted: whether a number is read, by topic, name of the message's schema, and path within the message; the
            path is empty where the question is whether any is.

    Raises:
        ValueError: a broken or truncated file, or more data than the limits.
        ModuleNotFoundError: a library is missing.
    """
    with require("an MCAP file", "mcap"):
        from mcap.exceptions import McapError
        from mcap_ros2.decoder import DecoderFactory
    topics: dict[str, Topic] = {}
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    factory = DecoderFactory()
    try:
        for record in _records(contents):
            kind = type(record).__name__
            if kind == "Schema":
                schemas[record.id] = record
            elif kind == "Channel":
                schema = schemas.get(record.schema_id)
                channels[record.id] = record, schema, _decoder(record, schema, factory)
                topics.setdefault(record.topic, Topic(record.topic, schema.name if schema else ""))
            elif kind == "Message":
                if record.channel_id not in channels:
                    raise InvalidInputError(f"a message of channel {record.channel_id}, which the file lacks")
                channel, _, decode = channels[record.channel_id]
                topic = topics[channel.topic]
                if decode is not None and wanted(topic.name, topic.schema, ""):
                    _add(topic, record, decode, wanted)
    except InvalidInputError:
        raise
    except McapError as error:
        raise InvalidInputError(_broken(error)) from error
    except (ValueError, TypeError, LookupError, AttributeError, RuntimeError, ArithmeticError, struct.error) as error:
        raise InvalidInputError(_broken(error)) from error
    return topics


def _broken(error: Exception) -> str:
    why = str(error) or type(error).__name__
    return f"the file is truncated or broken ({why}): the command `mcap recover` writes its readable messages to a file"


def _add(topic: Topic, record: Any, decode: Callable[[bytes], Any], wanted: Callable[[str, str, str], bool]) -> None:
    message = decode(record.data)
    numbers = {path: value for path, value in flattened(message) if path and wanted(topic.name, topic.schema, path)}
    topic.add(_stamp(topic.name, message), int(record.log_time), numbers)


def _records(contents: bytes) -> Iterator[Any]:
    """Schemas, channels and messages, chunk by chunk, so that no chunk takes more memory than it declares."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    unpacked = 0
    for record in StreamReader(io.BytesIO(contents), emit_chunks=True, record_size_limit=MAX_LOG_FILE).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        unpacked += record.uncompressed_size
        if unpacked > MAX_UNPACKED:
            raise InvalidInputError(
                f"more than {MAX_UNPACKED} bytes when unpacked, the limit: `mcap filter` writes only some topics"
            )
        yield from breakup_chunk(_plain(record), validate_crc=True)


def _plain(chunk: Any) -> Any:
    """The chunk without compression: at most the bytes that it declares."""
    if not chunk.compression:
        return chunk
    if chunk.compression == "zstd":
        import zstandard

        try:
            data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(chunk.uncompressed_size)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    elif chunk.compression == "lz4":
        import lz4.frame

        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=chunk.uncompressed_size)
    else:
        raise InvalidInputError(f"a chunk is compressed by {chunk.compression!r}, expected zstd or lz4")
    return dataclasses.replace(chunk, compression="", data=data)


def _decoder(channel: Any, schema: Any, factory: Any) -> Callable[[bytes], Any] | None:
    """The function that decodes messages of a channel; None for other encodings."""
    if channel.message_encoding == "json":
        return json.loads
    found: Callable[[bytes], Any] | None = None
    if channel.message_encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
        # Schemas of topics that nobody reads may be beyond the parser.
        cell: list[Any] = []

        def found(data: bytes) -> Any:
            if not cell:
                cell.append(factory.decoder_for(channel.message_encoding, schema))
            return cell[0](data)

    return found


def _part(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def _stamp(topic: str, message: Any) -> int:
    """The stamp of a message's header, ns; 0 if it has none."""
    stamp = _part(_part(message, "header"), "stamp")
    if stamp is None:
        return 0
    parts = [_part(stamp, name) for name in ("sec", "nanosec")]
    if not all(isinstance(one, int) and not isinstance(one, bool) for one in parts):
        given = ", ".join(f"{name} = {one!r}" for name, one in zip(("sec", "nanosec"), parts, strict=True))
        shown = given if any(one is not None for one in parts) else f"{stamp!r}"
        raise InvalidInputError(f"a header.stamp of {topic} is {shown:.80}: expected whole numbers sec and nanosec")
    return int(parts[0]) * 10**9 + int(parts[1])


def flattened(message: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Paths and numbers of a message; arrays of joints have the names of the joints."""
    if isinstance(message, bool):
        return
    if isinstance(message, (int, float)):
        yield path, float(message)
        return
    if depth == MAX_DEPTH:
        return
    if isinstance(message, (list, tuple, array.array)):
        parts: Any = enumerate(message) if len(message) <= MAX_ARRAY else ()
    elif isinstance(message, Mapping):
        parts = message.items()
    elif fields := getattr(type(message), "__slots__", ()):
        parts = [(name, getattr(message, name)) for name in fields]
    else:
        return
    names = None if path else _part(message, "name")
    for name, part in parts:
        inner = f"{path}.{name}" if path else str(name)
        if isinstance(names, (list, tuple)) and isinstance(part, (list, tuple, array.array)) and name != "name":
            if len(part) == len(names):
                yield from ((f"{inner}.{joint}", float(value)) for joint, value in zip(names, part, strict=True))
            continue
        yield from flattened(part, inner, depth + 1)
