"""Prints what the package and some of its extras need: `python tools/requirements.py EXTRA ...`.

The Makefile installs that while Cargo compiles the extension.
"""

import re
import sys
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    from pip._vendor import tomli as tomllib

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def requirements(extras: list[str]) -> list[str]:
    """Requirements of the package with `extras`, extras of extras included."""
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    own = re.compile(rf"{project['name']}\[(.+)\]")
    found: list[str] = list(project["dependencies"])
    for extra in extras:
        for line in project["optional-dependencies"][extra]:
            nested = own.fullmatch(line)
            found += requirements(nested[1].split(",")) if nested else [line]
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1:])))
