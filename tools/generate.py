"""Writes the files generated from tables: task classes, types of their options, the stub, docs/tasks, badges.

`python tools/generate.py` writes the files; with `--check` it fails if one of them is stale.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "python")]

from generate import badges, classes, pages, stub, tables  # noqa: E402


def files() -> dict[Path, str]:
    """The content of every generated file."""
    package = ROOT / "python" / "ballbot_rs"
    core = package / "_core.pyi"
    docs = ROOT / "docs"
    stages = {stage[2] for stage in tables.STAGES}
    return {
        package / "envs" / "options.py": classes.options(),
        package / "envs" / "tasks.py": classes.tasks(),
        core: stub.filled(core.read_text(encoding="utf-8")),
        **{docs / page: pages.with_options(page, (docs / page).read_text(encoding="utf-8")) for page in stages},
        **{docs / "tasks" / name: text for name, text in pages.pages().items()},
        **{docs / "badges" / name: text for name, text in badges.badges().items()},
    }


def main() -> int:
    """Writes or checks the files; returns the exit code."""
    parser = argparse.ArgumentParser(description="Write what follows from the core's tables.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if a file is stale")
    is_check = parser.parse_args().check
    stale = []
    for path, text in files().items():
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale.append(str(path.relative_to(ROOT)))
        if not is_check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    if is_check and stale:
        print(f"stale: {', '.join(stale)}; `make generate` writes them", file=sys.stderr)
        return 1
    if not is_check:
        print("\n".join(f"wrote {name}" for name in stale) or "nothing has changed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
