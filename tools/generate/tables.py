"""The tables of the tasks as rows of text."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

from ballbot_rs._core import (
    ACTUATOR_OPTIONS,
    ACTUATORS,
    CONTROLLERS,
    ENVIRONMENT_OPTIONS,
    EVENT_SETS,
    INSTRUMENTS,
    MODELS,
    OBSERVATIONS,
    ROBOTS,
    SENSOR_OPTIONS,
    SENSORS,
    TASKS,
    Batch,
)

#: Options that may be None in Python only, and the meaning of None.
_NONE = {"max_episode_steps": "never"}


def _scalar(option: Any) -> tuple[str, str, str, str, str]:
    """Name, type, unit, limit and description of an option that is a single number."""
    name, kind, doc = option["name"], option["type"], option["doc"]
    if name in _NONE:
        kind, doc = f"{kind} | None", f"{doc.removesuffix('.')}; None: {_NONE[name]}."
    return name, kind, option["unit"], option["limit"], doc


_SCALARS = tuple(map(_scalar, ENVIRONMENT_OPTIONS))


def instrument_class(name: str) -> str:
    """The name of the type of an instrument's options: range_finder becomes RangeFinder."""
    return name.title().replace("_", "")


#: Marks a default that scales with the robot.
SCALED = ", scaled"

#: Options that every task has: name, type, unit, limit, description. Defaults are a batch's defaults.
COMMON = (
    ("robot", "Params | str | PathLike[str] | Mapping[str, Any] | Sequence[Any] | None", "",
     f"{', '.join(ROBOTS)}, or FILE.toml",
     "The robot: parameters, the name of a preset, the path of a TOML file, or a dict of parameters. Several robots, "
     "each on eight neighbors, are a list, or `{'family': COUNT, 'seed': SEED}`."),
    ("model", "Model | str | None", "", ", ".join(MODELS), "Model of the robot."),
    *_SCALARS,
    ("history", "int | Sequence[int]", "", ">= 1 and <= 1000; ages: ascending from 0, at most 1000",
     "How many of the last observations are stacked, or their ages in control steps, as [0, 1, 2, 4, 8]: oldest "
     "first. docs/sensors.md."),
    ("terrain", "Terrain | str | Mapping[str, Any] | None", "",
     "a Terrain, the name of a kind, or a dict with `kind`, `seed` and parameters",
     "The ground; None: the task's default, level for most. Starts touch it and lean as it does; an episode that "
     "leaves it is truncated. docs/terrain.md."),
    ("actuators", "Actuators | str | PathLike[str] | None", "", f"{', '.join(ACTUATORS)}, FILE.toml, or FILE.urdf",
     "The motors: options, a name, or the path of a TOML file or a URDF; None: ideal motors. docs/actuators.md."),
    ("sensors", "Sensors | str | PathLike[str] | None", "", f"{', '.join(SENSORS)}, or FILE.toml",
     "The sensors: options, a name, or the path of a TOML file; None: none. docs/sensors.md."),
    *((name, f"{instrument_class(name)} | None", "", "options",
       f"{known['title']}, whose numbers follow the rows of the observation; None: none. docs/perception.md.")
      for name, known in INSTRUMENTS.items()),
    ("level", "int | str | None", "", "a level of the terrain, curriculum, or None",
     "Level of the tiles that episodes begin on, on a terrain with tiles; None: any. docs/terrain.md."),
    ("observation", "Observed | str | None", "", ", ".join(OBSERVATIONS),
     "What policies and controllers observe: the true state, or what follows from the readings of the sensors."),
    ("reward", "Mapping[str, float | Function | str]", "",
     "finite scales, functions, or their names as module:function",
     "Scales of the task's reward terms, and functions of further terms, by name; docs/own_tasks.md."),
    ("rows", "Mapping[str, Function | str] | None", "", "functions, or their names as module:function",
     "Functions of further rows of the observation, by name; docs/own_tasks.md."),
    ("terminations", "Mapping[str, Function | str] | None", "", "functions, or their names as module:function",
     "Functions of further reasons for termination, by name; docs/own_tasks.md."),
    ("events", "str | PathLike[str] | Mapping[str, Any] | Sequence[Mapping[str, Any]] | None", "",
     f"{', '.join(EVENT_SETS)}, FILE.toml, or a list of dicts",
     "Random properties of the robots, and pushes; `docs/randomization.md`."),
)  # fmt: skip


