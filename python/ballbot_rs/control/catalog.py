"""The controllers that come with the package, by name, and a controller for a robot."""

import dataclasses
import html
from collections.abc import Mapping
from typing import Any, Final

from ballbot_rs import _short
from ballbot_rs._core import CONTROLLERS, Controller
from ballbot_rs._keywords import check_keywords, named
from ballbot_rs._robot import Robot, params_of

#: Options of every controller.
COMMON: Final = ("max_torque", "traction", "speed_limit", "boundary", "scaled")


@dataclasses.dataclass(frozen=True)
class ControllerOption:
    """A weight or gain of a controller."""

    unit: str
    default: float | list[float]
    #: Whether the default is for the paper's robot, and follows from the size of another.
    scaled: bool
    #: Its range, as text.
    limit: str
    doc: str

    @property
    def shown_default(self) -> str:
        """The default as text."""
        return _short.number(self.default) + (", scaled" if self.scaled else "")


@dataclasses.dataclass(frozen=True, repr=False)
class ControllerInfo:
    """A controller as `controllers` lists it.

    ```python
    info = bb.controllers()["lqr"]
    print(info.summary, info.setpoint_parts, info.control_dt)
    ```
    """

    name: str
    summary: str
    #: Parts of a setpoint that it follows.
    setpoint_parts: tuple[str, ...]
    #: Time between two calls that it is made for, s; None is any.
    control_dt: float | None
    #: Fraction of the friction limit to which its torques are scaled down by default; None is not scaled.
    traction: float | None
    #: By name.
    options: Mapping[str, ControllerOption]

    def __repr__(self) -> str:
        return f"<ControllerInfo {self.name}: {self.summary}>"

    def _repr_html_(self) -> str:
        rows = [
            (name, option.shown_default, option.unit, option.limit, option.doc) for name, option in self.options.items()
        ]
        table = _short.table(rows, ("option", "default", "unit", "limit", ""))
        follows = html.escape(f"{self.summary} It follows {', '.join(self.setpoint_parts)}.")
        return f"<div><b>{html.escape(self.name)}</b>: {follows}{table}</div>"

    def __str__(self) -> str:
        rate = "" if self.control_dt is None else f" Made for {self.control_dt:g} s."
        lines = [f"{self.name}: {self.summary}{rate} It follows {', '.join(self.setpoint_parts)}."]
        width = max((len(name) for name in self.options), default=0)
        for name, option in self.options.items():
            unit = f" {option.unit}" if option.unit else ""
            lines.append(f"  {name:<{width}}  {option.shown_default}{unit} ({option.limit}): {option.doc}")
        return "\n".join(lines)


def controllers() -> dict[str, ControllerInfo]:
    """The controllers by name, with the parts of a setpoint that they follow, rates and options.

    ```python
    for name, info in bb.controllers().items():
        print(name, info.summary)
    ```

    `print(bb.controllers()["lqr"])` shows one of them.
    """
    return {
        name: ControllerInfo(
            name,
            summary=kind["summary"],
            setpoint_parts=tuple(kind["setpoint"]),
            control_dt=kind["control_dt"],
            traction=kind["traction"],
            options={
                option["name"]: ControllerOption(
                    option["unit"], option["default"], option["scaled"], option["limit"], option["doc"]
                )
                for option in kind["options"]
            },
        )
        for name, kind in CONTROLLERS.items()
    }


@named
def make_controller(
    name: str,
    robot: Robot | None = None,
    control_dt: float | None = None,
    **options: Any,
) -> Controller:
    """A controller by name, called as `controller(state)` or `controller(state, position=...)`.

    ```python
    law = bb.make_controller("lqr", "kugle", tilt=0.2)
    robot = bb.Ballbot("kugle")
    robot.step(law(robot.state, position=(0.1, 0.0)), 10)
    ```

    Args:
        name: one of `controllers()`.
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        control_dt: time between two calls, s; None is the time that the controller is made for (0.002 for "pid"), or
            0.01.
        options: weights or gains listed in `controllers()[name].options`, and `max_torque`, `traction`, `speed_limit`,
            `boundary` and `scaled` as in `Controller`.

    Raises:
        ValueError: an unknown name, a number out of range, or an option of `scaled` that does not scale.
        TypeError: an option that the controller does not have, or that is given twice.
    """
    if name in CONTROLLERS:
        known = [option["name"] for option in CONTROLLERS[name]["options"]]
        check_keywords(f"the controller '{name}'", options, (*known, *COMMON))
    return Controller(name, params_of(robot), control_dt, **options)
