"""Compares with closed forms and other engines, and writes docs/verification.md; fails if a claim does not hold."""

import platform
import sys
from collections.abc import Sequence
from importlib import metadata

from validation import against_engines, closed_forms, page
from validation.page import Chapter
from validation.topic import Findings, Topic

_HEAD = """# Verification

`make verify` computes every number here in one run, and fails if a claim does not hold or if an engine is missing.
Symbols and frames: [conventions.md](conventions.md); equations: [derivations.md](derivations.md); the experiments of
the paper: [paper.md](paper.md).

Each section has the command that runs only this section and prints its claims; `--figures DIR` saves its figure too.
"""
_CHAPTERS = [
    Chapter("Against closed forms", closed_forms.__doc__ or "", closed_forms.TOPICS),
    Chapter("Against other engines", against_engines.__doc__ or "", against_engines.TOPICS),
]


def main() -> int:
    """The command `python -m validation`."""
    return page.write("verification", "validation", __doc__, _CHAPTERS, _head)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return "\n".join([_HEAD, versions(), "", page.contents("topic", found)])


def versions() -> str:
    """Versions of what ran, in a line."""
    names = ["ballbot-rs", "numpy", "pin", "mujoco", "mujoco-mjx", "pybullet"]
    found = {name: metadata.version(name) for name in names if any(metadata.distributions(name=name))}
    return (
        f"Python {platform.python_version()}, "
        + ", ".join(f"{name} {version}" for name, version in found.items())
        + "."
    )


if __name__ == "__main__":
    sys.exit(main())
