"""Builds the site of docs/ into target/site: `make site`.

Needs the extra `site`. Nothing is fetched, and the site makes no requests to other hosts.
"""

import argparse
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "python")]

from sphinx.cmd.build import main as sphinx  # noqa: E402

from website import font, links, stage  # noqa: E402


def build(site: Path, rust: Path) -> int:
    """Builds the site, with the core's documentation from the folder `rust`; returns the exit code."""
    work = site.with_name(f"{site.name}-build")
    shutil.rmtree(site, ignore_errors=True)
    has_rust = (rust / "ballbot_core").is_dir()
    web = ROOT / "target" / "web" / "page"
    has_web = (web / "index.html").is_file()
    stage.write(work / "source", work / "cache", has_rust, has_web)
    conf = ROOT / "tools" / "website"
    static = work / "static"
    font.write(static / "mathematics.css")
    options = [
        "-q",
        "-D",
        f"html_static_path=static,{static}",
        "-b",
        "html",
        "-W",
        "--keep-going",
        "-c",
        str(conf),
        "-d",
        str(work / "doctrees"),
    ]
    if code := sphinx([*options, str(work / "source"), str(site)]):
        return code
    if has_rust:
        shutil.copytree(rust, site / "rust", ignore=shutil.ignore_patterns(".lock"))
    else:
        print(f"no documentation of the core in {rust}: `make docs` writes it", file=sys.stderr)
    if has_web:
        shutil.copytree(web, site / "web")
    else:
        print(f"no page in {web}: `make web` builds it, and scenes are left out", file=sys.stderr)
    complaints = list(links.broken(site))
    print("\n".join(complaints), file=sys.stderr)
    return 1 if complaints else 0


def main() -> int:
    """Builds the site; returns the exit code."""
    parser = argparse.ArgumentParser(description="Build the site of docs/.")
    parser.add_argument(
        "--site", type=Path, default=ROOT / "target" / "site", help="where it goes (default target/site)"
    )
    parser.add_argument("--rust", type=Path, default=ROOT / "target" / "doc", help="what `cargo doc` wrote")
    chosen = parser.parse_args()
    code = build(chosen.site.resolve(), chosen.rust.resolve())
    if code == 0:
        print(f"{sum(1 for _ in chosen.site.rglob('*.html'))} pages: {chosen.site / 'index.html'}")
    return code


if __name__ == "__main__":
    sys.exit(main())
