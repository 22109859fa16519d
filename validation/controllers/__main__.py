"""Measures controllers and writes docs/controllers.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.controllers import TOPICS
from validation.page import Chapter
from validation.topic import Findings, Topic

_HEAD = """# Controllers

`ballbot evaluate`, `compare`, `record`, `plot` and `view` accept a controller by its name, the file of a policy, or
`file.py:NAME`. `Controller(name, robot, control_dt)` makes a controller: called with a state and a setpoint, it
returns the wheel torques. A `Batch` runs it on all its robots in Rust. With `observation="sensors"` a controller gets
the state estimate of the [estimator](estimator.md). [Laws](laws.md) has the equations of each controller, a block
diagram, responses and a basin of attraction.

A ballbot commanded to a position first rolls away from it, which makes it lean toward the target (the motion is
non-minimum phase). A click on the floor of [the page in the browser](web.md) shows it in slow motion.

<!-- scene: speed=0.1&compare=cascade_pid -->

`make controllers` writes everything below except the text, and fails if a claim does not hold. Model `contact`, the
paper's robot, 100 Hz.
"""


def main() -> int:
    """The command `python -m validation.controllers`."""
    return page.write(
        "controllers", "validation.controllers", __doc__, [Chapter("Disturbance limits", "", TOPICS)], _head
    )


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return f"{_HEAD}\n{page.contents('topic', found)}"


if __name__ == "__main__":
    sys.exit(main())
