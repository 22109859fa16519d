"""Paths."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Pages from outside docs/, by their path in the clone.
ELSEWHERE = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "examples/README.md": "examples.md",
    "examples/first_steps.ipynb": "first_steps.md",
    "examples/learning.ipynb": "learning.md",
}


def staged() -> dict[str, str]:
    """The path of each page in the site by its path in the clone."""
    pages = {page.relative_to(ROOT).as_posix(): page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
    return dict(sorted({**pages, **ELSEWHERE}.items()))
