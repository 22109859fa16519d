"""Tasks in Python by the module or file that registers them: "my_module:me/Spin-v0", "my_task.py:me/Spin-v0"."""

import functools
import importlib
import os
import re
import sys
from pathlib import Path
from typing import Final

from ballbot_rs._checks import did_you_mean
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._modules import FILE_PREFIX, module_of
from ballbot_rs.envs.own import registry

#: Names with sources, as they were given, by id.
_NAMED: Final[dict[str, str]] = {}


def is_in_source(task: str) -> bool:
    """Whether a task's name begins with a module or a file."""
    source, _, env_id = task.rpartition(":")
    # Neither a path of Windows nor an address.
    is_id = re.fullmatch(r"([\w-]+/)?[\w.-]+", env_id) is not None
    return is_id and (source.endswith(".py") or re.fullmatch(r"[^\W\d]\w*(\.\w+)*", source) is not None)


def id_in_source(task: str) -> str:
    """The id in such a name; its module or file is imported, which registers the task.

    Raises:
        ValueError: it cannot be imported, or does not register the id.
    """
    source, _, env_id = task.rpartition(":")
    try:
        import_source(source)
    except Exception as error:
        raise InvalidInputError(f"task '{task}': {source} failed: {type(error).__name__}: {error}") from error
    _NAMED[env_id] = task
    if registry.find(env_id) is None:
        raise InvalidInputError(
            f"task '{task}': {source} does not register '{env_id}' by bb.register{did_you_mean(env_id, registry.ids())}"
        )
    return env_id


def in_source(task: str) -> str:
    """A task as a command takes it: a task in Python with the module or file that has its class."""
    own = registry.find(task)
    if own is None or task in _NAMED:
        return _NAMED.get(task, task)
    name = own.made_by.__module__
    file = getattr(sys.modules.get(name), "__file__", None)
    return f"{os.path.relpath(file) if file and name.startswith(FILE_PREFIX) else name}:{task}"


def import_source(source: str) -> None:
    """Imports a module, or runs a Python file that has not run since it was written.

    Raises:
        FileNotFoundError: there is no such file.
        ModuleNotFoundError: there is no such module.
    """
    if not source.endswith(".py"):
        importlib.import_module(source)
        return
    file = Path(source).resolve()
    _run(file, file.stat().st_mtime_ns)


@functools.lru_cache(maxsize=32)
def _run(file: Path, _: int) -> None:
    """Runs a file once for each time at which it was written."""
    module_of(file)
