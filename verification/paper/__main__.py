"""Repeats the paper's experiments and writes docs/paper.md; the exit code tells whether all claims hold."""

import argparse
import re
import sys

from verification.page import DOCS, section, table
from verification.paper import CHAPTERS
from verification.topic import Comparison, Topic

_HEAD = """# The paper's experiments

M. Abdelrahman et al., "Ballbot Simulation System: Modeling, Verification, and Gym Environment Development", is where
this project starts: a robot of three omniwheels on a ball, designed in CAD and described by two URDFs; planar
equations of motion; a PID controller tuned on these and tried on a Simscape model of the CAD robot; and a Gym
environment on PyBullet, in which training is left as a next step. Here all of it is repeated with this simulator.

Everything on this page, text apart, is made by `make paper`, which fails if a claim does not hold. A *claim* is a
number of ours that we assert, beside what it must be. What the paper prints is no claim: it stands beside ours, in
the summary and in each section, as *printed*. Nothing is tuned to match. The figures of the paper are compared by the
numbers that its text gives; printed values are dashed lines in ours. "Section", "eq.", "Table" and "Fig." mean the
paper's. Symbols are those of Table I; tilts $\\theta_x$ and $\\theta_y$ lean towards $+y$ and $+x$; wheels are
numbered 1 to 3 as in eq. (8).

## Summary
"""


def main() -> int:
    """The command `python -m verification.paper`."""
    parser = argparse.ArgumentParser(prog="python -m verification.paper", description=__doc__)
    parser.add_argument("topics", nargs="*", help="run these only, and write no page")
    names = parser.parse_args().topics
    known = [topic.name for _, topics in CHAPTERS.values() for topic in topics]
    if unknown := [name for name in names if name not in known]:
        parser.error(f"no topic {', '.join(unknown)}; there are: {', '.join(known)}")

    parts: list[str] = []
    summary: list[tuple[Topic, Comparison]] = []
    failed, count = 0, 0
    for title, (text, topics) in CHAPTERS.items():
        parts += [f"## {title}", text]
        for topic in topics:
            if names and topic.name not in names:
                continue
            command = f"python -m verification.paper {topic.name}"
            markdown, findings = section(topic, "paper", command=command)
            parts.append(markdown)
            summary += [(topic, comparison) for comparison in findings.compared]
            count += len(findings.claims)
            failed += sum(not claim.holds for claim in findings.claims)
    if not names:
        page = [_HEAD, _summary(summary), *parts]
        (DOCS / "paper.md").write_text("\n\n".join(part.strip() for part in page if part) + "\n", encoding="utf-8")
        print(f"wrote {DOCS / 'paper.md'}")
    print(f"{count - failed} of {count} claims hold")
    return 1 if failed else 0


def _summary(comparisons: list[tuple[Topic, Comparison]]) -> str:
    rows = [[f"[{c.what}](#{_anchor(topic.title)})", c.where, c.printed, c.ours, c.why] for topic, c in comparisons]
    return table(["", "paper", "printed", "ours", "why they differ"], rows, align="---")


def _anchor(title: str) -> str:
    """The fragment by which GitHub links to a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


if __name__ == "__main__":
    sys.exit(main())
