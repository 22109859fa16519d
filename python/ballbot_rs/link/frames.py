"""Frames as bytes: header, numbers and checksum, stuffed by COBS so that a zero ends them (`layout` has the bytes)."""

import functools
import struct
import zlib
from typing import Any, Final, NamedTuple

from ballbot_rs._extras import require
from ballbot_rs.link.layout import CHECKSUM, END, HEADER, LONGEST, PAYLOADS, VERSION, Kind, format_of, size_of

_HEADER: Final = struct.Struct(format_of(HEADER))
_CHECKSUM: Final = struct.Struct(format_of((CHECKSUM,)))
_FORMATS: Final = {kind: struct.Struct(format_of((*HEADER, *fields))) for kind, fields in PAYLOADS.items()}
_SIZES: Final[dict[int, int]] = {kind: size_of(kind) for kind in Kind}

#: Numbers of the header wrap here.
WRAP: Final = 2**32


class Frame(NamedTuple):
    """What one frame carries."""

    kind: Kind
    flags: int
    #: Modulo `WRAP`.
    sequence: int
    #: Clock of the simulation, µs, modulo `WRAP`.
    time: int
    #: In the order of `layout.PAYLOADS`.
    numbers: tuple[float, ...]


@functools.cache
def cobs_library() -> Any:
    """The library of COBS.

    Raises:
        ModuleNotFoundError: it is not installed; the message has the command that installs it.
    """
    with require("the link", "link"):
        from cobs import cobs
    return cobs


class FrameError(Exception):
    """Bytes that are not a frame; `count` names the count of them, as in `Statistics`."""

    def __init__(self, count: str, version: int = VERSION) -> None:
        super().__init__(count)
        self.count = count
        #: Of the frame, which is whole if it is another one.
        self.version = version


def encode(frame: Frame) -> bytes:
    """A frame as it goes over the wire, with the zero that ends it."""
    head = (VERSION, frame.kind, frame.flags, frame.sequence % WRAP, frame.time % WRAP)
    packed = _FORMATS[frame.kind].pack(*head, *frame.numbers)
    stuffed: bytes = cobs_library().encode(packed + _CHECKSUM.pack(zlib.crc32(packed)))
    return stuffed + END


def decode(stuffed: bytes) -> Frame:
    """The frame in bytes from the wire, without the zero.

    Raises:
        FrameError: "broken" (wrong COBS code or length), "corrupted" (wrong checksum) or "unknown" (another version or
            kind).
    """
    cobs = cobs_library()
    try:
        whole: bytes = cobs.decode(stuffed)
    except cobs.DecodeError as error:
        raise FrameError("broken") from error
    packed, checksum = whole[: -_CHECKSUM.size], whole[-_CHECKSUM.size :]
    if len(packed) < _HEADER.size:
        raise FrameError("broken")
    if _CHECKSUM.unpack(checksum)[0] != zlib.crc32(packed):
        raise FrameError("corrupted")
    version, kind = packed[:2]
    if version != VERSION or _SIZES.get(kind) != len(whole):
        raise FrameError("unknown", version)
    _, _, flags, sequence, time, *numbers = _FORMATS[Kind(kind)].unpack(packed)
    return Frame(Kind(kind), flags, sequence, time, tuple(numbers))


class Splitter:
    """Cuts a stream of bytes at its zeros. The start of the stream counts as the end of a frame."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, received: bytes) -> list[bytes]:
        """The stuffed frames that these bytes complete, without their zeros; an overlong one is cut, hence broken."""
        *complete, begun = (self._begun + received).split(END)
        self._begun = begun[:LONGEST]
        return [stuffed[:LONGEST] for stuffed in complete if stuffed]
