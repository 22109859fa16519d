"""A measurement in a separate process, with its own memory, on given cores and threads.

`python -m validation.benchmarks.worker function result.json '{"argument": ...}'`, started by `in_child`.
"""

import importlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

#: Linear algebra libraries start their own threads, which no simulator here uses.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def cores() -> list[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def in_child(function: str, *, pinned: bool, timeout: float = 900.0, **arguments: Any) -> Any:
    """Result of `validation.benchmarks.<module>:<function>` in a fresh process, on one core if `pinned`.

    Raises:
        RuntimeError: it failed; the message has the end of what it printed.
    """
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        command = [sys.executable, "-m", "validation.benchmarks.worker", function, str(result), str(int(pinned))]
        # Engines print to the same descriptor from C: only a failure shows it.
        done = subprocess.run(
            [*command, json.dumps(arguments)],
            env=os.environ | _ONE_THREAD,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=timeout,
            check=False,
        )
        if done.returncode != 0:
            lines = done.stdout.decode(errors="replace").strip().splitlines()
            raise RuntimeError(lines[-1] if lines else f"exit code {done.returncode}")
        return json.loads(result.read_text(encoding="utf-8"))


def main() -> None:
    """Runs one function with the given arguments."""
    name, result, pinned, arguments = sys.argv[1:]
    if int(pinned) and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores()[-1]})
    module, function = name.split(":")
    found = getattr(importlib.import_module(f"validation.benchmarks.{module}"), function)(**json.loads(arguments))
    Path(result).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main()
