"""`ballbot export`: a policy as an ONNX file, which runs without PyTorch; policies and what a robot needs as C99."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from ballbot_rs import _files
from ballbot_rs._extras import require
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import controller_options, settings
from ballbot_rs.cli.options.robots import STAGES
from ballbot_rs.control import policy_file
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.deployment import (
    CONTROLLERS_IN_C,
    controller_header,
    estimator_header,
    link_header,
    policy_header,
    supervisor_header,
)

#: Options of the environment that a controller in C depends on.
OF_CONTROLLERS = ("robot", "control_dt", "max_wheel_torque")
#: Options of the environment that an estimator in C depends on.
OF_ESTIMATORS = ("robot", "control_dt", "sensors")

#: Options of the environment that a supervisor in C depends on.
OF_SUPERVISORS = ("robot", "control_dt", "actuators")


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("export runs/mine -o policy.onnx", "a policy that runs without PyTorch"),
    ("export assets/policies/balance.onnx -o policy.h", "a policy as C99"),
    ("export --controller lqr --controller-option position=0.1 --robot kugle -o gains.h", "a controller as C99"),
    ("export --estimator --robot kugle --sensors kugle -o estimator.h", "the estimator as C99"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "export",
        help="write a policy as ONNX, which runs without PyTorch, or a policy and other robot code as C99",
        examples=EXAMPLES,
    )
    command.add_argument(
        "policy", type=Path, nargs="?", metavar="RUN", help="a training run, or a policy file; for C an ONNX file, too"
    )
    command.add_argument(
        "--task",
        type=shared.task_name,
        metavar="TASK",
        help="the task of a policy file without metadata (ballbot_rs.save adds it)",
    )
    command.add_argument(
        "--controller",
        metavar="|".join(CONTROLLERS_IN_C),
        help="a controller as C, in place of a policy, for the robot of --robot (default paper)",
    )
    controller_options.add_to(command)
    command.add_argument(
        "--estimator", action="store_true", help="the estimator as C, for the robot of --robot and its --sensors"
    )
    command.add_argument(
        "--supervisor", action="store_true", help="the supervisor as C, for the robot of --robot and its --actuators"
    )
    command.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a limit of that supervisor, for example continuous_torque=0.5, max_speed=40; repeat for more",
    )
    command.add_argument("--link", action="store_true", help="the frames of ballbot link as C, for any robot")
    shared.add_robot(command)
    shared.add_output(
        command,
        "FILE.onnx|FILE.h",
        "the file: ONNX, or a header of C99 (default policy.onnx in the run, CONTROLLER.h, or estimator.h, "
        "supervisor.h, link.h)",
    )
    command.add_argument("--json", action="store_true", help="print what the file is for as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    flags = (arguments.estimator, arguments.supervisor, arguments.link)
    if sum((arguments.policy is not None, arguments.controller is not None, *flags)) != 1:
        raise ValueError("export takes one of RUN, --controller, --estimator, --supervisor and --link")
    if arguments.limit and not arguments.supervisor:
        raise ValueError(f"--limit {arguments.limit[0]} needs --supervisor")
    if arguments.controller is not None:
        _export_controller(arguments)
        return
    if arguments.controller_option:
        raise ValueError(f"{controller_options.FLAG} {arguments.controller_option[0]} needs --controller")
    if arguments.estimator:
        _export_estimator(arguments)
        return
    if arguments.supervisor:
        _export_supervisor(arguments)
        return
    if arguments.link:
        _export_link(arguments)
        return
    arguments.policy = policy_file.in_run(arguments.policy)
    target = arguments.output
    if target is None:
        source = arguments.policy
        target = (source if source.is_dir() else source.parent) / "policy.onnx"
    if target.suffix not in (".onnx", ".h"):
        raise ValueError(f"{target}: the name of an ONNX file must end in .onnx, of a C header in .h")
    if arguments.policy.suffix == target.suffix == ".onnx":
        raise ValueError(f"{arguments.policy} is already an ONNX file: write it as a C header with -o FILE.h")
    if target.suffix == ".h":
        _export_policy_as_c(arguments, target)
    else:
        _export_policy(arguments, target)


def _export_policy(arguments: argparse.Namespace, target: Path) -> None:
    difference = _as_onnx(arguments, target)
    if arguments.json:
        report = {"policy": str(target), "difference": difference, "metadata": OnnxPolicy(target).metadata}
        print(json.dumps(report, indent=2))
        return
    size = target.stat().st_size / 1024
    print(f"wrote {target} ({size:.0f} KiB); largest difference of its actions from the source: {difference:.0e}")


def _as_onnx(arguments: argparse.Namespace, target: Path) -> float:
    with require("exporting", "train", "export"):
        from ballbot_rs.training import export
    options = shared.env_options(arguments, own=())
    given = options if options or arguments.task is not None else None
    return export.export(arguments.policy, target, arguments.task, given)


def _export_policy_as_c(arguments: argparse.Namespace, target: Path) -> None:
    task = arguments.task
    if arguments.policy.suffix == ".onnx":
        options = shared.env_options(arguments, own=())
        robot = options.pop("robot", None)
        if options:
            raise ValueError(
                f"{arguments.policy} has its own options of the environment: leave out {', '.join(options)}"
            )
        params = None if robot is None else settings.one_robot(robot)
        text, metadata = policy_header(arguments.policy, task, params), OnnxPolicy(arguments.policy, task).metadata
    else:
        with _files.scratch_folder() as folder:
            file = folder / "policy.onnx"
            _as_onnx(arguments, file)
            text, metadata = policy_header(file, task), OnnxPolicy(file, task).metadata
    _write(arguments, target, text, {"policy": str(target), "metadata": metadata})


def _robot_and_options(arguments: argparse.Namespace, what: str, known: Sequence[str]) -> tuple[Path, dict[str, Any]]:
    """The file, and options of the environment out of the known options."""
    if arguments.task is not None:
        raise ValueError(f"--task {arguments.task} is for policies: {what} does not depend on it")
    kind = "supervisor" if arguments.supervisor else "estimator"
    target = _header(arguments, f"{arguments.controller or kind}.h")
    options = shared.env_options(arguments, own=[stage for stage in STAGES if stage in known])
    if others := sorted(set(options) - set(known)):
        raise ValueError(
            f"{what} in C does not depend on {', '.join(others)} of the environment, only on {', '.join(known)}"
        )
    return target, {**options, "robot": settings.one_robot(options.get("robot", "paper"))}


def _header(arguments: argparse.Namespace, otherwise: str) -> Path:
    target: Path = arguments.output or Path(otherwise)
    if target.suffix != ".h":
        raise ValueError(f"{target}: the name of a C header ends in .h")
    return target


def _export_link(arguments: argparse.Namespace) -> None:
    if arguments.task is not None or shared.env_options(arguments):
        raise ValueError("--link does not depend on task, robot or environment: leave out their options")
    target = _header(arguments, "link.h")
    _write(arguments, target, link_header(), {"link": str(target)})


def _export_estimator(arguments: argparse.Namespace) -> None:
    target, options = _robot_and_options(arguments, "an estimator", OF_ESTIMATORS)
    if "sensors" not in options:
        raise ValueError(
            "--estimator needs the sensors of the robot, whose errors it expects: add --sensors, or a table [sensors] "
            "to the file of --robot"
        )
    try:
        text = estimator_header(**options)
    except TypeError as error:
        raise ValueError(f"the estimator: {error}") from error
    _write(arguments, target, text, {"estimator": str(target)})


def _export_supervisor(arguments: argparse.Namespace) -> None:
    target, options = _robot_and_options(arguments, "a supervisor", OF_SUPERVISORS)
    given = settings.assignments(arguments.limit, "--limit")
    if taken := sorted(set(OF_SUPERVISORS) & set(given)):
        raise ValueError(f"--limit {taken[0]}: name the robot by --robot and --actuators, and the rest by --set")
    try:
        text = supervisor_header(**options, **given)
    except TypeError as error:
        raise ValueError(f"the supervisor: {error}") from error
    _write(arguments, target, text, {"supervisor": str(target), "limits": given})


def _export_controller(arguments: argparse.Namespace) -> None:
    target, options = _robot_and_options(arguments, "a controller", OF_CONTROLLERS)
    flag = controller_options.FLAG
    given = {
        name.removeprefix(f"{arguments.controller}."): value
        for name, value in settings.assignments(arguments.controller_option, flag).items()
    }
    # Options set for the environment itself are not options of the controller.
    if taken := sorted({"name", *OF_CONTROLLERS} & set(given)):
        raise ValueError(f"{flag} {taken[0]}: name the robot by --robot and the rest by --set")
    try:
        text = controller_header(arguments.controller, **options, **given)
    except TypeError as error:
        raise ValueError(f"the controller '{arguments.controller}': {error}") from error
    _write(arguments, target, text, {"controller": arguments.controller, "header": str(target), "options": given})


def _write(arguments: argparse.Namespace, target: Path, text: str, report: dict[str, Any]) -> None:
    with _files.replacing(target) as unfinished:
        unfinished.write_text(text, encoding="ascii")
    if arguments.json:
        print(json.dumps(report, indent=2))
        return
    print(f"wrote {target} ({len(text) / 1024:.0f} KiB): C99, which needs only its standard headers")
