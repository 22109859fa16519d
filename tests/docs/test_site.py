"""What the site is made of, without building it: the menu, the reference of the API, links, generated pages."""

import shlex
from pathlib import Path

import pytest

import ballbot_rs as bb
from ballbot_rs.cli import parser
from tests.docs.test_readme import blocks
from tests.support.paths import ROOT
from website import api, controllers, gallery, links, shell, stage
from website.paths import staged

PAGES = staged()
INDEX = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")


def test_every_page_is_in_one_section_of_the_index() -> None:
    listed = [page for pages in stage.listed(INDEX).values() for page in pages]
    generated = {page for page in PAGES.values() if page.startswith("tasks/") and page != "tasks/README.md"}
    assert sorted(listed) == sorted(set(PAGES.values()) - generated - {"index.md"})


def test_every_public_name_is_in_one_group_of_the_reference() -> None:
    names = [name for _, group in api.GROUPS.values() for name in group]
    assert sorted(names) == sorted(bb.__all__)


def test_every_controller_has_a_page_whose_blocks_run(tmp_path: Path) -> None:
    pages = controllers.pages()
    assert {"README.md", *(f"{name}.md" for name in bb.controllers())} == set(pages)
    for name, text in pages.items():
        page = tmp_path / name
        page.write_text(text, encoding="utf-8")
        for block in blocks(str(page)):
            exec(compile(block, name, "exec"), {})
        for line in text.splitlines():
            if line.startswith("ballbot "):
                assert callable(parser().parse_args(shlex.split(line)[1:]).carry_out)
    assert "| `position` | m | 0.15 |" in pages["lqr.md"]


def test_the_laws_have_a_heading_for_every_controller() -> None:
    headings = (ROOT / "docs" / "laws.md").read_text(encoding="utf-8").splitlines()
    assert not {f"## `{name}`" for name in bb.controllers()} - set(headings)


def test_every_animation_of_the_gallery_has_its_command() -> None:
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert len(gallery.BLOCK.findall(text)) == text.count("-o gallery/") > 3


@pytest.mark.parametrize(
    ("page", "link", "expected"),
    [
        ("docs/laws.md", "[a](controllers.md#the-matrix)", "[a](controllers.md#the-matrix)"),
        ("docs/tasks/goal.md", "[a](../laws.md)", "[a](../laws.md)"),
        ("docs/index.md", "[a](../CHANGELOG.md)", "[a](changelog.md)"),
        ("docs/learners.md", "[a](../consumers)", "[a](source:consumers)"),
        ("examples/README.md", "[a](terrain.py)", "[a](source:examples/terrain.py)"),
        ("docs/index.md", "![a](push.webp)", "![a](push.webp)"),
        ("docs/index.md", "[a](https://example.org/b)", "[a](https://example.org/b)"),
        ("docs/index.md", "```\n[a](../README.md)\n```", "```\n[a](../README.md)\n```"),
    ],
)
def test_links_lead_to_pages_of_the_site_or_to_files_of_the_clone(page: str, link: str, expected: str) -> None:
    assert links.rewritten(link, page, PAGES) == expected


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("ballbot list  # names", ["ballbot list  # names"]),
        (
            f"ballbot view --robot {'a' * 40}.toml      # a comment that makes the line long",
            ["# a comment that makes the line long", f"ballbot view --robot {'a' * 40}.toml"],
        ),
        (
            f"ballbot record --push 0.3 0 -1 --output {'a' * 50}.mp4 --seconds 4",
            ["ballbot record --push 0.3 0 -1 \\", f"    --output {'a' * 50}.mp4 --seconds 4"],
        ),
        (
            f'ballbot link "exec:{"a" * 60} --serial stdio" --robot kugle --seconds 4',
            [f'ballbot link "exec:{"a" * 60} --serial stdio" \\', "    --robot kugle --seconds 4"],
        ),
    ],
)
def test_long_commands_are_broken_before_options(line: str, expected: list[str]) -> None:
    shown = shell.wrapped(f"```sh\n{line}\n```").splitlines()[1:-1]
    assert shown == expected
    together = " ".join(part.removesuffix("\\").strip() for part in shown if not part.startswith("#"))
    assert shlex.split(together, comments=True) == shlex.split(line, comments=True)


def test_a_link_to_a_name_leads_to_its_line() -> None:
    file = "crates/ballbot-control/src/controllers/lqr.rs"
    rewritten = links.rewritten(f"[`Lqr`](../{file})", "docs/laws.md", PAGES)
    line = int(rewritten.partition("#L-")[2].rstrip(")"))
    assert "pub struct Lqr" in (ROOT / file).read_text(encoding="utf-8").splitlines()[line - 1]


@pytest.mark.parametrize(
    ("element", "complaint"),
    [
        ('<a href="other.html#here">', None),
        ('<a href="other.html#there">', "no such place"),
        ('<a href="gone.html">', "no such file"),
        ('<img src="gone.svg">', "no such file"),
        ('<a href="https://example.org/a?b=c">', None),
        ('<a href="http://example.org">', "not an address of https"),
        ('<a href="https://nothing">', "not an address of https"),
    ],
)
def test_links_of_the_built_site_that_lead_nowhere_are_found(
    element: str, complaint: str | None, tmp_path: Path
) -> None:
    (tmp_path / "index.html").write_text(element, encoding="utf-8")
    (tmp_path / "other.html").write_text('<p id="here">', encoding="utf-8")
    found = list(links.broken(tmp_path))
    assert found == [] if complaint is None else complaint in found[0]
