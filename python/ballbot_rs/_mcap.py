"""MCAP logs with JSON messages."""

import json
from collections.abc import Mapping
from typing import IO, Any, Final

from ballbot_rs._core import __version__
from ballbot_rs._extras import require

#: A schema of a number.
NUMBER: Final = {"type": "number"}


class McapWriter:
    """Writes messages of topics into an open file.

    Raises:
        ModuleNotFoundError: mcap is not installed.
    """

    def __init__(self, file: IO[bytes]) -> None:
        with require("an MCAP file", "mcap"):
            from mcap.writer import CompressionType, Writer
        # Compressed chunks need more packages; a file of some MB does without.
        self._writer = Writer(file, compression=CompressionType.NONE)
        self._writer.start(profile="", library=f"ballbot_rs {__version__}")

    def channel(self, topic: str, name: str, schema: Mapping[str, Any]) -> int:
        """A new topic of messages with a JSON schema; its number."""
        schema_id = self._writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        number: int = self._writer.register_channel(topic, "json", schema_id)
        return number

    def add(self, channel: int, nanoseconds: int, message: Mapping[str, Any]) -> None:
        """Adds a message."""
        data = json.dumps(message, allow_nan=False).encode()
        self._writer.add_message(channel, log_time=nanoseconds, data=data, publish_time=nanoseconds)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Ends the file, with metadata."""
        self._writer.add_metadata("ballbot", dict(metadata))
        self._writer.finish()


def object_schema(properties: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """The schema of an object."""
    return {"type": "object", "properties": dict(properties), **more}
