"""Repeats the paper's experiments and writes docs/paper.md; the exit code tells whether all claims hold."""

import sys

from verification import page
from verification.page import DOCS, anchor, table
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
numbered 1 to 3 as in eq. (8). Each section has the command that runs it alone and prints its claims; `--figures DIR`
draws its figure too.

## Summary
"""


def main() -> int:
    """The command `python -m verification.paper`."""
    asked = page.arguments("verification.paper", __doc__, [t for _, topics in CHAPTERS.values() for t in topics])
    parts: list[str] = []
    summary: list[tuple[Topic, Comparison]] = []
    all_findings = []
    for title, (text, topics) in CHAPTERS.items():
        parts += [f"## {title}", text]
        for topic in topics:
            if asked.topics and topic.name not in asked.topics:
                continue
            findings = page.run(topic)
            all_findings.append(findings)
            if asked.topics:
                page.print_alone(topic, findings, asked.figures)
                continue
            page.draw(topic, findings, DOCS / "paper")
            parts.append(page.section(topic, findings, "verification.paper", "paper"))
            summary += [(topic, comparison) for comparison in findings.compared]
    if not asked.topics:
        parts = [_HEAD, _summary(summary), *parts]
        (DOCS / "paper.md").write_text("\n\n".join(part.strip() for part in parts if part) + "\n", encoding="utf-8")
        print(f"wrote {DOCS / 'paper.md'}")
    return page.verdict(all_findings, asked.allow_missing)


def _summary(comparisons: list[tuple[Topic, Comparison]]) -> str:
    rows = [[f"[{c.what}](#{anchor(topic.title)})", c.where, c.printed, c.ours, c.why] for topic, c in comparisons]
    return table(["", "paper", "printed", "ours", "why they differ"], rows, align="---")


if __name__ == "__main__":
    sys.exit(main())
