"""Badges of the README: facts from files of the repository, as pictures that need no service."""

import re
from pathlib import Path

from ballbot_rs import _toml

ROOT = Path(__file__).resolve().parents[2]

#: Width of a letter and margin at both ends of a field, px; texts are stretched to their fields.
_LETTER, _MARGIN = 6.6, 6.0


def badges() -> dict[str, str]:
    """File names and SVGs."""
    project = _toml.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    package = _toml.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]
    facts = {
        "python": project["requires-python"].replace(">=", "") + " or newer",
        "rust": package["rust-version"] + " or newer",
        "license": "MIT or Apache-2.0",
        "verified claims": _claims(),
    }
    return {f"{name.split()[0]}.svg": _badge(name, value) for name, value in facts.items()}


def _claims() -> str:
    """How many claims of docs/verification.md hold."""
    page = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")
    counts = re.findall(r"^\| \[.*\| (\d+) of (\d+) \|$", page, re.MULTILINE)
    held, made = (sum(int(count[i]) for count in counts) for i in (0, 1))
    return f"{held} of {made}"


def _badge(name: str, value: str) -> str:
    left, right = (_LETTER * len(text) + 2 * _MARGIN for text in (name, value))
    fields = ((0.0, left, "#495057", name), (left, right, "#0b7285", value))
    boxes = "".join(
        f'<rect x="{x:.1f}" width="{width:.1f}" height="20" fill="{fill}"/>' for x, width, fill, _ in fields
    )
    texts = "".join(
        f'<text x="{x + 0.5 * width:.1f}" y="14" textLength="{width - 2 * _MARGIN:.1f}">{text}</text>'
        for x, width, _, text in fields
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + right:.1f}" height="20" role="img" '
        f'aria-label="{name}: {value}"><title>{name}: {value}</title><clipPath id="r"><rect width="{left + right:.1f}" '
        f'height="20" rx="3"/></clipPath><g clip-path="url(#r)">{boxes}</g><g fill="#fff" text-anchor="middle" '
        f'font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">{texts}</g></svg>\n'
    )
