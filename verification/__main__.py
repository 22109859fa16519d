"""Runs every verification and writes docs/verification.md; the exit code tells whether all ran and all claims hold."""

import platform
import sys
from importlib import metadata

from verification import closed_forms, engines, page
from verification.page import DOCS, anchor, table

_HEAD = """# Verification

Every number here is made by `make verify`, which fails if a claim does not hold or if an engine is not there; it all
comes from one run. Symbols and frames: [conventions.md](conventions.md); equations: [derivations.md](derivations.md);
the experiments of the paper: [paper.md](paper.md).

Each section has the command that runs it alone and prints its claims; `--figures DIR` draws its figure too.
"""
_CHAPTERS = {"Against closed forms": closed_forms, "Against other engines": engines}


def main() -> int:
    """The command `python -m verification`."""
    asked = page.arguments("verification", __doc__, [t for chapter in _CHAPTERS.values() for t in chapter.TOPICS])
    parts, contents, all_findings = [], [], []
    for title, chapter in _CHAPTERS.items():
        parts.append(f"## {title}\n\n{chapter.__doc__ or ''}")
        for topic in chapter.TOPICS:
            if asked.topics and topic.name not in asked.topics:
                continue
            findings = page.run(topic)
            all_findings.append(findings)
            if asked.topics:
                page.print_alone(topic, findings, asked.figures)
                continue
            page.draw(topic, findings, DOCS / "verification")
            parts.append(page.section(topic, findings, "verification", "verification"))
            contents.append([f"[{topic.title}](#{anchor(topic.title)})", page.outcome(findings)])
    if not asked.topics:
        parts = [_HEAD, versions(), table(["topic", "claims that hold"], contents), *parts]
        (DOCS / "verification.md").write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
        print(f"wrote {DOCS / 'verification.md'}")
    return page.verdict(all_findings, asked.allow_missing)


def versions() -> str:
    """What ran, in a line."""
    names = ["ballbot-rs", "numpy", "pin", "mujoco", "pybullet"]
    found = {name: metadata.version(name) for name in names if any(metadata.distributions(name=name))}
    return (
        f"Python {platform.python_version()}, "
        + ", ".join(f"{name} {version}" for name, version in found.items())
        + "."
    )


if __name__ == "__main__":
    sys.exit(main())
