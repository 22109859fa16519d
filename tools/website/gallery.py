"""Animations of the gallery: the page has their commands, the site runs them."""

import hashlib
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from ballbot_rs import _core
from website.paths import ROOT

#: A block with one command that writes an animation into `gallery/`.
BLOCK = re.compile(r"^```sh\n(ballbot record [^`]*?-o (gallery/[\w-]+\.webp))\n```$", flags=re.MULTILINE)


def animated(text: str, folder: Path, cache: Path) -> str:
    """The page with each animation above the command that made it; `folder` is the page's folder."""

    def one(found: re.Match[str]) -> str:
        command, name = found.groups()
        made = _made(command.replace("\\\n", " "), cache)
        (folder / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(made, folder / name)
        title = text[: found.start()].rpartition("\n## ")[2].partition("\n")[0]
        return f"![{title}]({name})\n\n{found[0]}"

    return BLOCK.sub(one, text)


def _made(command: str, cache: Path) -> Path:
    """The file that a command writes, reused from an earlier build if the command and the extension are the same."""
    words = shlex.split(command)
    key = hashlib.sha256(f"{words}{Path(_core.__file__).stat().st_mtime_ns}".encode()).hexdigest()[:16]
    kept = cache / f"{key}.webp"
    if not kept.exists():
        cache.mkdir(parents=True, exist_ok=True)
        words[words.index("-o") + 1] = str(kept)
        recorded = [sys.executable, "-m", "ballbot_rs.cli", *words[1:], "--quiet"]
        subprocess.run(recorded, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return kept