#: Types of options that are tables: name, description, page, the text before the table, and rows.
STAGES = (
    ("Actuators", "motors", "actuators.md", "", ACTUATOR_OPTIONS),
    ("Sensors", "sensors", "sensors.md", "", SENSOR_OPTIONS),
    *(
        (
            instrument_class(name),
            f"the instrument `{name}`",
            "perception.md",
            f"## {known['title']}\n\nOption `{name}`. {known['about']}\n\n",
            known["options"],
        )
        for name, known in INSTRUMENTS.items()
    ),
)


def number(value: float) -> str:
    """A number as in the documentation."""
    if value == math.pi:
        return "pi"
    return f"{value:.6g}" if value else "0"


def values(default: Any) -> str:
    """A default: one number or several."""
    return f"({', '.join(map(number, default))})" if isinstance(default, list) else number(default)


def default_of(option: Any) -> str:
    """The default of an option, marked where it is the paper's robot's and follows from the size of another robot."""
    return values(option["default"]) + (SCALED if option["scaled"] else "")


def class_name(task: str) -> str:
    """The name of a task as in classes and its id: balance becomes Balance."""
    return TASKS[task]["id"].partition("/")[2].rpartition("-")[0]


def option_rows(task: str) -> list[list[str]]:
    """Name, unit, default, limit and meaning of every option of a task."""
    defaults = Batch(1, task, num_threads=1).options | {"robot": ROBOTS[0], "model": Batch(1, task).model}
    defaults |= {"max_wheel_torque": None, "reward": "see above", "events": None, "rows": None, "terminations": None}
    rows = []
    for name, _, unit, limit, doc in COMMON:
        default = defaults[name]
        plain = isinstance(default, (str, bool)) or default is None
        rows.append([f"`{name}`", unit, str(default) if plain else values(default), limit, doc])
    for option in TASKS[task]["options"]:
        default = default_of(option)
        rows.append([f"`{option['name']}`", option["unit"], default, option["limit"], option["doc"].replace("\n", " ")])
    return rows


def stage_rows(options: Iterable[Any]) -> list[list[str]]:
    """Name, unit, default, limit and meaning of every option of a table."""
    facts = ((option, values(option["default"]), option["doc"].replace("\n", " ")) for option in options)
    return [[f"`{option['name']}`", option["unit"], default, option["limit"], doc] for option, default, doc in facts]


def observation_rows(task: str) -> list[list[str]]:
    """Index, name, unit, bound, value at rest and typical magnitude of every row of an observation."""
    return [
        [str(i), row["name"], row["unit"], number(row["bound"]), number(row["rest"]), number(row["typical"])]
        for i, row in enumerate(TASKS[task]["observation"])
    ]


def command_rows(task: str) -> list[list[str]]:
    """Index, name, unit and bound of every part of a command."""
    return [
        [str(i), part["name"], part["unit"], number(part["bound"])] for i, part in enumerate(TASKS[task]["command"])
    ]


def metric_rows(task: str) -> list[list[str]]:
    """Name, unit and meaning of every metric of an episode."""
    return [[f"`{metric['name']}`", metric["unit"], metric["doc"]] for metric in TASKS[task]["metrics"]]


def reward_rows(task: str) -> list[list[str]]:
    """Name, scale with its sign, and formula of every reward term."""
    return [
        [f"`{term['name']}`", f"{'-' if term['cost'] else ''}{number(term['scale'])}", term["formula"]]
        for term in TASKS[task]["rewards"]
    ]


def controller_rows(controller: str) -> list[list[str]]:
    """Name, unit, default, limit and meaning of every option of a controller."""
    return [
        [f"`{option['name']}`", option["unit"], default_of(option), option["limit"], option["doc"]]
        for option in CONTROLLERS[controller]["options"]
    ]


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, its columns aligned."""
    lines = [list(header), *[[cell.replace("|", "\\|") for cell in row] for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    padded = [[cell.ljust(width) for cell, width in zip(line, widths, strict=True)] for line in lines]
    rule = ["-" * width for width in widths]
    return "\n".join(f"| {' | '.join(line)} |" for line in [padded[0], rule, *padded[1:]])
