"""A page for each controller of the core, from its table of options."""

from typing import Final

from ballbot_rs import ControllerInfo, controllers

#: They simulate, which the page in the browser does not do in real time.
SIMULATING: Final = ("mppi", "nmpc")


def pages() -> dict[str, str]:
    """The text of every page by its file's name."""
    infos = controllers()
    return {"README.md": _index(infos), **{f"{name}.md": _page(info) for name, info in infos.items()}}


def _row(*cells: object) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _index(infos: dict[str, ControllerInfo]) -> str:
    rows = [_row(f"[`{name}`]({name}.md)", info.summary, _rate(info)) for name, info in infos.items()]
    return "\n".join(
        [
            "# The controllers, one by one\n",
            "Generated from the tables of the core. Their disturbance limits are in [Controllers](../controllers.md),"
            " their laws in [Laws](../laws.md).\n",
            _row("controller", "what", "control step"),
            _row("---", "---", "---"),
            *rows,
            "",
        ]
    )


def _rate(info: ControllerInfo) -> str:
    return "the task's" if info.control_dt is None else f"{info.control_dt:g} s"


def _traction(info: ControllerInfo) -> str:
    if info.traction is None:
        return "Its torques are not scaled down to what the wheels can pass on."
    return f"Its torques are scaled down to {info.traction:g} of the friction limit."


def _scene(name: str) -> str:
    """A scene under the controller, with `lqr` to compare with."""
    return f"""
<!-- scene: controller={name}{"" if name == "lqr" else "&compare=lqr"} -->
"""


def _page(info: ControllerInfo) -> str:
    name = info.name
    rows = [_row(f"`{option}`", of.unit, of.shown_default, of.limit, of.doc) for option, of in info.options.items()]
    parts = ", ".join(f"`{part}`" for part in info.setpoint_parts) or "nothing"
    table = [_row("option", "unit", "default", "limit", "what"), _row("---", "---", "---", "---", "---"), *rows, ""]
    return f"""# {name}

{info.summary}

It follows {parts}. {_traction(info)} Its control step is {_rate(info)}.
{"" if name in SIMULATING else _scene(name)}
[Its law](../laws.md#{name}) has the equations, the block diagram and the responses,
[Controllers](../controllers.md) its disturbance limits.

```python
import ballbot_rs as bb

law = bb.Controller("{name}")
robot = bb.Ballbot()
robot.reset(bb.State.at_rest(robot.params, tilt=(0.05, 0.03)))
torques = law(robot.state)                       # N·m, of wheels 0, 1, 2
```

```sh
ballbot evaluate balance --controller {name}
ballbot view --controller {name}
```

## Options

Keywords of `Controller("{name}", ...)`.

""" + ("\n".join(table) if rows else "It has none of its own.\n")
