"""`ballbot export`: a trained policy as an ONNX file, which runs without PyTorch."""

import argparse
import json
from pathlib import Path
from typing import Any

from ballbot_rs._core import TASKS
from ballbot_rs._extras import require
from ballbot_rs.cli import scenario
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.envs.registration import DEFAULT_TASK


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("export", help="write a policy as ONNX, which runs without PyTorch")
    command.add_argument("policy", type=Path, metavar="RUN", help="a training run, or a policy file")
    command.add_argument(
        "--task",
        choices=sorted(TASKS),
        help="the task of a policy file without metadata (ballbot_rs.save adds it)",
    )
    scenario.add_robot(command)
    scenario.add_output(command, "FILE.onnx", "the file (default policy.onnx in the run)")
    command.add_argument("--json", action="store_true", help="print the file's metadata as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    target = arguments.output
    if target is None:
        source = arguments.policy
        target = (source if source.is_dir() else source.parent) / "policy.onnx"
    if target.suffix != ".onnx":
        raise ValueError(f"{target}: the name of an ONNX file ends in .onnx")
    task = arguments.task or DEFAULT_TASK
    with require("exporting", "train", "export"):
        from ballbot_rs.training import export
    options = scenario.env_options(arguments)
    given = options if options or arguments.task is not None else None
    difference = export.export(arguments.policy, target, task, given)
    if arguments.json:
        report = {"policy": str(target), "difference": difference, "metadata": OnnxPolicy(target, task).metadata}
        print(json.dumps(report, indent=2))
        return
    size = target.stat().st_size / 1024
    print(f"wrote {target} ({size:.0f} KiB); largest difference of its actions from the source: {difference:.0e}")
