"""Python files of users, as modules."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Final

#: Of the names of modules of files: the stem may be the name of another module.
FILE_PREFIX: Final = "_ballbot_file_"


def module_of(file: Path) -> ModuleType:
    """The module of a Python file, whose code runs.

    Raises:
        FileNotFoundError: there is no such file.
    """
    if not file.is_file():
        raise FileNotFoundError(f"no Python file at {file}")
    name = f"{FILE_PREFIX}{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Where dataclasses and pickle look for it.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def import_from_here() -> None:
    """Lets modules be imported from the working directory, too."""
    if (folder := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, folder)
