"""Installs each client into a separate environment, runs its program, and prints a table.

`python -m consumers WHEEL [--seconds 60] [--only skrl ...] [--keep] [--page docs/learners.md]`, or `make consumers`.
An environment with PyTorch has up to 6 GB, so each is removed when its program has ended, unless `--keep` is given.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any, Final

from consumers.clients import CLIENTS, Client

ROOT: Final = Path(__file__).parents[1]
ENVIRONMENTS: Final = ROOT / "target" / "consumers"

#: In addition to the training: the slowest installation, and the rollouts of all tasks, s.
INSTALL_LIMIT: Final = 1800
RUN_LIMIT: Final = 300

#: Where the table of the page is.
BEGIN, END = "<!-- table of make consumers -->\n", "<!-- end of table -->\n"
HEADER: Final = "| client | environment | steps/s | steps | upright | success | |\n|---|---|---|---|---|---|---|\n"


def environment(client: Client, wheel: Path) -> Path:
    """The interpreter of a client's environment, made again if its requirements or the wheel changed."""
    folder = ENVIRONMENTS / client.program
    requirements = ROOT / "consumers" / "requirements" / f"{client.program}.txt"
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    pinned = requirements.read_text(encoding="utf-8")
    made, stamp = folder / "made-from.txt", f"{pinned}{wheel.name} {wheel.stat().st_mtime_ns}"
    if made.is_file() and made.read_text() == stamp:
        return python
    venv.create(folder, clear=True, with_pip=True)
    # The versions of our tests, except for packages that a client pins.
    others = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    own = {_name(line) for line in pinned.splitlines()}
    constraints = folder / "constraints.txt"
    constraints.write_text("\n".join(line for line in others if _name(line) not in own) + "\n", encoding="utf-8")
    command = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--constraint", str(constraints), "--requirement", str(requirements), str(wheel)]
    subprocess.run(command, check=True, timeout=INSTALL_LIMIT)
    made.write_text(stamp)
    return python


def _name(line: str) -> str:
    return line.partition("==")[0].strip().lower().replace("_", "-")


def run(client: Client, wheel: Path, seconds: float) -> dict[str, Any]:
    """What a client's program prints as its last line; `error` states why there is none, or that it did not learn."""
    try:
        python = environment(client, wheel)
        done = subprocess.run(
            [str(python), "-m", f"consumers.with_{client.program}", str(seconds)],
            # The folder does not contain ballbot_rs: the import finds the package of the wheel.
            cwd=ROOT,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=seconds + RUN_LIMIT,
            check=False,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        return {"error": str(error)}
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"steps"')]
    result: dict[str, Any] = json.loads(lines[-1]) if lines else {}
    if done.returncode != 0:
        result["error"] = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return result


def rows(results: dict[Client, dict[str, Any]]) -> dict[str, str]:
    """One row a client, as Markdown, by the client's name."""
    found_rows = {}
    for client, found in results.items():
        numbers = ["", "", "", ""]
        if "steps" in found:
            shares = ["" if found[name] is None else f"{found[name]:.0%}" for name in ("upright", "success")]
            numbers = [f"{found['steps'] / found['seconds']:,.0f}", f"{found['steps']:,}", *shares]
        remark = found.get("error") or found.get("note", "")
        found_rows[client.name] = f"| {client.name} | {client.through} | {' | '.join(numbers)} | {remark} |\n"
    return found_rows


def table(known: dict[str, str]) -> str:
    """The rows in the order of the clients, below their names."""
    return HEADER + "".join(known[client.name] for client in CLIENTS if client.name in known)


def updated(page: str, new: dict[str, str]) -> str:
    """A page with new rows in its table; rows of other clients stay."""
    before, _, rest = page.partition(BEGIN)
    old, _, after = rest.partition(END)
    kept = {line.split("|")[1].strip(): f"{line}\n" for line in old.splitlines() if line.startswith("| ")}
    return before + BEGIN + table({**kept, **new}) + END + after


def main() -> int:
    """Fails if a client does."""
    parser = argparse.ArgumentParser(prog="python -m consumers", description=__doc__)
    programs = [client.program for client in CLIENTS]
    parser.add_argument("wheel", type=Path, help="of ballbot_rs")
    parser.add_argument("--seconds", type=float, default=60.0, help="of training each (default 60)")
    parser.add_argument("--only", nargs="+", choices=programs, default=programs, metavar="CLIENT", help=str(programs))
    parser.add_argument("--keep", action="store_true", help="leave the environments for the next time")
    parser.add_argument("--page", type=Path, help="a page whose table gets the rows")
    arguments = parser.parse_args()
    results = {}
    for client in CLIENTS:
        if client.program in arguments.only:
            print(f"{client.name} ...", file=sys.stderr, flush=True)
            results[client] = run(client, arguments.wheel.resolve(), arguments.seconds)
            if not arguments.keep:
                shutil.rmtree(ENVIRONMENTS / client.program, ignore_errors=True)
    found = rows(results)
    print(table(found))
    if arguments.page is not None:
        page = arguments.page.read_text(encoding="utf-8")
        arguments.page.write_text(updated(page, found), encoding="utf-8")
    return 1 if any("error" in found for found in results.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
