"""A page of topics: Markdown and one figure a topic."""

import time
from collections.abc import Sequence
from pathlib import Path

from verification.claim import Claim
from verification.topic import Findings, Topic

DOCS = Path(__file__).parents[1] / "docs"


def section(topic: Topic, folder: str, level: int = 3, command: str = "") -> tuple[str, Findings]:
    """Runs a topic, writes its figure to docs/`folder`, and gives its Markdown; `command` makes the figure alone."""
    began = time.perf_counter()
    findings = topic.run()
    parts = [f"{'#' * level} {topic.title}", topic.text]
    if findings.draw is not None:
        from ballbot_rs.plotting import style

        fig = style.figure(*findings.size)
        findings.draw(fig)
        style.save(fig, DOCS / folder / f"{topic.name}.svg")
        parts.append(f"![{topic.title}]({folder}/{topic.name}.svg)")
        if command:
            parts.append(f"Made by `{command}`.")
    if findings.claims:
        parts.append(claims_table(findings.claims))
    if findings.markdown:
        parts.append(findings.markdown)
    print(f"{topic.name}: {summary(findings.claims)}, {time.perf_counter() - began:.1f} s", flush=True)
    return "\n\n".join(parts), findings


def claims_table(claims: Sequence[Claim]) -> str:
    """The claims as a Markdown table."""
    rows = []
    for claim in claims:
        error, limit = (
            (f"{number(claim.error)} {claim.unit}", f"{number(claim.limit)} {claim.unit}")
            if claim.absolute
            else (f"{claim.error:.1e}", f"{claim.limit:.0e}")
        )
        verdict = "" if claim.holds else " **fails**"
        found, expected = (f"{number(value, 9)} {claim.unit}" for value in (claim.found, claim.expected))
        rows.append([claim.what, found, expected, error + verdict, limit])
    return table(["claim", "found", "expected", "error", "limit"], rows)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], align: str = "--:") -> str:
    """A Markdown table; all columns but the first are aligned as `align` says, by default to the right."""
    lines = [head, ["---", *[align] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(cell.strip() for cell in line) + " |" for line in lines)


def anchor(title: str) -> str:
    """What a heading is linked by."""
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")


def number(value: float, digits: int = 6) -> str:
    """With `digits` significant digits, or three with an exponent where that is shorter."""
    return f"{value:.{digits}g}" if value == 0.0 or 1e-3 <= abs(value) < 1e6 else f"{value:.2e}"


def summary(claims: Sequence[Claim]) -> str:
    """How many claims hold; those that do not, by name."""
    failed = [str(claim) for claim in claims if not claim.holds]
    return f"{len(claims) - len(failed)} of {len(claims)} claims hold" + "".join(f"\n  FAILS {line}" for line in failed)
