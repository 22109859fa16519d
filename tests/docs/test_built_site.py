"""The site as a browser has it: nothing fails to load, nothing is wider than the window.

BALLBOT_SITE names a built site; without it a site is built, in two minutes. Skipped without the extra `site`.
"""

import importlib.util
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.chromium import Chromium, find_browser
from tests.support.serving import serving

BROWSER = find_browser()
if BROWSER is None:
    pytest.skip("no Chromium: the site is not looked at", allow_module_level=True)
if importlib.util.find_spec("sphinx") is None and "BALLBOT_SITE" not in os.environ:
    pytest.skip(
        "Sphinx is missing: pip install -e '.[site]', or BALLBOT_SITE names a built site", allow_module_level=True
    )

WIDE, NARROW = (1400, 900), (390, 844)
#: Folders that are not looked at page by page: the documentation of the core is not ours, files are alike.
ELSEWHERE = ("rust", "source", "_static", "_sources")


#: What is wider than the window and in no box that scrolls.
TOO_WIDE = """
[...document.querySelectorAll('article *')].filter(element => {
  const box = element.getBoundingClientRect();
  if (!box.width || box.right <= innerWidth + 1) return false;
  for (let outer = element; outer.tagName !== 'ARTICLE'; outer = outer.parentElement)
    if (getComputedStyle(outer).overflowX !== 'visible') return false;
  return true;
}).map(element => `${element.tagName} ${element.textContent.slice(0, 80)}`)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if "BALLBOT_SITE" in os.environ:
        return Path(os.environ["BALLBOT_SITE"]).resolve()
    from tools.build_site import build

    folder = tmp_path_factory.mktemp("built") / "site"
    assert build(folder, folder.with_name("no-rust")) == 0
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    assert BROWSER is not None
    chromium = Chromium(BROWSER, tmp_path_factory.mktemp("browser"))
    yield chromium
    chromium.close()


@pytest.fixture(scope="module")
def root(site: Path) -> Iterator[str]:
    # From files, browsers do not load the modules of scenes.
    with serving(site) as address:
        yield address


def opened(browser: Chromium, address: str, size: tuple[int, int] = WIDE) -> None:
    """Opens a page and clears earlier messages."""
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=size == NARROW
    )
    browser.errors.clear()
    browser.call("Page.navigate", url=address)
    browser.wait_for(f"location.href == {json.dumps(address)} && document.readyState == 'complete'")


@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_every_page_loads_whole_and_fits(size: tuple[int, int], site: Path, root: str, browser: Chromium) -> None:
    pages = [page.relative_to(site) for page in sorted(site.rglob("*.html"))]
    shown = [page.as_posix() for page in pages if page.parts[0] not in ELSEWHERE]
    assert len(shown) > 60
    for page in [*shown, "source/crates/ballbot-base/src/state.rs.html"]:
        opened(browser, root + page, size)
        # Pictures below the window would be loaded later.
        browser.evaluate("document.querySelectorAll('img').forEach(image => { image.loading = 'eager'; })")
        browser.wait_for("[...document.images].every(image => image.complete)")
        lost = "[...document.images].filter(image => !image.naturalWidth).map(image => image.src)"
        requests = browser.evaluate("performance.getEntriesByType('resource').map(entry => entry.name)")
        assert browser.evaluate(lost) == [], page
        assert browser.evaluate(TOO_WIDE) == [], page
        assert browser.evaluate("document.documentElement.scrollWidth") <= size[0], page
        assert browser.errors == [], page
        assert [name for name in requests if not name.startswith((root, "data:"))] == [], page


@pytest.mark.parametrize("page", ["derivations.html", "laws.html", "references.html", "verification.html"])
def test_formulas_are_rendered_and_none_is_left_as_text(page: str, root: str, browser: Chromium) -> None:
    opened(browser, root + page)
    assert browser.evaluate("document.querySelectorAll('math').length") > 10
    heights = "[...document.querySelectorAll('.formula math')].map(m => m.getBoundingClientRect().height)"
    assert min(browser.evaluate(heights)) > 10
    prose = browser.evaluate(
        "(copy => { copy.querySelectorAll('pre, code, math').forEach(e => e.remove()); return copy.innerText; })"
        "(document.querySelector('article').cloneNode(true))"
    )
    assert not [word for word in ("$", "\\cr", "\\frac", "\\begin", "```") if word in prose]


@pytest.mark.parametrize(
    ("word", "page"), [("gyroscope", "sensors"), ("Riccati", "laws"), ("holdable", "api/analysis")]
)
def test_the_search_finds(word: str, page: str, root: str, browser: Chromium) -> None:
    opened(browser, f"{root}index.html")
    browser.evaluate("document.querySelector('.sidebar-search').focus()")
    browser.type_text(word)
    browser.evaluate("document.querySelector('.sidebar-search').form.requestSubmit()")
    browser.wait_for("document.querySelectorAll('#search-results li a').length")
    found = "[...document.querySelectorAll('#search-results li a')].map(link => link.getAttribute('href'))"
    browser.wait_for(f"{found}.some(address => address.startsWith('{page}.html'))")
    assert browser.errors == []


def test_dark_mode_is_dark_and_stays(root: str, browser: Chromium) -> None:
    background = "getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).slice(0, 3).map(Number)"
    opened(browser, f"{root}index.html")
    seen = set()
    for _ in range(3):
        browser.evaluate("document.querySelector('.theme-toggle').click()")
        theme = browser.evaluate("document.body.dataset.theme")
        seen.add(theme)
        if theme == "dark":
            assert max(browser.evaluate(background)) < 64
            opened(browser, f"{root}derivations.html")
            assert browser.evaluate("document.body.dataset.theme") == "dark"
            assert max(browser.evaluate(background)) < 64
    assert seen == {"dark", "light", "auto"}
    browser.evaluate("localStorage.clear()")
