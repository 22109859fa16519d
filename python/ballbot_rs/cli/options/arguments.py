"""Arguments that several commands share: every command spells, explains and orders them alike."""

import argparse
import contextlib
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import (
    ACTUATORS,
    EVENT_SETS,
    MODELS,
    ROBOTS,
    SENSORS,
    TASKS,
    Params,
    load_events,
    load_sensors,
)
from ballbot_rs._modules import import_from_here
from ballbot_rs.cli.options import controller_options, settings
from ballbot_rs.cli.options.numbers import whole
from ballbot_rs.cli.options.robots import STAGES, actuators_option, own_stages, robot_option
from ballbot_rs.control.resolve import NAMES, ResolvedController, common_options, find
from ballbot_rs.envs.own.source import is_in_source
from ballbot_rs.envs.registration import DEFAULT_TASK, name_of

CONTROLLER_METAVAR = "NAME|PATH"
CONTROLLER_HELP = f"{', '.join(NAMES)}, a policy file, a training run, FILE.py:NAME with your own, or a link's address"


#: How a task in Python is named.
OWN_TASK = "FILE.py:ID or MODULE:ID with your own"


def add_task(command: Any, *others: str) -> None:
    """Adds the task, the first argument; `others` are accepted in place of one."""
    known = f"{', '.join((*sorted(TASKS), *others))}, or {OWN_TASK} (default: {DEFAULT_TASK})"
    kind = lambda name: name if name in others else task_name(name)  # noqa: E731
    command.add_argument("task", nargs="?", type=kind, metavar="TASK", help=known)


#: Suffixes of policy files.
POLICY_SUFFIXES = (".onnx", ".zip")


def add_task_or_policy(command: Any) -> None:
    """Adds the first argument: a task, or a policy, which names its task and serves as the controller.

    Call `add_controller`, too.
    """
    known = (
        f"{', '.join(sorted(TASKS))}, {OWN_TASK}, or a policy, FILE.onnx or RUN (default: the policy's own, else "
        f"{DEFAULT_TASK})"
    )
    command.add_argument(
        "task", nargs="?", type=_task_or_policy, action=_TaskOrPolicy, metavar="TASK|POLICY", help=known
    )


def _task_or_policy(name: str) -> str | Path:
    if is_in_source(name) and not Path(name).exists():
        return task_name(name)
    with contextlib.suppress(ValueError):
        return name_of(name)
    is_id = re.search(r"-v\d+$", name) is not None
    looks_like_path = Path(name).suffix in POLICY_SUFFIXES or (os.sep in name and not is_id)
    return Path(name) if name not in NAMES and (looks_like_path or Path(name).exists()) else task_name(name)


class _TaskOrPolicy(argparse.Action):
    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, _: str | None = None
    ) -> None:
        if not isinstance(values, Path):
            namespace.task = values
            return
        if isinstance(namespace.controller, str):
            parser.error(f"{values} and --controller {namespace.controller}: this command takes one controller")
        several = namespace.controller or []
        namespace.controller = [str(values), *several]


class _OneController(argparse.Action):
    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        if namespace.controller is not None:
            (other,) = [namespace.controller] if isinstance(namespace.controller, str) else namespace.controller
            parser.error(f"{other} and {option} {values}: this command takes one controller")
        namespace.controller = values


def task_name(name: str) -> str:
    """The task of a name or an id, for argparse."""
    if is_in_source(name):
        import_from_here()
        try:
            return name_of(name)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
    with contextlib.suppress(ValueError):
        return name_of(name)
    hint = did_you_mean(name, TASKS)
    if name in NAMES or Path(name).exists():
        hint = f": a controller is named by --controller {name}"
    raise argparse.ArgumentTypeError(f"unknown task '{name}', expected one of {', '.join(sorted(TASKS))}{hint}")


def add_controller(command: Any, *, several: bool = False) -> None:
    """Adds the controller, or several, and its options."""
    if several:
        command.add_argument(
            "--controller",
            action="append",
            metavar=CONTROLLER_METAVAR,
            help=f"{CONTROLLER_HELP}; repeat for more (default lqr)",
        )
    else:
        command.add_argument(
            "--controller", action=_OneController, metavar=CONTROLLER_METAVAR, help=f"{CONTROLLER_HELP} (default lqr)"
        )
    controller_options.add_to(command)


