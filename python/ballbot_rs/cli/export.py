"""`ballbot export`: a trained policy as an ONNX file, which runs without torch."""

import argparse
import json
from pathlib import Path
from typing import Any


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("export", help="write a policy as ONNX, which runs without torch")
    command.add_argument("policy", type=Path, metavar="RUN", help="a training run, or a policy file of its")
    command.add_argument("-o", "--output", type=Path, metavar="FILE", help="default: policy.onnx in the run")
    command.add_argument("--json", action="store_true", help="print what the file says of itself as JSON")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    target = arguments.output
    if target is None:
        source = arguments.policy
        target = (source if source.is_dir() else source.parent) / "policy.onnx"
    if target.suffix != ".onnx":
        raise ValueError(f"{target}: the name of an ONNX file ends in .onnx")
    try:
        from ballbot_rs.training import export
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"exporting needs {error.name}: install it with `pip install 'ballbot-rs[train,export]'`", name=error.name
        ) from error
    difference = export.export(arguments.policy, target)
    if arguments.json:
        from ballbot_rs.control.onnx_policy import OnnxPolicy

        report = {"policy": str(target), "difference": difference, "metadata": OnnxPolicy(target).metadata}
        print(json.dumps(report, indent=2))
        return
    size = target.stat().st_size / 1024
    print(f"wrote {target} ({size:.0f} KiB); its actions are those of its source to {difference:.0e}")
