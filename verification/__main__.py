"""Runs every verification and writes docs/verification.md; the exit code tells whether all claims hold."""

import argparse
import platform
import sys
from importlib import metadata

from verification import closed_forms
from verification.page import DOCS, anchor, section, table

_HEAD = """# Verification

Every number here is made by `make verify`, which fails if a claim does not hold; it all comes from one run. Symbols and
frames: [conventions.md](conventions.md); equations: [derivations.md](derivations.md); the experiments of the paper:
[paper.md](paper.md).
"""


def main() -> int:
    """The command `python -m verification`."""
    parser = argparse.ArgumentParser(prog="python -m verification", description=__doc__)
    parser.add_argument("topics", nargs="*", help="run these only, and write no page")
    names = parser.parse_args().topics

    from verification import engines

    chapters = {
        "Against closed forms": (closed_forms.__doc__, closed_forms.TOPICS),
        "Against other engines": (engines.__doc__, engines.TOPICS),
    }
    known = {topic.name: topic for _, topics in chapters.values() for topic in topics}
    if unknown := [name for name in names if name not in known]:
        parser.error(f"no topic {', '.join(unknown)}; there are: {', '.join(known)}")

    parts, contents, failed, count = [], [], 0, 0
    for title, (text, topics) in chapters.items():
        parts.append(f"## {title}\n\n{text or ''}")
        for topic in topics:
            if names and topic.name not in names:
                continue
            markdown, findings = section(topic, "verification")
            parts.append(markdown)
            claims = len(findings.claims)
            holding = sum(claim.holds for claim in findings.claims)
            count, failed = count + claims, failed + claims - holding
            contents.append([f"[{topic.title}](#{anchor(topic.title)})", f"{holding} of {claims}"])
    if not names:
        parts = [_HEAD, versions(), table(["topic", "claims that hold"], contents), *parts]
        (DOCS / "verification.md").write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
        print(f"wrote {DOCS / 'verification.md'}")
    print(f"{count - failed} of {count} claims hold")
    return 1 if failed else 0


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