def add_robot(
    command: Any,
    *,
    otherwise: str = "the policy's own, else",
    others: str = "",
    keys: Callable[[], Mapping[str, str]] = settings.of_environments,
) -> None:
    """Adds the model, the robot, its motors, sensors and other options of the environment.

    Args:
        command: the parser to add them to.
        otherwise: whose model and robot are the default.
        others: what `--set` takes in addition to options of the environment.
        keys: names that `--set` takes, as of `settings.add_to`.
    """
    command.add_argument("--model", help=f"{', '.join(MODELS)} (default: {otherwise} contact)")
    command.add_argument(
        "--robot",
        metavar="NAME|FILE.toml",
        help=f"{', '.join(ROBOTS)}, or a file with parameters; its tables [actuators] and [sensors] apply, too, unless "
        f"others are named (default: {otherwise} paper)",
    )
    settings.add_to(command, f"an option of the environment or a part of one, e.g. {settings.EXAMPLES}{others}", keys)
    command.add_argument(
        "--actuators",
        metavar="NAME|FILE",
        help=f"motors: {', '.join(ACTUATORS)}, a TOML file with a table [actuators], or the URDF of the bot "
        f"(default: {otherwise} ideal)",
    )
    command.add_argument(
        "--sensors",
        metavar="NAME|FILE.toml",
        help=f"sensors: {', '.join(SENSORS)}, or a TOML file with a table [sensors]; with --set "
        f"observation=sensors controllers use estimates from them (default: {otherwise} none)",
    )


def add_urdf(command: Any) -> None:
    """Adds a robot described by two URDFs."""
    command.add_argument(
        "--urdf", type=Path, nargs=2, metavar=("BOT", "BALL"), help="a robot as two URDFs, instead of --robot"
    )


def add_events(command: Any, *others: str) -> None:
    """Adds what is sampled at random for the robots."""
    names = "|".join((*EVENT_SETS, *others, "FILE.toml"))
    command.add_argument("--events", metavar=names, help="sample robots and pushes at random (default: nominal robots)")


def add_seed(command: Any, what: str, default: int | None, highest: int) -> None:
    """Adds the seed."""
    command.add_argument("--seed", type=whole(0, highest), default=default, help=what)


def add_output(command: Any, metavar: str, what: str) -> None:
    """Adds the file or folder to write."""
    command.add_argument("-o", "--output", type=Path, metavar=metavar, help=what)


def add_verbosity(command: Any, what: str) -> None:
    """Adds `--quiet` and `--json`."""
    command.add_argument("--quiet", action="store_true", help="no progress bar")
    command.add_argument("--json", action="store_true", help=f"print {what} as JSON")


def _in_full(name_or_file: str, load: Callable[[str], Any]) -> Any:
    """A name as it is and a TOML file in full, so that the record of a run does not depend on the file."""
    return load(name_or_file) if Path(name_or_file).suffix == ".toml" else name_or_file


def env_options(arguments: argparse.Namespace, own: Sequence[str] = STAGES) -> dict[str, Any]:
    """The options of the environment that the command line names.

    Args:
        arguments: of the command line.
        own: which tables of a robot's file apply where their options are not named.
    """
    values = settings.assignments(arguments.set)
    laws_alone = all(name in NAMES for name in _names(arguments))
    settings.check_names(values, (arguments.task or DEFAULT_TASK) if laws_alone else arguments.task)
    return settings.apply(values, named_options(arguments, own), lambda: _trained(arguments))


def named_options(arguments: argparse.Namespace, own: Sequence[str] = STAGES) -> dict[str, Any]:
    """The options of the environment that have separate arguments; `own` as of `env_options`."""
    options: dict[str, Any] = {}
    if arguments.model is not None:
        options["model"] = arguments.model
    if arguments.robot is not None:
        options["robot"] = robot_option(arguments.robot)
    if getattr(arguments, "urdf", None) is not None:
        if arguments.robot is not None:
            raise ValueError("--urdf and --robot are mutually exclusive: both name a robot")
        options["robot"] = Params.from_urdf(*arguments.urdf).to_dict()
    named = {stage: getattr(arguments, stage) for stage in STAGES if getattr(arguments, stage, None) is not None}
    stages = {**{stage: file for stage, file in own_stages(arguments.robot).items() if stage in own}, **named}
    if "actuators" in stages:
        options["actuators"] = actuators_option(stages["actuators"])
    if "sensors" in stages:
        options["sensors"] = _in_full(stages["sensors"], load_sensors)
    if getattr(arguments, "events", None) is not None:
        options["events"] = _in_full(arguments.events, load_events)
    return options


def _names(arguments: argparse.Namespace) -> list[str]:
    """The controllers as on the command line."""
    given = getattr(arguments, "controller", None) or getattr(arguments, "policy", None) or "lqr"
    return given if isinstance(given, list) else [str(given)]


def _trained(arguments: argparse.Namespace) -> Mapping[str, Any]:
    """The options that the policies of the command line were trained with."""
    return common_options([find(name, task=arguments.task) for name in _names(arguments) if name not in NAMES])


def controllers(arguments: argparse.Namespace) -> list[ResolvedController]:
    """The controllers that the command line names."""
    options = env_options(arguments)
    names = _names(arguments)
    chosen = controller_options.of(names, arguments.controller_option)
    return [chosen.get(name) or find(name, task=arguments.task, env_options=options) for name in names]
