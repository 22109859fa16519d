"""Exported headers, compiled with the C compiler of this computer."""

import ctypes
import functools
import shutil
import subprocess
from os import PathLike
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs import _files

_COMPILERS: Final = ("cc", "gcc", "clang")
#: Longest time of a compilation, s.
LONGEST: Final = 60.0

#: States are arrays of doubles.
_STATE: Final = "typedef char state_has_no_padding[sizeof(ballbot_state) == 17 * sizeof(double) ? 1 : -1];\n"


def compiled(name: str, header: str, source: str) -> ctypes.CDLL:
    """A library of functions on a header.

    Args:
        name: of what the header has.
        header: its text.
        source: C99 after its include.

    Raises:
        OSError: there is no C compiler.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise OSError(f"the {name} needs a C compiler: none of {', '.join(_COMPILERS)} is in PATH")
    return _library(compiler, name, header, source)


@functools.lru_cache(maxsize=32)
def _library(compiler: str, name: str, header: str, source: str) -> ctypes.CDLL:
    with _files.scratch_folder() as folder:
        (folder / f"{name}.h").write_text(header, encoding="ascii")
        file, library = folder / f"{name}.c", folder / f"{name}.so"
        file.write_text(f'#include "{name}.h"\n\n{_STATE}\n{source}', encoding="ascii")
        command: list[str | PathLike[str]] = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-o", library, file]
        try:
            done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False, timeout=LONGEST)
        except subprocess.TimeoutExpired as error:
            raise OSError(f"{compiler} did not end within {LONGEST:g} s") from error
        if done.returncode != 0:
            raise OSError(f"{compiler} failed: {' '.join(done.stderr.strip().splitlines()[-1:])}")
        return ctypes.CDLL(str(library))


def pointer(numbers: npt.NDArray[np.float64]) -> Any:
    """The address of a contiguous array."""
    return numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
