"""The head of the page, and the documentation to which its help links."""

import re
from pathlib import Path
from typing import Final

#: Folder of the scripts, by subject, and of the style sheet.
FRONT: Final = Path(__file__).parent / "front"
SCRIPTS: Final = ("drive.js", "take.js", "help.js")
STYLE: Final = "style.css"

#: The documentation of the page, which a clone has, and its path on the server.
DOCUMENTATION: Final = Path(__file__).parents[4] / "docs" / "view.md"
DOCUMENTATION_PATH: Final = "/docs/view.md"

TITLE: Final = b"<title>ballbot</title>"

#: A robot on its ball.
ICON: Final = (
    b"<link rel=\"icon\" href=\"data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'%3E"
    b"%3Cpath fill='%231a4c8c' d='M11 3h10v4h-3v7h-4V7h-3z'/%3E%3Ccircle cx='16' cy='22' r='8' fill='%23cc382e'/%3E"
    b'%3C/svg%3E" />'
)

_VISERS = re.compile(rb"<title>.*?</title>|<link\s+rel=\"icon\".*?/>", re.DOTALL)


def head() -> bytes:
    """Elements for the head of viser's page: title, icon, style sheet and scripts."""
    scripts = [b"<script>" + (FRONT / name).read_bytes() + b"</script>" for name in SCRIPTS]
    return b"".join([TITLE, ICON, b"<style>", (FRONT / STYLE).read_bytes(), b"</style>", *scripts])


def with_head(page: bytes) -> bytes:
    """Viser's page with the elements of `head` in place of the default elements."""
    start, end, rest = page.partition(b"</head>")
    # Its scripts are long, and come after the searched text.
    own, mark, scripts = start.partition(b"<script")
    # Our scripts run before viser's, which listen to the same keys.
    return b"".join([_VISERS.sub(b"", own), head(), mark, scripts, end, rest])
