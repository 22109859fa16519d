"""Arrays that leave the package: read-only, or copies."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The array, made read-only."""
    array.flags.writeable = False
    return array


def keep_copies(record: Any) -> None:
    """Replaces the arrays of a frozen dataclass, also those in mappings, by read-only copies."""
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            value = read_only(value.copy())
        elif isinstance(value, Mapping):
            value = {name: read_only(np.array(part)) for name, part in value.items()}
        else:
            continue
        object.__setattr__(record, field.name, value)
