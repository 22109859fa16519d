"""The folder that Sphinx reads: the pages of docs/, a few other pages, generated pages, and the menu."""

import functools
import html
import re
import shutil
from pathlib import Path

from website import api, controllers, gallery, notebooks, shell
from website.links import FENCE, LINK, rewritten
from website.paths import DOCS, ROOT, staged

SECTION = re.compile(r"^## (.+)$", flags=re.MULTILINE)
#: A scene of the page in the browser, invisible elsewhere, with the choices of its link.
SCENE = re.compile(r"^<!-- scene: (\S+) -->$", flags=re.MULTILINE)


def write(folder: Path, cache: Path, has_rust: bool, has_web: bool = False) -> None:
    """Writes everything from scratch; the core's documentation and the page in the browser will be next to it."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("*.md"))
    pages = staged()
    for origin, place in pages.items():
        text = (ROOT / origin).read_text(encoding="utf-8")
        file = folder / place
        file.parent.mkdir(parents=True, exist_ok=True)
        if origin.endswith(".ipynb"):
            text = notebooks.page(text)
        text = rewritten(text, origin, pages)
        text = _with_scenes(text, place, has_web)
        if "```mermaid" in text:
            # The drawing packages are installed only for the site.
            from website import diagrams

            text = diagrams.drawn(text, file.parent / "diagrams", cache)
        if place == "gallery.md":
            text = gallery.animated(text, file.parent, cache)
        file.write_text(shell.wrapped(text), encoding="utf-8")
    _write_all(folder / "api", api.pages(has_rust))
    laws = {place: _with_scenes(text, f"controllers/{place}", has_web) for place, text in controllers.pages().items()}
    _write_all(folder / "controllers", laws)
    with (folder / "index.md").open("a", encoding="utf-8") as index:
        index.write(menu((DOCS / "index.md").read_text(encoding="utf-8"), list(api.pages(has_rust))))
    for name, entries in (
        ("controllers/README.md", [page.removesuffix(".md") for page in controllers.pages() if page != "README.md"]),
        ("tasks/README.md", sorted(page.stem for page in (DOCS / "tasks").glob("*.md") if page.stem != "README")),
    ):
        with (folder / name).open("a", encoding="utf-8") as page:
            page.write(_toctree(None, entries))


def _with_scenes(text: str, place: str, has_web: bool) -> str:
    return SCENE.sub(functools.partial(_scene, depth=place.count("/")) if has_web else "", text)


def _scene(found: re.Match[str], depth: int) -> str:
    """A frame with the page in the browser."""
    address = f"{'../' * depth}web/index.html#panel=false&{html.escape(found[1])}"
    title = "A ballbot: click on the floor to send it, on the robot to push it"
    frame = f'<iframe class="scene" src="{address}" title="{title}" loading="lazy"></iframe>'
    return f"```{{raw}} html\n{frame}\n```"


def _write_all(folder: Path, pages: dict[str, str]) -> None:
    folder.mkdir(exist_ok=True)
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")


def listed(index: str) -> dict[str, list[str]]:
    """Pages that each section of docs/index.md links to, by the title of the section."""
    parts = SECTION.split("".join(FENCE.split(index)[::2]))
    places = staged()
    sections = {}
    for title, text in zip(parts[1::2], parts[2::2], strict=True):
        targets = [target.partition("#")[0] for _, target in LINK.findall(text)]
        origins = [_origin(target) for target in targets]
        sections[title] = list(dict.fromkeys(places[origin] for origin in origins if origin in places))
    return sections


def _origin(target: str) -> str:
    return target.removeprefix("../") if target.startswith("../") else f"docs/{target}"


def menu(index: str, reference: list[str]) -> str:
    """The menu from the sections of docs/index.md, with the generated pages; API pages by name."""
    sections = {title: [page.removesuffix(".md") for page in pages] for title, pages in listed(index).items()}
    text = ""
    for title, pages in sections.items():
        if title == "Control":
            pages = [*pages, "controllers/README"]
        text += _toctree(title, pages)
    return text + _toctree("Reference of the API", [f"api/{name.partition('.')[0]}" for name in reference])


def _toctree(caption: str | None, entries: list[str]) -> str:
    title = f":caption: {caption}\n" if caption else ""
    return f"\n```{{toctree}}\n:hidden:\n{title}\n" + "\n".join(entries) + "\n```\n"
