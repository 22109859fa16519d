"""What the pages' shell commands name is there: targets of make, tests of cargo, modules, files and extras.

test_readme.py tests command lines of `ballbot`.
"""

import re
import shlex
from collections.abc import Iterator

import pytest

from ballbot_rs import _toml
from tests.support.paths import ROOT

PAGES = ["README.md", "CONTRIBUTING.md", "examples/README.md"]
PAGES += sorted(page.relative_to(ROOT).as_posix() for page in (ROOT / "docs").rglob("*.md"))
EXTRAS = _toml.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
#: Of the shell, of git and of others, without names of ours.
FREE = ("cc", "git", "cd", "export", "wait", "for", "done", "maturin", "timeit", "venv", "http.server")


def commands(page: str) -> Iterator[str]:
    """The lines of a page's blocks for the shell, split at `&&`; a quotation over several lines is a single line."""
    for block in re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL):
        text = re.sub(r'"[^"]*"', lambda quoted: quoted[0].replace("\n", ";"), block.replace("\\\n", " "))
        for line in text.splitlines():
            yield from (part for part in re.split(r" && |; (?=done)", line.split("  #")[0].strip()) if part)


def sources(kind: str, name: str) -> str:
    """The text of a test or benchmark of the core, with its modules."""
    folder = {"--test": ROOT / "tests" / "rust", "--bench": ROOT / "benches"}[kind]
    files = [folder / f"{name}.rs", *(folder / name).rglob("*.rs")]
    return "".join(f"mod {file.stem};{file.read_text(encoding='utf-8')}" for file in files if file.is_file())


def missing(line: str) -> str | None:
    """What a command names and is not there."""
    words = shlex.split(line.removesuffix(" &"))
    program = words[0].rpartition("/")[2]
    options = dict(zip(words, [*words[1:], ""], strict=True))
    if program == "make":
        return None if re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), flags=re.MULTILINE) else words[1]
    if program == "cargo":
        kind = "--test" if "--test" in options else "--bench"
        text = sources(kind, options[kind])
        own, _, passed = " ".join(words[words.index(kind) + 2 :]).partition("--")
        # Names of benchmarks are made when they run.
        names = [*own.split(), *passed.split()] if kind == "--test" else []
        chosen = [name for name in names if not name.startswith("-")]
        parts = [(name, part) for name in chosen for part in name.split("::")]
        return next((name for name, part in parts if part not in text), None if text else options[kind])
    if program == "pip":
        extras = re.findall(r"\w+", line.partition("[")[2])
        return next((extra for extra in extras if extra not in EXTRAS), None)
    if program == "docker":
        return None if (ROOT / "Dockerfile").is_file() else program
    if program in ("python", "python3") and "-m" in options:
        module = options["-m"]
        file = ROOT / module.replace(".", "/")
        return None if module in FREE or file.is_dir() or file.with_suffix(".py").is_file() else module
    if program == "python" and words[1] == "-c":
        compile(words[2], line, "exec")
        return None
    if program in ("python", "pytest", "node"):
        return None if (ROOT / words[1]).is_file() else words[1]
    return None if program in ("ballbot", ".", "#", *FREE) else program


@pytest.mark.parametrize("page", [page for page in PAGES if list(commands(page))])
def test_what_the_commands_name_is_there(page: str) -> None:
    assert [(line, found) for line in commands(page) if (found := missing(line)) is not None] == []


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("make nothing", "nothing"),
        ("cargo test --test nothing", "nothing"),
        ("cargo test --test core laws::frobnicate -- --nocapture", "laws::frobnicate"),
        ("pip install -e '.[view,nothing]'", "nothing"),
        ("python -m validation.nothing", "validation.nothing"),
        ("python examples/nothing.py", "examples/nothing.py"),
        ("pytest tests/nothing.py -k x", "tests/nothing.py"),
        ("frobnicate --now", "frobnicate"),
    ],
)
def test_a_command_that_names_nothing_is_found(line: str, name: str) -> None:
    assert missing(line) == name
