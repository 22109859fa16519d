import itertools
import struct
import zlib

import numpy as np
import pytest
from cobs import cobs

from ballbot_rs.link.frames import WRAP, Frame, FrameError, Splitter, decode, encode
from ballbot_rs.link.layout import LONGEST, Kind, Status, size_of, wire_size_of

#: Torques (1, -2, 0.5) N·m with sequence 7 at 20 ms, status "starting", written out by hand.
TORQUES = Frame(Kind.TORQUES, int(Status.STARTING), 7, 20_000, (1.0, -2.0, 0.5))
HEADER = "02 02 0100 07000000 204e0000"
PAYLOAD = "000000000000f03f 00000000000000c0 000000000000e03f"
CHECKSUM = "36c31761"
#: The same on the wire: a number in place of each zero, the distance to the next, and one before all.
WIRE = """
04 020201  02 07  01  01  03 204e  01 01 01 01 01 01 01
03 f03f  01 01 01 01 01 01  02 c0  01 01 01 01 01  07 e03f 36c31761  00
"""


def readings(seed=0):
    numbers = np.random.default_rng(seed).normal(size=21)
    return Frame(Kind.READINGS, 1, 2**32 - 1, 123_456, tuple(numbers.tolist()))


def test_golden_bytes_of_a_frame():
    assert zlib.crc32(bytes.fromhex(HEADER + PAYLOAD)) == int.from_bytes(bytes.fromhex(CHECKSUM), "little")
    assert encode(TORQUES) == bytes.fromhex(WIRE)
    assert decode(bytes.fromhex(WIRE)[:-1]) == TORQUES


def test_sizes_are_the_documented_sizes():
    assert (size_of(Kind.READINGS), size_of(Kind.TORQUES), LONGEST) == (184, 40, 186)
    assert [len(encode(frame)) for frame in (readings(), TORQUES)] == list(map(wire_size_of, Kind)) == [186, 42]


@pytest.mark.parametrize("number", [0.0, -0.0, 5e-324, 1.7e308, float("inf"), 1 / 3])
def test_frames_return_bit_for_bit(number):
    frame = readings()._replace(numbers=(number,) * 21)
    found = decode(encode(frame)[:-1])
    assert struct.pack("<21d", *found.numbers) == struct.pack("<21d", *frame.numbers)
    assert found[:4] == frame[:4]


def test_not_a_number_returns():
    numbers = decode(encode(TORQUES._replace(numbers=(float("nan"), 0.0, 0.0)))[:-1]).numbers
    assert np.isnan(numbers[0])


def test_sequence_and_time_wrap():
    frame = TORQUES._replace(sequence=WRAP + 3, time=WRAP + 4)
    assert decode(encode(frame)[:-1]) == TORQUES._replace(sequence=3, time=4)


@pytest.mark.parametrize("frame", [TORQUES, readings()])
def test_every_flipped_bit_is_detected(frame):
    wire = encode(frame)
    for bit in range(8 * len(wire)):
        changed = bytearray(wire)
        changed[bit // 8] ^= 1 << bit % 8
        # A flip may make a zero, which cuts the frame, or remove the last.
        for stuffed in Splitter().feed(bytes(changed) + b"\0"):
            with pytest.raises(FrameError) as error:
                decode(stuffed)
            assert error.value.count in ("broken", "corrupted")


@pytest.mark.parametrize("frame", [TORQUES, readings()])
def test_every_truncation_is_detected(frame):
    wire = encode(frame)
    for length in range(1, len(wire) - 1):
        for part in (wire[:length], wire[-1 - length : -1]):
            with pytest.raises(FrameError, match=r"broken|corrupted"):
                decode(part)


@pytest.mark.parametrize(("place", "value"), [(0, 1), (0, 3), (1, 3), (1, 0)])
def test_another_version_or_kind_is_unknown(place, value):
    packed = bytearray(cobs.decode(encode(TORQUES)[:-1])[:-4])
    packed[place] = value
    with pytest.raises(FrameError, match="unknown"):
        decode(cobs.encode(bytes(packed) + struct.pack("<I", zlib.crc32(packed))))


def test_kind_of_another_length_is_unknown():
    packed = cobs.decode(encode(TORQUES)[:-1])[:-4] + b"\0"
    with pytest.raises(FrameError, match="unknown"):
        decode(cobs.encode(packed + struct.pack("<I", zlib.crc32(packed))))


def test_stream_in_pieces_of_any_length():
    frames = [readings(seed) for seed in range(5)]
    stream = b"".join(map(encode, frames))
    for length in (1, 2, 7, 185, 186, 187, len(stream)):
        splitter = Splitter()
        pieces = [stream[i : i + length] for i in range(0, len(stream), length)]
        found = itertools.chain.from_iterable(map(splitter.feed, pieces))
        assert [decode(stuffed) for stuffed in found] == frames


def test_stream_resynchronizes_after_noise_at_the_next_zero():
    rng = np.random.default_rng(0)
    noise = bytes(rng.integers(0, 256, 10_000).tolist())
    splitter = Splitter()
    splitter.feed(noise)
    splitter.feed(b"\0")
    (stuffed,) = splitter.feed(encode(readings()))
    assert decode(stuffed) == readings()


def test_stream_without_zeros_needs_no_memory():
    splitter = Splitter()
    for _ in range(1000):
        assert splitter.feed(b"\x01" * 1000) == []
    (stuffed,) = splitter.feed(b"\0")
    assert len(stuffed) <= LONGEST
    with pytest.raises(FrameError):
        decode(stuffed)
