"""The tabs Robot, the simulated robot and its controller, and Parameters, which change while it runs."""

import functools
from typing import Any

import numpy as np
import viser

from ballbot_rs._core import MODELS
from ballbot_rs.control.resolve import NAMES
from ballbot_rs.viewer.panels.controls import add_button, on_client, put
from ballbot_rs.viewer.session.policies import shipped, shipped_name
from ballbot_rs.viewer.session.runner import Submit
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.session.setup import CHANGES, NEUTRAL

#: Label of a policy whose file is named below.
POLICY = "policy file"

#: Before the name of a policy that ships with the package.
SHIPPED = "policy: "

#: Label for no comparison.
NONE = "none"

#: Labels of the choices of `OBSERVATIONS`.
SEES = {"ground_truth": "true state", "sensors": "estimate"}


class RobotPanel:
    """Choices, which are corrected if the session rejects them.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        session: only read here, before the runner starts.
        task: the control of the task, which is elsewhere on the page.
    """

    def __init__(
        self, server: viser.ViserServer, submit: Submit, session: Session, task: viser.GuiDropdownHandle[str]
    ) -> None:
        gui = server.gui
        self._submit, self.task = submit, task
        chosen = listed(session.controller)
        self._policies = {SHIPPED + name: str(path) for name, path in shipped().items()}
        named = [*NAMES, *self._policies]
        self.robot = gui.add_dropdown("Robot", session.robot_names, initial_value=session.robots.name)
        self.model = gui.add_dropdown("Model", MODELS, initial_value=session.robots.model)
        counts = sorted({1, 4, 16, len(session.robots)})
        self.count = gui.add_dropdown("Robots", [str(n) for n in counts], initial_value=str(len(session.robots)))
        self.controller = gui.add_dropdown("Controller", [*named, POLICY], initial_value=chosen)
        self.policy = gui.add_text(
            "Policy file",
            "" if chosen != POLICY else session.controller,
            hint="path of an .onnx file",
            visible=chosen == POLICY,
        )
        self.sees = gui.add_dropdown(
            "Controller sees",
            tuple(SEES.values()),
            initial_value=SEES[session.observation],
            hint="estimate: what follows from gyroscope, accelerometer and encoders",
        )
        self.ghost = gui.add_dropdown(
            "Compare with", [NONE, *named], hint="a second, transparent robot under this controller, same inputs"
        )
        for control in (self.model, self.robot, self.task, self.controller, self.policy, self.sees, self.count):
            control.on_update(self._choose)
        self.ghost.on_update(on_client(submit, self._compare))

    def _compare(self) -> Any:
        chosen = None if self.ghost.value == NONE else self._source(self.ghost.value)
        return lambda session: session.compare_with(chosen)

    def _source(self, label: str) -> str:
        """Name of a controller or path of a policy, by its label."""
        return self._policies.get(label, label)

    async def _choose(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is None:  # Our own correction of the display.
            return
        controller = self.policy.value if self.controller.value == POLICY else self._source(self.controller.value)
        observation = next(name for name, label in SEES.items() if label == self.sees.value)
        requested = {
            "model": self.model.value,
            "robot": self.robot.value,
            "num_robots": self.count.value,
            "task": self.task.value,
            "observation": observation,
            "controller": controller,
        }
        waits_for_name = self.controller.value == POLICY and not controller

        def command(session: Session) -> None:
            now = chosen(session)
            changes: dict[str, Any] = {name: value for name, value in requested.items() if value != now[name]}
            try:
                if "num_robots" in changes:
                    changes["num_robots"] = int(changes["num_robots"])
                if waits_for_name:
                    changes.pop("controller", None)
                    session.notices.append("enter the path of a policy file")
                if changes:
                    session.choose(**changes)
            finally:
                if waits_for_name:
                    put(self.policy, visible=True)
                else:
                    self.correct(session)

        self._submit(command)

    def correct(self, session: Session) -> None:
        """Shows the actual choice where a choice was rejected."""
        chosen = listed(session.controller)
        put(self.policy, visible=chosen == POLICY)
        put(self.model, value=session.robots.model)
        put(self.task, value=session.task)
        put(self.robot, value=session.robots.name)
        put(self.controller, value=chosen)
        put(self.sees, value=SEES[session.observation])
        put(self.count, value=str(len(session.robots)))
        if chosen == POLICY:
            put(self.policy, value=session.controller)

    def show(self, session: Session) -> None:
        """Shows the comparison."""
        put(self.ghost, value=NONE if session.ghost is None else listed(session.ghost.controller))


def listed(controller: str) -> str:
    """Label of a controller in the lists."""
    name = shipped_name(controller)
    return controller if controller in NAMES else POLICY if name is None else SHIPPED + name


def chosen(session: Session) -> dict[str, str]:
    """The present choice, as parameters of `Session.choose`."""
    return {
        "model": session.robots.model,
        "robot": session.robots.name,
        "task": session.task,
        "observation": session.observation,
        "controller": session.controller,
        "num_robots": str(len(session.robots)),
    }


class ParameterPanel:
    """Sliders, a button to restore the nominal robot, and a table.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        session: only read here, before the runner starts.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit, session: Session) -> None:
        gui = server.gui
        self._submit = submit
        self._shown = session.changes
        self._sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        self._requested: dict[str, float] = {}
        for name, change in CHANGES.items():
            slider = gui.add_slider(
                change.label,
                min=change.low,
                max=change.high,
                step=change.step,
                initial_value=session.changes[name],
                hint=change.hint,
            )
            slider.on_update(functools.partial(self._moved, name))
            self._sliders[name] = slider
        add_button(gui, submit, "Nominal robot", self._restore, hint="undoes all changes")
        self._table = gui.add_markdown("")

    async def _moved(self, name: str, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is None:  # Our own correction of the display.
            return
        # During a drag, only the newest waiting value is applied.
        self._requested[name] = event.target.value

        def command(session: Session) -> None:
            value = self._requested.pop(name, None)
            if value is None:
                return
            try:
                session.change(**{name: value})
            finally:
                self._correct(session)

        if not self._submit(command):
            self._requested.pop(name, None)
            self._shown = {}

    def _restore(self, session: Session) -> None:
        try:
            session.change(**NEUTRAL)
        finally:
            self._correct(session)

    def _correct(self, session: Session) -> None:
        """Shows the actual values where a change was rejected or reverted; a waiting slider stays."""
        changes = session.changes
        for name, value in changes.items():
            if name not in self._requested:
                put(self._sliders[name], value=value)
        self._shown = changes

    def show(self, session: Session) -> None:
        """Shows robot 0, and changes made elsewhere."""
        if session.changes != self._shown:
            self._correct(session)
        put(self._table, content=table_of(session))


def table_of(session: Session) -> str:
    """Differences of robot 0 from the nominal robot, and its samples, as a Markdown table in SI units."""
    robots = session.robots
    nominal, params = robots.setup.nominal, robots[0].params
    # A push at the center of mass has no separate height.
    draws = {name: draw[np.isfinite(draw)] for name, draw in robots[0].draws.items() if np.isfinite(draw).any()}
    # A term may occur several times, with an id.
    terms = [name.partition(":")[0] for name in draws]
    now = params.to_dict()
    rows = [
        f"| {name} | {_text(value)} | {_text(now[name])} | {_drawn(name, draws)} |"
        for name, value in nominal.to_dict().items()
        if now[name] != value or name in terms
    ]
    rows += [f"| {name} | | | {_text(draw)} |" for name, draw in draws.items() if name.partition(":")[0] not in now]
    sensors = {name: value for name, value in (robots.setup.changed_sensors or {}).items() if np.any(value)}
    rows += [f"| {name} | | {_text(value)} | |" for name, value in (robots[0].motors | sensors).items()]
    if not rows:
        return "Robot 0 is the nominal one, with ideal motors."
    return "\n".join(["| robot 0, SI units | nominal | now | sampled |", "|---|---|---|---|", *rows])


def _drawn(term: str, draws: dict[str, Any]) -> str:
    return "; ".join(_text(draw) for name, draw in draws.items() if name.partition(":")[0] == term)


def _text(value: Any) -> str:
    return ", ".join(f"{number:.4g}" for number in np.atleast_1d(np.asarray(value, dtype=np.float64)))
