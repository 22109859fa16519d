"""`ballbot list`: the names that other arguments take, with a description of each."""

import argparse
import collections
import json
import shutil
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _assets
from ballbot_rs._core import ACTUATORS, EVENT_SETS, MODELS, ROBOTS, SENSORS, TASKS, Params, terrain_kinds
from ballbot_rs._text_table import WIDTH
from ballbot_rs.control.catalog import controllers
from ballbot_rs.envs.registration import description_of, known_tasks

#: One line for each model; the README has more.
SUMMARIES_OF_MODELS: Final = {
    "planar": "the paper's equations, three decoupled planes",
    "spatial": "coupled motion without slip",
    "contact": "contacts with friction: slip, lift-off and falls; the default",
    "rigid": "rigid bodies in a general engine, to check contact",
}

#: What policies do beyond their task, by the variant in the file's name, else the task.
_BEYOND: Final = {
    "any": ", for a robot of any size, named by --robot, from the readings of its sensors",
    "recover": ", from tilts up to 30 deg and after pushes up to 2.2 N·s",
    "ride": ", on a robot of 60 kg in all",
}


def _robots() -> dict[str, str]:
    presets = {name: Params.preset(name) for name in ROBOTS}
    return {
        name: f"body {one.body_mass:.1f} kg, center of mass {one.body_com_height:.2f} m above the center of a ball of "
        f"{one.ball_mass:.1f} kg and radius {one.ball_radius:.3f} m; up to {one.max_wheel_torque:g} N·m a wheel"
        for name, one in presets.items()
    }


def _controllers() -> dict[str, str]:
    return {**{name: one.summary for name, one in controllers().items()}, "zero": "No torque."}


def _terrains() -> dict[str, str]:
    kinds = terrain_kinds()
    counted = collections.Counter(key for keys in kinds.values() for key in keys)
    # Fields that most kinds have, such as their size, do not identify one.
    shared = {key for key, count in counted.items() if 2 * count > len(kinds)} - {"slope", "wavelength"}
    return {
        name: ", ".join(
            f"{key} {one['default']:g}{one['unit'] and ' ' + one['unit']}"
            for key, one in keys.items()
            if key not in shared
        )
        for name, keys in kinds.items()
    }


def policies() -> dict[str, str]:
    """Path and task of each policy that comes with the package."""
    found = sorted(_assets.path("policies").glob("*.onnx"))
    return {_shortest(path): _summary_of_policy(path.stem) for path in found}


def _summary_of_policy(name: str) -> str:
    task, _, variant = name.partition("-")
    text: str = TASKS[task]["summary"]
    return f"{text.removesuffix('.')}{_BEYOND.get(variant or task, '')}."


def _shortest(path: Path) -> str:
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


#: Kinds of things by title: the argument that takes them, and their names with a text each.
KINDS: Final[Mapping[str, tuple[str, Callable[[], Mapping[str, str]]]]] = {
    "tasks": ("TASK", lambda: {name: description_of(name)["summary"] for name in known_tasks()}),
    "robots": ("--robot", _robots),
    "models": ("--model", lambda: {name: SUMMARIES_OF_MODELS[name] for name in MODELS}),
    "controllers": ("--controller", _controllers),
    "policies": ("--controller", policies),
    "terrains": ("--set terrain", _terrains),
    "actuators": ("--actuators", lambda: dict.fromkeys(ACTUATORS, "")),
    "sensors": ("--sensors", lambda: dict.fromkeys(SENSORS, "")),
    "events": ("--events", lambda: dict.fromkeys(EVENT_SETS, "")),
}


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("list", "all names"),
    ("list controllers", "of one kind"),
    ("list policies --json", "for a program"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("list", help=f"list {', '.join(KINDS)}", examples=EXAMPLES)
    command.add_argument("kind", nargs="?", choices=tuple(KINDS), metavar="KIND", help=f"{', '.join(KINDS)} (all)")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    chosen = KINDS if arguments.kind is None else {arguments.kind: KINDS[arguments.kind]}
    found = {kind: dict(names()) for kind, (_, names) in chosen.items()}
    if arguments.json:
        print(json.dumps(found, indent=2))
        return
    width = min(WIDTH, shutil.get_terminal_size((WIDTH, 24)).columns)
    for kind, texts in found.items():
        if len(found) > 1:
            print(f"{kind} ({KINDS[kind][0]})")
        column = max(map(len, texts)) + 2
        for name, text in texts.items():
            line = f"  {name.ljust(column)}{text}".rstrip()
            print(textwrap.fill(line, width, subsequent_indent=" " * (column + 2), break_on_hyphens=False))
        if len(found) > 1:
            print()
