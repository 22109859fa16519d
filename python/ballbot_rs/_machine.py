"""This machine: its processor, and how much of it this process may use."""

import os
import platform
import re
from pathlib import Path


def threads() -> int | None:
    """Number of threads that this process may run at once."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count()


def cpuinfo() -> str:
    """The kernel's report on the processors; empty where there is none."""
    try:
        return Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def processor() -> str:
    """Name of the processor."""
    named = re.search(r"^model name\s*:\s*(.+)$", cpuinfo(), flags=re.MULTILINE)
    return named[1] if named else platform.processor() or "unknown"


def described() -> str:
    """One line: processor, threads, system."""
    return f"{processor()}, {threads()} threads, {platform.system()} {platform.release()} {platform.machine()}"
