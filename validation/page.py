"""A page of topics: Markdown and one figure per topic."""

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from validation.claim import Claim
from validation.topic import Findings, Topic

DOCS = Path(__file__).parents[1] / "docs"


class Chapter(NamedTuple):
    """Topics under a heading, and the text that introduces them."""

    title: str
    text: str
    topics: Sequence[Topic]


#: Makes the Markdown above the chapters of a page from the findings of its topics.
Head = Callable[[Sequence[tuple[Topic, Findings]]], str]


def write(name: str, module: str, about: str | None, chapters: Sequence[Chapter], head: Head) -> int:
    """Runs the topics requested on the command line of `module`; returns the exit code of `verdict`.

    All topics together make docs/`name`.md with figures in docs/`name`; topics requested by name are only printed.
    """
    chosen = arguments(module, about, [topic for chapter in chapters for topic in chapter.topics])
    found: list[tuple[Topic, Findings]] = []
    parts: list[str] = []
    for chapter in chapters:
        parts += [f"## {chapter.title}", chapter.text]
        for topic in chapter.topics:
            if chosen.topics and topic.name not in chosen.topics:
                continue
            findings = run(topic)
            found.append((topic, findings))
            if chosen.topics:
                print_alone(topic, findings, chosen.figures)
            else:
                draw(topic, findings, DOCS / name)
                parts.append(section(topic, findings, module, name))
    if not chosen.topics:
        path = DOCS / f"{name}.md"
        path.write_text("\n\n".join(part.strip() for part in [head(found), *parts] if part) + "\n", encoding="utf-8")
        print(f"wrote {path}")
    return verdict([findings for _, findings in found], chosen.allow_missing)


def arguments(module: str, about: str | None, topics: Iterable[Topic]) -> argparse.Namespace:
    """The command line: `topics` by name, `figures`, `allow_missing`."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    parser.add_argument("topics", nargs="*", help="run these only, print their claims, and write no page")
    parser.add_argument(
        "--figures", type=Path, metavar="DIR", help="with topics: draw their figures there (else nowhere)"
    )
    parser.add_argument(
        "--allow-missing", action="store_true", help="do not fail because an engine is not installed or does not load"
    )
    found: argparse.Namespace = parser.parse_args()
    known = [topic.name for topic in topics]
    if unknown := [name for name in found.topics if name not in known]:
        parser.error(f"no topic {', '.join(unknown)}; there are: {', '.join(known)}")
    if found.figures and not found.topics:
        parser.error("--figures goes with topics; a page has its figures next to it, in docs")
    return found


def run(topic: Topic) -> Findings:
    """Runs a topic and prints the result in a line."""
    began = time.perf_counter()
    findings = topic.run()
    absent = "".join(f"\n  LACKS {reason}" for reason in findings.missing)
    print(f"{topic.name}: {summary(findings.claims)}, {time.perf_counter() - began:.1f} s{absent}", flush=True)
    return findings


def draw(topic: Topic, findings: Findings, folder: Path) -> None:
    """Writes the topic's figure, if it has one, into `folder`."""
    if findings.draw is None:
        return
    from ballbot_rs.media.figures import legends, panels, style

    folder.mkdir(parents=True, exist_ok=True)
    fig = style.figure(*findings.size)
    findings.draw(fig)
    panels.finish(fig)
    legends.clear_curves(fig)
    style.save(fig, folder / f"{topic.name}.svg")


def section(topic: Topic, findings: Findings, module: str, folder: str) -> str:
    """A topic's Markdown; its figure is in docs/`folder`."""
    parts = [f"### {topic.title}", topic.text]
    if findings.draw is not None:
        parts.append(f"![{topic.title}]({folder}/{topic.name}.svg)")
    parts.append(evidence(findings))
    parts.append(f"Run by `python -m {module} {topic.name}`.")
    return "\n\n".join(part for part in parts if part)


def evidence(findings: Findings) -> str:
    """The findings as Markdown: claims, more text, and missing parts."""
    parts = [claims_table(findings.claims) if findings.claims else "", findings.markdown]
    parts += [f"Not run: {reason}." for reason in findings.missing]
    return "\n\n".join(part for part in parts if part)


def print_alone(topic: Topic, findings: Findings, figures: Path | None) -> None:
    """Prints a topic requested by name to the terminal; its figure only if requested."""
    print(f"\n{topic.title}\n\n{evidence(findings)}\n")
    if figures is not None and findings.draw is not None:
        draw(topic, findings, figures)
        print(f"wrote {figures / topic.name}.svg\n")


def outcome(findings: Findings) -> str:
    """For a table of contents: how many claims hold, and what was not run."""
    absent = "; ".join(f"not run: {reason}" for reason in findings.missing)
    if not findings.claims:
        return absent or "no claims"
    holding = f"{sum(claim.holds for claim in findings.claims)} of {len(findings.claims)}"
    return f"{holding}; {absent}" if absent else holding


def verdict(findings: Sequence[Findings], allow_missing: bool) -> int:
    """Prints how many claims hold in all; returns the exit code, which shows failures and parts that were not run."""
    claims = [claim for found in findings for claim in found.claims]
    failed = sum(not claim.holds for claim in claims)
    absent = sorted({reason for found in findings for reason in found.missing})
    print(f"{len(claims) - failed} of {len(claims)} claims hold")
    for reason in absent:
        print(f"not run: {reason}" + ("" if allow_missing else " (--allow-missing accepts that)"))
    return 1 if failed or (absent and not allow_missing) else 0


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


def contents(what: str, found: Sequence[tuple[Topic, Findings]]) -> str:
    """A table of the topics of a page, each `what`, with how many of its claims hold."""
    rows = [[f"[{topic.title}](#{anchor(topic.title)})", outcome(findings)] for topic, findings in found]
    return table([what, "claims that hold"], rows)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], align: str = "--:") -> str:
    """A Markdown table; `align` sets the alignment of all columns but the first, by default to the right."""
    lines = [head, ["---", *[align] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(cell.strip() for cell in line) + " |" for line in lines)


def anchor(title: str) -> str:
    """The fragment by which GitHub links to a heading."""
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")


def number(value: float, digits: int = 6) -> str:
    """A number with `digits` significant digits, or three with an exponent where that is shorter."""
    return f"{value:.{digits}g}" if value == 0.0 or 1e-3 <= abs(value) < 1e6 else f"{value:.2e}"


def summary(claims: Sequence[Claim]) -> str:
    """How many claims hold; failed claims by name."""
    failed = [str(claim) for claim in claims if not claim.holds]
    return f"{len(claims) - len(failed)} of {len(claims)} claims hold" + "".join(f"\n  FAILS {line}" for line in failed)
