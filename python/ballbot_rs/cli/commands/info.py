"""`ballbot info`: the machine and the installed packages, for a bug report."""

import argparse
import importlib.metadata
import json
import os
import platform
import re
import textwrap
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._core import MODELS, ROBOTS, TASKS
from ballbot_rs._machine import cpuinfo, processor, threads
from ballbot_rs._text_table import WIDTH
from ballbot_rs.control.resolve import NAMES

#: Optional packages.
LIBRARIES = (
    *("numpy", "scipy", "gymnasium", "stable-baselines3", "torch", "matplotlib", "moviepy", "rich", "tensorboard"),
    *("onnx", "onnxruntime", "onnxscript", "viser", "websockets", "trimesh", "yourdfpy", "pillow", "pygame"),
)
#: Processor features that affect the speed of the core.
FEATURES = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl", "asimd", "sve")


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("info", "for a bug report"),
    ("info --json", "for a program"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("info", help="print versions and the machine, for bug reports", examples=EXAMPLES)
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    found = collect()
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    for name, value in found.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {version or 'not installed'}" for key, version in value.items())
        elif isinstance(value, list):
            value = ", ".join(value) or "none found"
        line = f"{name.replace('_', ' '):<20} {value}"
        print(textwrap.fill(line, WIDTH, subsequent_indent=" " * 21, break_on_hyphens=False))


def collect() -> dict[str, Any]:
    """The printed facts, by name."""
    return {
        "ballbot_rs": __version__,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": f"{platform.system()} {platform.release()}",
        "machine": platform.machine(),
        "processor": processor(),
        "processor_features": _features(),
        "processors": os.cpu_count(),
        "threads": threads(),
        "models": list(MODELS),
        "robots": list(ROBOTS),
        "tasks": sorted(TASKS),
        "controllers": list(NAMES),
        "libraries": {name: _version(name) for name in LIBRARIES},
    }


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _features() -> list[str]:
    listed = re.search(r"^(?:flags|Features)\s*:\s*(.+)$", cpuinfo(), flags=re.MULTILINE)
    present = set(listed[1].split()) if listed else set()
    return [feature for feature in FEATURES if feature in present]
