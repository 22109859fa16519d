"""Measures controllers and writes docs/controllers.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.controllers import TOPICS
from validation.page import Chapter
from validation.topic import Findings, Topic

_HEAD = """# Controllers

`ballbot evaluate`, `compare`, `record`, `plot` and `view` take a controller by its name, a policy's file, or
`file.py:NAME`. `Controller(name, params, control_dt)` makes one: called with a state and a setpoint it gives the wheel
torques; a `Batch` runs it on all its robots in Rust. With `observation="sensors"` it gets the state that the
[estimator](estimator.md) makes of the readings. [Laws](laws.md) has of each the law, a block diagram, responses and a
basin.

Everything below, text apart, is made by `make controllers`, which fails if a claim does not hold: model `contact`, the
paper's robot, 100 Hz.
"""


def main() -> int:
    """The command `python -m validation.controllers`."""
    return page.write("controllers", "validation.controllers", __doc__, [Chapter("What they stand", "", TOPICS)], _head)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return f"{_HEAD}\n{page.contents('topic', found)}"


if __name__ == "__main__":
    sys.exit(main())
