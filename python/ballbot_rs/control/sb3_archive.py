"""The contents of a policy file of Stable-Baselines3, read without running code in it.

Such a file has some values as pickles, which can run any code when loaded. The values that acting needs follow from the
metadata, so that a policy of a usual form is loaded without pickles.
"""

import base64
import io
import json
import pickle
import pickletools
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

#: Largest description of a policy, and largest file after unpacking, bytes.
MAX_DATA: Final = 16 * 2**20
MAX_SIZE: Final = 2**30

_PICKLED: Final = ":serialized:"

#: Replacements of pickled values that the setup of an algorithm requires; acting does not use them.
_STAND_INS: Final[Mapping[str, Any]] = {
    "learning_rate": 0.0,
    "clip_range": 0.2,
    "train_freq": 1,
    "target_entropy": "auto",
}

#: Instructions of a pickle that call something.
_CALLS: Final = {"REDUCE", "BUILD", "INST", "OBJ", "NEWOBJ", "NEWOBJ_EX", "EXT1", "EXT2", "EXT4", "PERSID", "BINPERSID"}


def read(path: Path) -> dict[str, Any]:
    """The description of a policy; pickled values stay pickled.

    Raises:
        ValueError: not a policy file of Stable-Baselines3, or a damaged file.
    """
    rejection = f"{path} is not a policy file of Stable-Baselines3"
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{rejection}: it is not a zip file, or it is truncated")
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
            for name in ("data", "policy.pth"):
                if name not in sizes:
                    raise ValueError(f"{rejection}: it has no '{name}'")
            if sizes["data"] > MAX_DATA or sum(sizes.values()) > MAX_SIZE:
                limits = f"{sizes['data']} and {sum(sizes.values())} bytes, more than {MAX_DATA} and {MAX_SIZE}"
                raise ValueError(f"{rejection}: its 'data' and all of it have {limits}")
            damaged = archive.testzip()
            if damaged is not None:
                raise ValueError(f"{rejection}: '{damaged}' in it is damaged")
            data = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"{rejection}: {error}") from error
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{rejection}: its 'data' cannot be read: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"{rejection}: its 'data' is not a table")
    return data


def without_pickles(data: Mapping[str, Any], kind: type[BaseAlgorithm]) -> tuple[dict[str, Any], list[str]]:
    """Replacements of the pickled values, and the names of the values that only unpickling can give.

    Args:
        data: as `read` returns it.
        kind: the algorithm.
    """
    replaced: dict[str, Any] = {}
    unknown: list[str] = []
    for name, value in data.items():
        if not _is_pickled(value):
            continue
        if name == "policy_class":
            found: Any = _policy_class(value, kind)
        elif name == "policy_kwargs":
            found = _plain(value[_PICKLED])
        else:
            replaced[name] = _STAND_INS.get(name)
            continue
        if found is None:
            unknown.append(name)
        else:
            replaced[name] = found
    return replaced, unknown


def _is_pickled(value: Any) -> bool:
    return isinstance(value, dict) and _PICKLED in value


def _policy_class(value: Mapping[str, Any], kind: type[BaseAlgorithm]) -> type | None:
    """The algorithm's own policy class that a file names, or None for a foreign class."""
    known = [found for found in kind.policy_aliases.values() if found.__module__ == value.get("__module__")]
    if not known:
        return None
    # Classes of one module are distinguished by their docstrings; all but one of them expect other observations.
    usual = next(iter(kind.policy_aliases.values()))
    return next((found for found in known if found.__doc__ == value.get("__doc__")), usual)


def _plain(text: Any) -> Any:
    """A pickle of plain values and of classes of torch, or None for a pickle that would call anything."""
    try:
        content = base64.b64decode(text)
        if any(operation.name in _CALLS for operation, _, _ in pickletools.genops(content)):
            return None
        return _PlainUnpickler(io.BytesIO(content)).load()
    # The exceptions of a damaged pickle have no common base class.
    except Exception:
        return None


class _PlainUnpickler(pickle.Unpickler):
    """Finds layers and optimizers of torch, nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith(("torch.nn.modules.", "torch.optim.")) and name.isidentifier():
            found = super().find_class(module, name)
            if isinstance(found, type) and issubclass(found, (torch.nn.Module, torch.optim.Optimizer)):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not part of a network")
