"""The frames of the lockstep link as a C99 header."""

from typing import Final

from ballbot_rs import __version__
from ballbot_rs.deployment.c_text import comment, guarded, piece
from ballbot_rs.link.layout import (
    HEADER,
    LATE,
    LONGEST,
    PAYLOADS,
    VERSION,
    Field,
    Flag,
    Kind,
    Status,
    format_of,
    size_of,
    wire_size_of,
)

#: Types of the header's fields in C.
_INTEGERS: Final = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t"}

#: For any compiler.
_ASCII: Final = str.maketrans({"²": "^2", "³": "^3", "⁴": "^4", "·": " ", "µ": "u"})

#: Fields of the header that a user reads and writes; the functions fill in the others.
_OPEN: Final = tuple(field for field in HEADER if field.name not in ("version", "kind"))


def link_header() -> str:
    """The text of a C99 header with the frames of the lockstep link: encode, decode, and a decoder of a stream."""
    body = "\n".join((_constants(), piece("link"), *map(_frame, Kind), piece("link_order")))
    return guarded("link", "link", comment(_head()), body, includes=("stdint.h", "string.h"))


def _head() -> list[str]:
    return [
        f"Frames of the lockstep link; `ballbot export --link` of ballbot {__version__}. docs/link.md has all bytes.",
        "",
        "Use: feed each byte that arrives, answer each READINGS with TORQUES of its sequence and time:",
        "",
        "    ballbot_link_decoder decoder = {0};",
        "    ballbot_link_readings readings;",
        "    ballbot_link_torques torques = {0};",
        "    uint8_t frame[BALLBOT_LINK_LONGEST];",
        "    if (ballbot_link_feed(&decoder, byte) == BALLBOT_LINK_READINGS) {",
        "        ballbot_link_decode_readings(&decoder, &readings);",
        "        order = ballbot_link_order(&torques, &readings);    (1 at the first readings)",
        "        if (order > 0) {",
        "            torques.sequence = readings.sequence;",
        "            torques.time = readings.time;",
        "            ...",
        "        }",
        "        if (order >= 0) {",
        "            send(frame, ballbot_link_encode_torques(&torques, frame));",
        "        }",
        "    }",
        "",
        "Memory: all of it is in `ballbot_link_decoder`; nothing is allocated.",
    ]


def _constants() -> str:
    sizes = {
        "VERSION": VERSION,
        "HEADER": sum(field.size for field in HEADER),
        "LONGEST": LONGEST,
        **{f"{kind.name}_LONGEST": wire_size_of(kind) for kind in Kind},
    }
    text = "/* ---- Sizes in bytes: of the header, and of frames on the wire with their zero. */\n"
    text += "".join(f"#define BALLBOT_LINK_{name} {value}\n" for name, value in sizes.items())
    for of, members in (("kinds", Kind), ("flags of readings", Flag), ("status of the controller", Status)):
        listed = ",\n".join(f"    BALLBOT_LINK_{member.name} = {member.value}" for member in members)
        text += f"\n/* {of.capitalize()}. */\nenum {{\n{listed}\n}};\n"
    cases = "".join(f"    case BALLBOT_LINK_{kind.name}:\n        return {size_of(kind)};\n" for kind in Kind)
    text += f"\n/* Readings with RESET so far behind the last readings are late. */\n#define BALLBOT_LINK_LATE {LATE}\n"
    return text + (
        "\n/* Bytes of header, payload and checksum of a kind, 0 for an unknown kind. */\n"
        "static inline int ballbot_link_size(int kind)\n{\n"
        f"    switch (kind) {{\n{cases}    default:\n        return 0;\n    }}\n}}\n"
    )


def _frame(kind: Kind) -> str:
    """Struct, encoder and decoder of a kind of frame."""
    name, fields = kind.name.lower(), PAYLOADS[kind]
    struct = "".join(map(_member, (*_OPEN, *fields)))
    put = "".join(_put(field, kind) for field in HEADER) + "".join(map(_put_payload, fields))
    get = "".join(map(_get, HEADER)) + "".join(map(_get_payload, fields))
    return f"""\
/* ---- {kind.name}: `{format_of((*HEADER, *fields))}` of Python's struct. */
typedef struct {{
{struct}}} ballbot_link_{name};

/* Writes a frame with its zero; returns its bytes. */
static inline int ballbot_link_encode_{name}(
    const ballbot_link_{name} *from, uint8_t frame[BALLBOT_LINK_{kind.name}_LONGEST])
{{
    uint8_t *to = frame + 1;
{put}    return ballbot_link_finish(frame, to);
}}

/* Reads the frame that `ballbot_link_feed` has just completed, of this kind. */
static inline void ballbot_link_decode_{name}(const ballbot_link_decoder *decoder, ballbot_link_{name} *to)
{{
    const uint8_t *from = decoder->bytes + 2;
{get}}}
"""


def _member(field: Field) -> str:
    kind = _INTEGERS.get(field.type, "double")
    unit = f", {field.unit}" if field.unit else ""
    return f"    {kind} {field.name}{_array(field)}; /* {field.doc}{unit} */\n".translate(_ASCII)


def _array(field: Field) -> str:
    return "" if field.length == 1 else f"[{field.length}]"


def _put(field: Field, kind: Kind) -> str:
    own = {"version": "BALLBOT_LINK_VERSION", "kind": f"BALLBOT_LINK_{kind.name}"}
    return f"    ballbot_link_put(&to, {own.get(field.name, f'from->{field.name}')}, {field.size});\n"


def _get(field: Field) -> str:
    if field not in _OPEN:
        return ""
    return f"    to->{field.name} = ({_INTEGERS[field.type]})ballbot_link_get(&from, {field.size});\n"


def _put_payload(field: Field) -> str:
    return f"    ballbot_link_put_doubles(&to, {_pointer('from', field)}, {field.length});\n"


def _get_payload(field: Field) -> str:
    return f"    ballbot_link_get_doubles(&from, {_pointer('to', field)}, {field.length});\n"


def _pointer(of: str, field: Field) -> str:
    return f"{'&' if field.length == 1 else ''}{of}->{field.name}"
