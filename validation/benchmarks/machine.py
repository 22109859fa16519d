"""Hardware and software of the measurements."""

import datetime
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import ballbot_rs as bb
from validation.benchmarks.worker import cores

_PACKAGES = ("numpy", "gymnasium", "stable-baselines3", "torch", "mujoco", "pybullet")


def describe(command: str) -> dict[str, Any]:
    """Processor, operating system, versions, date, command and the load before the run."""
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command,
        "processor": _processor(),
        "cores": len(cores()),
        "memory_gib": _memory_gib(),
        "system": f"{platform.system()} {platform.release().split('-')[0]} {platform.machine()}",
        "load_before": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "versions": {"ballbot-rs": bb.__version__, "python": platform.python_version(), "rustc": _rustc()}
        | {package: _version(package) for package in _PACKAGES},
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (ValueError, AttributeError, OSError):
        return None


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _rustc() -> str:
    try:
        done = subprocess.run(["rustc", "--version"], capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return done.stdout.removeprefix("rustc").split("(")[0].strip() or "unknown"
