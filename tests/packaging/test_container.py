"""The Dockerfile names what is there; no test builds an image."""

import re
import subprocess
from fnmatch import fnmatch

from ballbot_rs import _toml
from tests.support.paths import ROOT

DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def test_its_extras_match_the_package():
    (extras,) = re.findall(r"\.whl\)\[(.*?)\]", DOCKERFILE)
    known = _toml.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert {"train", "view", "export"} <= set(extras.split(",")) <= set(known)


def test_what_it_copies_is_there_and_nothing_of_the_repository_is_left_out():
    for sources in re.findall(r"^COPY (?!--from)(.*) \S+$", DOCKERFILE, flags=re.MULTILINE):
        assert all((ROOT / source).exists() for source in sources.split())
    ignored = (ROOT / ".dockerignore").read_text().split()
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    patterns = [pattern.removeprefix("**/") for pattern in ignored]
    lost = [file for file in files for pattern in patterns if fnmatch(file, pattern) or file.startswith(f"{pattern}/")]
    assert lost == []


def test_the_compiler_is_new_enough():
    needed = _toml.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["rust-version"]
    (tag,) = re.findall(r"^FROM rust:(\S+?)-slim", DOCKERFILE, flags=re.MULTILINE)
    # `1` is the newest version.
    assert tag == "1" or [int(part) for part in tag.split(".")] >= [int(part) for part in needed.split(".")]
