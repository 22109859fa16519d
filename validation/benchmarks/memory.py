"""Memory per additional robot: growth of the resident set over many robots, in a separate process."""

import gc
import os
import sys
from pathlib import Path
from typing import Any

from validation.benchmarks import simulators
from validation.benchmarks.ours import known_models
from validation.benchmarks.throughput import EXTERNAL
from validation.benchmarks.worker import in_child
from validation.engines.installed import missing


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of simulator, robots and bytes per robot, or the reason of absence."""
    many = 1024 if quick else 4096
    plan = [(f"ours:{model}", many) for model in known_models()]
    plan += [("mujoco-batch", many), ("mujoco-dummy", 256), ("pybullet-dummy", 64)]
    rows = []
    for name, robots in plan:
        print(f"memory: {name}", flush=True)
        row: dict[str, Any] = {"simulator": name, "robots": robots}
        reason = missing(EXTERNAL[name][0]) if name in EXTERNAL else None
        try:
            row |= {"reason": reason} if reason else in_child("memory:measure_here", pinned=True, **row)
        except Exception as error:
            row["reason"] = str(error)
        rows.append(row)
    return rows


def measure_here(simulator: str, robots: int) -> dict[str, Any]:
    """Bytes per robot: growth by `robots` robots after a step, once a few have made the process load everything."""
    few = simulators.environment(simulator, 4, 1)
    few.run()
    gc.collect()
    before = resident_bytes()
    many = simulators.environment(simulator, robots, 1)
    many.run()
    grown = resident_bytes() - before
    many.close()
    few.close()
    return {"bytes_per_robot": grown / robots}


def resident_bytes() -> int:
    """Resident set of this process, bytes; its peak where there is no procfs."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
