"""Repeats the paper's experiments and writes docs/paper.md; the exit code reports whether all claims hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.page import anchor, table
from validation.paper_replication import CHAPTERS
from validation.topic import Findings, Topic

_HEAD = """# The paper's experiments

M. Abdelrahman et al., "Ballbot Simulation System: Modeling, Verification, and Gym Environment Development", is where
this project starts: a robot of three omniwheels on a ball, designed in CAD and described by two URDFs; planar
equations of motion; a PID controller tuned on these and tried on a Simscape model of the CAD robot; and a Gym
environment on PyBullet, in which training is left as a next step. Here all of it is repeated with this simulator.

`make paper` writes everything on this page except the text, and fails if a claim does not hold. A *claim* is a number
of this simulator with its expected value and limit. A number that the paper prints is not a claim: the summary and the
sections list it as *printed*, next to the simulator's. Nothing is tuned to match. The paper's figures are compared
through the numbers in its text; dashed lines in the figures here are printed values. "Section", "eq.", "Table" and
"Fig." refer to the paper. Symbols are defined in Table I; tilts $\\theta_x$ and $\\theta_y$ lean towards $+y$ and $+x$;
wheels are numbered 0 to 2, which are 1 to 3 in eq. (8). Each section has the command that runs only this section and
prints its claims; `--figures DIR` saves its figure too.

## Summary
"""


def main() -> int:
    """The command `python -m validation.paper_replication`."""
    return page.write("paper", "validation.paper_replication", __doc__, CHAPTERS, _head)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    rows = [
        [f"[{c.what}](#{anchor(topic.title)})", c.where, c.printed, c.ours, c.why]
        for topic, findings in found
        for c in findings.compared
    ]
    return f"{_HEAD}\n{table(['', 'paper', 'printed', 'ours', 'why they differ'], rows, align='---')}"


if __name__ == "__main__":
    sys.exit(main())
