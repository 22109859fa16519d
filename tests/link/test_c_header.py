import ctypes
import struct
import zlib

import numpy as np
import pytest
from cobs import cobs

from ballbot_rs.deployment import link_header
from ballbot_rs.link.frames import Frame, encode
from ballbot_rs.link.layout import LATE, LONGEST, READINGS, Flag, Kind, Status
from tests.support.c_code import compiled

#: The header behind plain arrays: integers are flags, sequence and time.
SOURCE = """
#include "{folder}/link.h"

static ballbot_link_decoder decoder;

void begin(void);
int feed(const uint8_t *bytes, int count, uint8_t *kinds);
void counts(uint32_t *to);
void readings(uint32_t *integers, double *numbers);
void torques(uint32_t *integers, double *numbers);
int order(uint32_t last, uint32_t flags, uint32_t sequence);
int encode_readings(const uint32_t *integers, const double *numbers, uint8_t *frame);
int encode_torques(const uint32_t *integers, const double *numbers, uint8_t *frame);

void begin(void)
{{
    static const ballbot_link_decoder start = {{{{0}}, 0, 0, 0, 0, 0}};
    decoder = start;
}}

int feed(const uint8_t *bytes, int count, uint8_t *kinds)
{{
    int found = 0;
    int i;
    for (i = 0; i < count; i++) {{
        const int kind = ballbot_link_feed(&decoder, bytes[i]);
        if (kind != 0) {{
            kinds[found++] = (uint8_t)kind;
        }}
    }}
    return found;
}}

void counts(uint32_t *to)
{{
    to[0] = decoder.frames;
    to[1] = decoder.broken;
    to[2] = decoder.corrupted;
    to[3] = decoder.unknown;
}}

void readings(uint32_t *integers, double *numbers)
{{
    ballbot_link_readings found;
    ballbot_link_decode_readings(&decoder, &found);
    integers[0] = found.flags;
    integers[1] = found.sequence;
    integers[2] = found.time;
    memcpy(numbers, found.gyro, sizeof found.gyro);
    memcpy(numbers + 3, found.specific_force, sizeof found.specific_force);
    memcpy(numbers + 6, found.wheel_angles, sizeof found.wheel_angles);
    memcpy(numbers + 9, found.position, sizeof found.position);
    memcpy(numbers + 11, found.velocity, sizeof found.velocity);
    numbers[13] = found.yaw;
    numbers[14] = found.yaw_rate;
    memcpy(numbers + 15, found.acceleration, sizeof found.acceleration);
    memcpy(numbers + 17, found.jerk, sizeof found.jerk);
    memcpy(numbers + 19, found.snap, sizeof found.snap);
}}

void torques(uint32_t *integers, double *numbers)
{{
    ballbot_link_torques found;
    ballbot_link_decode_torques(&decoder, &found);
    integers[0] = found.flags;
    integers[1] = found.sequence;
    integers[2] = found.time;
    memcpy(numbers, found.torques, sizeof found.torques);
}}

int order(uint32_t last, uint32_t flags, uint32_t sequence)
{{
    ballbot_link_torques answer = {{0}};
    ballbot_link_readings readings = {{0}};
    answer.sequence = last;
    readings.flags = (uint16_t)flags;
    readings.sequence = sequence;
    return ballbot_link_order(&answer, &readings);
}}

int encode_readings(const uint32_t *integers, const double *numbers, uint8_t *frame)
{{
    ballbot_link_readings sent;
    sent.flags = (uint16_t)integers[0];
    sent.sequence = integers[1];
    sent.time = integers[2];
    memcpy(sent.gyro, numbers, sizeof sent.gyro);
    memcpy(sent.specific_force, numbers + 3, sizeof sent.specific_force);
    memcpy(sent.wheel_angles, numbers + 6, sizeof sent.wheel_angles);
    memcpy(sent.position, numbers + 9, sizeof sent.position);
    memcpy(sent.velocity, numbers + 11, sizeof sent.velocity);
    sent.yaw = numbers[13];
    sent.yaw_rate = numbers[14];
    memcpy(sent.acceleration, numbers + 15, sizeof sent.acceleration);
    memcpy(sent.jerk, numbers + 17, sizeof sent.jerk);
    memcpy(sent.snap, numbers + 19, sizeof sent.snap);
    return ballbot_link_encode_readings(&sent, frame);
}}

int encode_torques(const uint32_t *integers, const double *numbers, uint8_t *frame)
{{
    ballbot_link_torques sent;
    sent.flags = (uint16_t)integers[0];
    sent.sequence = integers[1];
    sent.time = integers[2];
    memcpy(sent.torques, numbers, sizeof sent.torques);
    return ballbot_link_encode_torques(&sent, frame);
}}
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("link")
    (folder / "link.h").write_text(link_header(), encoding="ascii")
    return compiled(folder, SOURCE.format(folder=folder))


def fed(library, stream):
    """Kinds of the frames that end in a stream, after the start."""
    library.begin()
    kinds = ctypes.create_string_buffer(len(stream) + 1)
    count = library.feed(stream, len(stream), kinds)
    return list(kinds.raw[:count])


def counted(library):
    counts = (ctypes.c_uint32 * 4)()
    library.counts(counts)
    return dict(zip(("frames", "broken", "corrupted", "unknown"), counts, strict=True))


def frames(kind, count=200):
    """Frames of any bits, zeros among them."""
    rng = np.random.default_rng(kind)
    size = 21 if kind == Kind.READINGS else 3
    for _ in range(count):
        packed = bytes((rng.integers(0, 256, 8 * size) * rng.integers(0, 2, 8 * size)).tolist())
        integers = [int(rng.integers(2**bits)) for bits in (16, 32, 32)]
        yield Frame(kind, *integers, struct.unpack(f"<{size}d", packed))


def bits(frame):
    return frame[:4], struct.pack(f"<{len(frame.numbers)}d", *frame.numbers)


@pytest.mark.parametrize("kind", list(Kind))
def test_c_reads_what_python_writes(library, kind):
    read = library.readings if kind == Kind.READINGS else library.torques
    for frame in frames(kind):
        assert fed(library, encode(frame)) == [kind]
        integers, numbers = (ctypes.c_uint32 * 3)(), (ctypes.c_double * len(frame.numbers))()
        read(integers, numbers)
        assert bits(Frame(kind, *integers, tuple(numbers))) == bits(frame)


@pytest.mark.parametrize("kind", list(Kind))
def test_c_writes_the_bytes_of_python(library, kind):
    write = library.encode_readings if kind == Kind.READINGS else library.encode_torques
    for frame in frames(kind):
        buffer = ctypes.create_string_buffer(LONGEST)
        numbers = (ctypes.c_double * len(frame.numbers))(*frame.numbers)
        length = write((ctypes.c_uint32 * 3)(*frame[1:4]), numbers, buffer)
        assert buffer.raw[:length] == encode(frame)


@pytest.mark.parametrize("kind", list(Kind))
def test_c_detects_every_flipped_bit_and_truncation(library, kind):
    wire = encode(next(frames(kind)))
    for bit in range(8 * len(wire)):
        changed = bytearray(wire)
        changed[bit // 8] ^= 1 << bit % 8
        assert fed(library, bytes(changed) + b"\0") == []
        assert counted(library)["broken"] + counted(library)["corrupted"] >= 1
    for length in range(1, len(wire) - 1):
        assert fed(library, wire[:length] + b"\0") == []
        assert fed(library, wire[length:]) == []


def test_c_resynchronizes_in_noise_as_python(library):
    rng = np.random.default_rng(0)
    noise = bytes(rng.integers(0, 256, 100_000).tolist())
    frame = next(frames(Kind.TORQUES))
    assert fed(library, noise + b"\0" + encode(frame) + b"\0\0" + encode(frame)) == [Kind.TORQUES] * 2
    assert counted(library)["frames"] == 2


@pytest.mark.parametrize(("place", "value"), [(0, 1), (0, 3), (1, 3), (1, 1)])
def test_c_counts_another_version_or_kind(library, place, value):
    packed = bytearray(cobs.decode(encode(next(frames(Kind.TORQUES)))[:-1])[:-4])
    packed[place] = value
    assert fed(library, cobs.encode(bytes(packed) + struct.pack("<I", zlib.crc32(packed))) + b"\0") == []
    assert counted(library) == {"frames": 0, "broken": 0, "corrupted": 0, "unknown": 1}


@pytest.mark.parametrize("last", [0, 5000, 2**32 - 1])
def test_order_of_readings_in_c(library, last):
    """As tests/link/test_lines_that_fail.py has it for the peer in Python."""
    for flags, steps, expected in (
        *((flags, 0, 0) for flags in (0, Flag.RESET)),
        *((flags, step, 1) for flags in (0, Flag.RESET) for step in (1, 2, 2**31 - 1)),
        *((0, step, -1) for step in (-1, -1024, -1025, 2**31)),
        *((Flag.RESET, step, -1) for step in (-1, -LATE)),
        *((Flag.RESET, step, 1) for step in (-LATE - 1, 2**31)),
    ):
        found = library.order(ctypes.c_uint32(last), ctypes.c_uint32(flags), ctypes.c_uint32(last + steps))
        assert found == expected, (flags, steps)


def test_names_of_c_are_names_of_python():
    text = link_header()
    for member in (*Kind, *Flag, *Status):
        assert f"BALLBOT_LINK_{member.name} = {member.value}" in text
    for field in READINGS:
        assert f"double {field.name}" in text


def test_header_needs_only_two_standard_headers():
    text = link_header()
    assert text.isascii()
    assert [line for line in text.splitlines() if line.startswith("#include")] == [
        "#include <stdint.h>",
        "#include <string.h>",
    ]
