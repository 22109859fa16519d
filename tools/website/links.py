"""Links of Markdown pages: to pages and to files of the clone, and a check for broken links in the built site."""

import os
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from website.paths import ROOT

#: `[text](target)` and `![text](target)`.
LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```$)", flags=re.DOTALL | re.MULTILINE)
#: Pattern of a valid absolute address.
ADDRESS = re.compile(r"https://[a-z0-9-]+(\.[a-z0-9-]+)+(/[^\s]*)?", flags=re.IGNORECASE)
DEFINITION = r"\b(?:fn|struct|enum|trait|const|static|type|mod|def|class)\s+{name}\b|^\s*(?:pub\s+)?{name}\s*(?::|=)"


def rewritten(text: str, page: str, pages: dict[str, str]) -> str:
    """A page whose links lead to staged pages, or as `source:PATH` to files of the clone."""

    def one(found: re.Match[str]) -> str:
        label, target = found.groups()
        return f"{label}({_target(label, target, page, pages)})"

    parts = FENCE.split(text)
    parts[::2] = [LINK.sub(one, part) for part in parts[::2]]
    return "".join(parts)


def _target(label: str, target: str, page: str, pages: dict[str, str]) -> str:
    path, _, fragment = target.partition("#")
    if not path or re.match(r"[a-z]+:", target):
        return target
    file = os.path.normpath(PurePosixPath(page).parent / path)
    if (ROOT / file).is_dir() and f"{file}/README.md" in pages:
        file = f"{file}/README.md"
    if file in pages:
        place = os.path.relpath(pages[file], PurePosixPath(pages[page]).parent)
        return place + (f"#{fragment}" if fragment else "")
    if file.startswith("docs/") and not file.endswith(".json"):
        return target
    return f"source:{file}{_line(label, ROOT / file)}"


def _line(label: str, file: Path) -> str:
    """`#L-12` if line 12 defines the name in the text of the link."""
    name = re.fullmatch(r"\[`(?:[\w:.]+(?:::|\.))?(\w+)`\]", label)
    if not name or not file.is_file():
        return ""
    pattern = re.compile(DEFINITION.format(name=re.escape(name[1])))
    lines = file.read_text(encoding="utf-8").splitlines()
    return next((f"#L-{i}" for i, line in enumerate(lines, 1) if pattern.search(line)), "")


class _Page(HTMLParser):
    """Names within a page, and addresses that it requests."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keeps `id`, `name`, `href` and `src`."""
        for key, value in attrs:
            if key in ("id", "name") and value:
                self.names.add(value)
            elif key in ("href", "src") and value and not (tag == "link" and "rel" in dict(attrs) and value == "#"):
                self.addresses.append(value)


def broken(site: Path, but: tuple[str, ...] = ("rust", "web")) -> Iterator[str]:
    """Broken links of the pages of a built site. The folders `but` are not read: one is not ours, one is a program."""
    pages = {
        file: _Page(file.read_text(encoding="utf-8"))
        for file in sorted(site.rglob("*.html"))
        if file.relative_to(site).parts[0] not in but
    }
    for file, page in pages.items():
        for address in page.addresses:
            if complaint := _complaint(address, file, pages):
                yield f"{file.relative_to(site)}: {address}: {complaint}"


def _complaint(address: str, file: Path, pages: dict[Path, _Page]) -> str | None:
    parts = urlsplit(address)
    if parts.scheme == "data":
        return None
    if parts.scheme or parts.netloc:
        return None if ADDRESS.fullmatch(address) else "not an address of https"
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if not target.is_file():
        return "no such file"
    is_named = not parts.fragment or target not in pages or unquote(parts.fragment) in pages[target].names
    return None if is_named else "no such place in the page"
