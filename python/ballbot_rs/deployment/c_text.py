"""C text: numbers, arrays, comments, and the common parts of headers."""

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import resources
from typing import Any, Final

import numpy as np
import numpy.typing as npt

#: Most columns of a line.
WIDTH: Final = 118

_FOLDER: Final = resources.files(__package__) / "c"


#: A part that another part includes, and the empty line after the last one.
_INCLUDE: Final = re.compile(r'^#include "(\w+)\.h"\n\n?', re.MULTILINE)


def is_piece(name: str) -> bool:
    """Whether there is a part of headers with this name."""
    return (_FOLDER / f"{name}.h").is_file()


def piece(name: str) -> str:
    """A part of a header, without the parts that it includes."""
    return _INCLUDE.sub("", _text(name))


def included(name: str) -> list[str]:
    """The parts that a part of a header includes."""
    return _INCLUDE.findall(_text(name))


def _text(name: str) -> str:
    return (_FOLDER / f"{name}.h").read_text(encoding="utf-8")


def comment(lines: Iterable[str]) -> str:
    """A comment of these lines, in ASCII for any compiler."""
    text = "\n".join(lines).replace("N·m", "N m").replace("·", " ").replace("²", "^2").replace("³", "^3")
    text = text.replace("Σ", "sum").replace("τ", "torque").encode("ascii", "replace").decode().replace("*/", "* /")
    body = "\n".join(f" * {line}".rstrip() for line in text.splitlines())
    return f"/*\n{body}\n */\n"


def number(value: float) -> str:
    """A number that reads back bit for bit.

    Raises:
        ValueError: it is not finite.
    """
    if not np.isfinite(value):
        raise ValueError(f"a constant is {value}: it must be finite")
    return repr(float(value))


def _elements(values: Sequence[str], indent: str) -> str:
    """Elements of an array within braces, in lines of `WIDTH`."""
    lines = [""]
    for value in values:
        if lines[-1] and len(indent) + len(lines[-1]) + len(value) + 3 > WIDTH:
            lines.append("")
        lines[-1] += f"{' ' if lines[-1] else ''}{value},"
    return "{" + f"\n{indent}".join(lines).removesuffix(",") + "}"


def array(name: str, values: npt.ArrayLike, written: Callable[[Any], str] = number) -> str:
    """The definition of a vector or a matrix."""
    cells = np.asarray(values)
    sizes = "".join(f"[{size}]" for size in cells.shape)
    head = f"static const ballbot_real {name}{sizes} = "
    if cells.ndim == 1:
        return f"{head}{_elements([written(value) for value in cells], '    ')};\n"
    rows = [_elements([written(value) for value in row], "     ") for row in cells]
    return head + "{\n    " + ",\n    ".join(rows) + "};\n"


def single_array(name: str, values: npt.ArrayLike) -> str:
    """The definition of a vector or a matrix in single precision."""
    text = array(name, np.asarray(values, dtype=np.float32), _single)
    return text.replace("static const ballbot_real", "static const float", 1)


def _single(value: Any) -> str:
    """A number in single precision, with the fewest digits that identify it."""
    number(value)
    text = str(np.float32(value))
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def constants(values: Mapping[str, Any], prefix: str = "BALLBOT") -> str:
    """Definitions of numbers (macros) and arrays, with names in capitals."""
    text = ""
    for name, value in values.items():
        known = f"{prefix}_{name.upper()}"
        if np.ndim(value) == 0:
            text += f"#define {known} ((ballbot_real){number(value)})\n"
        else:
            text += array(known, value)
    return text


def guarded(kind: str, name: str, head: str, body: str, includes: Sequence[str] = ("math.h",)) -> str:
    """A header with a guard that is unique among headers of its kind; including two of a kind is an error."""
    digest = hashlib.sha256(body.encode()).hexdigest()[:8].upper()
    guard = f"BALLBOT_{name.upper()}_{digest}_H"
    included = "".join(f"#include <{file}>\n" for file in includes)
    return (
        f"{head}#ifndef {guard}\n#define {guard}\n\n"
        f"#ifdef BALLBOT_{kind.upper()}_KNOWN\n"
        f'#error "another {kind} of ballbot is included already: a translation unit takes one"\n'
        f"#endif\n#define BALLBOT_{kind.upper()}_KNOWN\n\n{included}\n{body}\n#endif\n"
    )
