"""Runs every verification and writes docs/verification.md; the exit code tells whether all claims hold."""

import argparse
import sys

from verification import closed_forms
from verification.page import DOCS, section

_HEAD = """# Verification

Every number here is made by `make verify`, which fails if a claim does not hold; it all comes from one run. Symbols and
frames are those of [conventions.md](conventions.md), equations those of [derivations.md](derivations.md); the paper's
own experiments are in [paper.md](paper.md).
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

    parts, failed, count = [_HEAD], 0, 0
    for title, (text, topics) in chapters.items():
        parts.append(f"## {title}\n\n{text or ''}")
        for topic in topics:
            if names and topic.name not in names:
                continue
            markdown, findings = section(topic, "verification")
            parts.append(markdown)
            count += len(findings.claims)
            failed += sum(not claim.holds for claim in findings.claims)
    if not names:
        (DOCS / "verification.md").write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
        print(f"wrote {DOCS / 'verification.md'}")
    print(f"{count - failed} of {count} claims hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
