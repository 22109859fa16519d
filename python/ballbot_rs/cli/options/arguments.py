"""Arguments that several commands share: every command spells, explains and orders them alike."""

import argparse
import contextlib
import dataclasses
import os
import re
from collections.abc import Callable, Mapping
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
    load_actuators,
    load_events,
    load_sensors,
)
from ballbot_rs._modules import import_from_here
from ballbot_rs._robot import params_of
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.cli.options import settings
from ballbot_rs.cli.options.numbers import MAX_SECONDS, real, whole
from ballbot_rs.control.resolve import NAMES, ResolvedController, Source, common_options, common_task, find, options_of
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
    """Adds the controller, or several."""
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


def add_robot(command: Any, *, otherwise: str = "the policy's own, else", others: str = "") -> None:
    """Adds the model, the robot, its motors, sensors and other options of the environment.

    Args:
        command: the parser to add them to.
        otherwise: whose model and robot are the default.
        others: what `--set` takes in addition to options of the environment.
    """
    command.add_argument("--model", help=f"{', '.join(MODELS)} (default: {otherwise} contact)")
    command.add_argument(
        "--robot",
        metavar="NAME|FILE.toml",
        help=f"{', '.join(ROBOTS)}, or a file with parameters (default: {otherwise} paper)",
    )
    settings.add_to(command, f"an option of the environment or a part of one, as {settings.EXAMPLES}{others}")
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


def robot_option(name: str) -> Any:
    """The option `robot` of an environment for a preset's name or a TOML file.

    Raises:
        ValueError: a malformed file, or an unknown parameter.
        OSError: the file cannot be read.
    """
    if Path(name).suffix != ".toml":
        known = ROBOTS
        if name not in known:
            hint = did_you_mean(name, known)
            raise ValueError(f"unknown robot '{name}': expected one of {', '.join(known)}, or FILE.toml{hint}")
        return name
    return params_of(name).to_dict()


def actuators_option(name: str) -> Any:
    """The option `actuators` of an environment for a name, or for a TOML file or a URDF, whose numbers it holds.

    Raises:
        ValueError: a malformed file, or an unknown option.
        OSError: the file cannot be read.
    """
    if Path(name).suffix in (".toml", ".urdf"):
        return load_actuators(name)
    if name not in ACTUATORS:
        known = f"{', '.join(ACTUATORS)}, FILE.toml, or FILE.urdf"
        raise ValueError(f"unknown actuators '{name}': expected one of {known}{did_you_mean(name, ACTUATORS)}")
    return name


def _in_full(name_or_file: str, load: Callable[[str], Any]) -> Any:
    """A name as it is and a TOML file in full, so that the record of a run does not depend on the file."""
    return load(name_or_file) if Path(name_or_file).suffix == ".toml" else name_or_file


def env_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """The options of the environment that the command line names."""
    values = settings.assignments(arguments.set)
    laws_alone = all(name in NAMES for name in _names(arguments))
    settings.check_names(values, (arguments.task or DEFAULT_TASK) if laws_alone else arguments.task)
    return settings.apply(values, named_options(arguments), lambda: _trained(arguments))


def named_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """The options of the environment that have separate arguments."""
    options: dict[str, Any] = {}
    if arguments.model is not None:
        options["model"] = arguments.model
    if arguments.robot is not None:
        options["robot"] = robot_option(arguments.robot)
    if getattr(arguments, "urdf", None) is not None:
        if arguments.robot is not None:
            raise ValueError("--urdf and --robot exclude each other: both name a robot")
        options["robot"] = Params.from_urdf(*arguments.urdf).to_dict()
    if arguments.actuators is not None:
        options["actuators"] = actuators_option(arguments.actuators)
    if getattr(arguments, "sensors", None) is not None:
        options["sensors"] = _in_full(arguments.sensors, load_sensors)
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
    return [find(name, task=arguments.task, env_options=options) for name in _names(arguments)]


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A start, a push and a duration."""

    seconds: float
    tilt: tuple[float, float]
    yaw: float
    push: Push | None
    env_options: dict[str, Any]
    task: str | None
    #: Seed of the events.
    seed: int = 0

    def of(self, controller: Source) -> Trajectory:
        """The trajectory under a controller."""
        return simulate(
            controller,
            seconds=self.seconds,
            tilt=self.tilt,
            yaw=self.yaw,
            pushes=() if self.push is None else self.push,
            task=self.task,
            seed=self.seed,
            **self.env_options,
        )

    @property
    def motion(self) -> dict[str, Any]:
        """The fields without the seed, as arguments."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "seed"}


def add_scenario(command: Any, seconds: float) -> None:
    """Adds duration, start and push."""
    group = command.add_argument_group("scenario (SI units and radians)")
    group.add_argument(
        "--seconds",
        type=real(0.0, MAX_SECONDS, above=True),
        default=seconds,
        help=f"simulated time (default {seconds:g})",
    )
    group.add_argument(
        "--tilt",
        type=real(),
        nargs=2,
        metavar=("X", "Y"),
        default=(0.08, 0.05),
        help="initial tilt (default 0.08 0.05)",
    )
    group.add_argument("--yaw", type=real(), default=0.0, help="initial heading (default 0)")
    group.add_argument(
        "--push", type=real(), nargs=3, metavar=("X", "Y", "Z"), help="impulse on the body in N·s (default none)"
    )
    group.add_argument(
        "--push-at", type=real(0.0, MAX_SECONDS), default=1.0, metavar="TIME", help="time of the push (default 1)"
    )


def scenario(arguments: argparse.Namespace) -> Scenario:
    """The scenario that the command line describes."""
    push = None if arguments.push is None else Push(tuple(arguments.push), arguments.push_at)
    return Scenario(
        arguments.seconds,
        tuple(arguments.tilt),
        arguments.yaw,
        push,
        env_options(arguments),
        arguments.task,
        getattr(arguments, "seed", 0),
    )


def on_one_robot(arguments: argparse.Namespace) -> tuple[Scenario, list[ResolvedController]]:
    """The scenario and its controllers, all on the task and robot of the policies, else on the default."""
    chosen = scenario(arguments)
    found = controllers(arguments)
    chosen = dataclasses.replace(chosen, task=common_task(found, chosen.task))
    shared = common_options(found, chosen.env_options)
    found = [
        dataclasses.replace(controller, env_options=options_of(controller, shared, chosen.env_options))
        for controller in found
    ]
    if "events" in chosen.env_options:
        chosen = dataclasses.replace(chosen, env_options={**chosen.env_options, "events": shared["events"]})
    return chosen, found


def trajectories(arguments: argparse.Namespace) -> list[Trajectory]:
    """The trajectories of all controllers of the command line."""
    chosen, found = on_one_robot(arguments)
    return [chosen.of(controller) for controller in found]
