"""Results of an unfinished study in a file, from which it continues."""

import hashlib
import inspect
import json
import time
import types
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np

from ballbot_rs import __version__, _files
from ballbot_rs._core import Controller, Params
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._reading import read_regular
from ballbot_rs.control import policy_file
from ballbot_rs.control.resolve import ResolvedController

#: Identifies the file.
FORMAT: Final = "ballbot study 1"

#: Largest file, bytes, and least time between two writes, s.
MAX_FILE: Final = 1 << 30
EVERY: Final = 1.0


class Checkpoint:
    """The rows of the points of a study that are done, written now and then: the file is whole at any time.

    Args:
        path: the file; it need not exist.
        study: what the rows follow from, by name; a file of another study is rejected.
        count: number of points.
    """

    def __init__(self, path: str | PathLike[str], study: Mapping[str, Any], count: int) -> None:
        self._path, self._count = Path(path), count
        self._study = {name: identity(part) for name, part in {"version": __version__, **study}.items()}
        self._rows: dict[int, list[dict[str, Any]]] = {}
        self._written, self._is_new = time.monotonic(), False

    def read(self) -> dict[int, list[dict[str, Any]]]:
        """The rows of the points that are done.

        Raises:
            ValueError: another kind of file, or a file of another study.
            OSError: the file cannot be read.
        """
        if not self._path.exists():
            # Now, and not after hours, it turns out that the file cannot be written.
            self.write(always=True)
            return {}
        try:
            found = json.loads(read_regular(self._path, MAX_FILE))
            if found["format"] != FORMAT:
                raise ValueError
            study, rows = dict(found["study"]), {int(i): list(of) for i, of in found["rows"].items()}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise InvalidInputError(f"{self._path} is not a checkpoint of a study: name another file") from None
        for name, part in self._study.items():
            if study.get(name) != part:
                was = f"{_short(study.get(name))} there and {_short(part)} here"
                raise InvalidInputError(
                    f"{self._path} is of another study, {name} is {was}: name another file, or delete this one"
                )
        self._rows = {i: of for i, of in rows.items() if 0 <= i < self._count}
        return dict(self._rows)

    def add(self, point: int, rows: list[dict[str, Any]]) -> None:
        """Takes the rows of a point, and writes the file unless it was written a moment ago."""
        self._rows[point], self._is_new = rows, True
        if time.monotonic() - self._written > EVERY:
            self.write()

    def write(self, *, always: bool = False) -> None:
        """Writes the file if it lacks anything.

        Raises:
            OSError: it cannot be written; an earlier one stays as it is.
        """
        if not (self._is_new or always):
            return
        rows = {str(i): of for i, of in sorted(self._rows.items())}
        _files.write(self._path, json.dumps({"format": FORMAT, "study": self._study, "rows": rows}))
        self._written, self._is_new = time.monotonic(), False


def _short(part: Any) -> str:
    text = json.dumps(part)
    return text if len(text) < 100 else f"{text[:99]}…"


def identity(thing: Any, depth: int = 0) -> Any:
    """What a thing is, as JSON: numbers and texts as they are, laws in Python by a digest of source and attributes."""
    if thing is None or isinstance(thing, (bool, int, float, str)):
        return thing
    if isinstance(thing, Params):
        return thing.to_dict()
    if isinstance(thing, (np.generic, np.ndarray)):
        return thing.tolist()
    if isinstance(thing, Mapping):
        return {str(name): identity(part, depth) for name, part in thing.items()}
    if isinstance(thing, Sequence):
        return [identity(part, depth) for part in thing]
    kind = thing if isinstance(thing, (type, types.FunctionType)) else type(thing)
    return f"{kind.__qualname__} {_digest([kind.__module__, *_code(kind), *_held(thing, depth)])}"


def identity_of_controller(source: Any) -> str:
    """What a controller is: its name, and a digest of its file, constants or code.

    Raises:
        ValueError: a law of the core whose options cannot be read.
    """
    if isinstance(source, ResolvedController):
        source = source.name if source.existing is None else source.existing
    if isinstance(source, Controller):
        try:
            constants = source.constants()
        except ValueError as error:
            raise InvalidInputError(f"a checkpoint cannot hold the options of {source.name}: name it") from error
        return f"{source.name} {_digest([identity(constants), source.control_dt])}"
    if not isinstance(source, (str, PathLike)):
        return str(identity(source))
    name = fspath(source)
    file, _, attribute = name.rpartition(":")
    path = Path(file) if file.endswith(".py") and attribute else policy_file.in_run(Path(name))
    return f"{name} {_digest(path.read_bytes().hex())}" if path.is_file() else name


def _code(kind: type | types.FunctionType) -> list[str]:
    try:
        return [inspect.getsource(kind)]
    except (OSError, TypeError):
        code = getattr(kind, "__code__", None)
        return [] if code is None else [code.co_code.hex(), repr(code.co_consts)]


def _held(thing: Any, depth: int) -> list[Any]:
    """Attributes of an object, or values that a function was made with."""
    if depth > 3 or isinstance(thing, type):
        return []
    if isinstance(thing, types.FunctionType):
        held = {**inspect.getclosurevars(thing).nonlocals, "defaults": thing.__defaults__}
    else:
        held = getattr(thing, "__dict__", {})
    return [identity(held, depth + 1)]


def _digest(parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]
