"""Origin and robot of a training run, for its report."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ballbot_rs._core import ROBOTS, Params
from ballbot_rs._short import number
from ballbot_rs.media.report import page
from ballbot_rs.training import run_folder


def rows(record: Mapping[str, Any], folder: Path, task: str) -> list[tuple[str, str]]:
    """Names and texts of the entries of the record; records of earlier versions have fewer."""
    name = shlex.quote(folder.resolve().name)
    found = [(label, record.get(key)) for label, key in (("started", "started"), ("finished", "finished"))]
    seconds, timesteps, fit = (record.get(key) for key in ("seconds", "timesteps", "fit_seconds"))
    if isinstance(fit, float):
        found.append(("fit to the teacher", f"in {_duration(fit)}"))
    if isinstance(seconds, float) and isinstance(timesteps, int) and seconds > 0.0:
        found.append(("learning", f"{timesteps} steps in {_duration(seconds)}, {timesteps / seconds:.0f} steps/s"))
    success = record.get("success")
    if isinstance(success, float):
        found.append(("result", _failed(run_folder.failure(record)) or f"success with {success:.0%} of nominal robots"))
    found += [(key, record.get(key)) for key in ("machine", "command", "commit")]
    repeat = f"ballbot train {task} --config {run_folder.CONFIG} --seed {record['seed']}"
    found += [("to repeat it", repeat), ("as ONNX", f"ballbot export {name} -o policy.onnx")]
    return [(label, text) for label, text in found if isinstance(text, str)]


def _failed(reason: str | None) -> str | None:
    return None if reason is None else f"failed: {reason}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{seconds:.3g} s"


def robot(params: Params, env_options: Mapping[str, Any]) -> Sequence[str]:
    """The robot's name or its differences from the closest preset, its other options, and all of its parameters."""
    values = params.to_dict()
    presets = {name: Params.preset(name).to_dict() for name in ROBOTS}
    differing = {
        name: [key for key, value in values.items() if value != preset[key]] for name, preset in presets.items()
    }
    closest = min(differing, key=lambda name: len(differing[name]))
    changes = ", ".join(f"{key} = {_text(values[key])}" for key in differing[closest])
    parts = [f"Robot {closest}" + (f" with {changes}." if changes else ".")]
    parts += [
        f"{name.capitalize()}: {env_options[name]}." for name in ("actuators", "sensors") if env_options.get(name)
    ]
    table = page.table([("parameter (SI units)", "value"), *((key, _text(value)) for key, value in values.items())])
    return page.note(" ".join(parts)), table


def _text(value: Any) -> str:
    return ", ".join(number(one) for one in value) if isinstance(value, tuple | list) else number(value)
