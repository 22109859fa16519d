"""The tab Robot: the simulated robot and its controller."""

from typing import Any

import viser

from ballbot_rs._core import MODELS
from ballbot_rs.control.resolve import NAMES
from ballbot_rs.viewer.controls import Submit, on_client, put
from ballbot_rs.viewer.session import Session

#: Label of a policy, whose file is named below.
POLICY = "policy file"

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
        chosen = session.controller if session.controller in NAMES else POLICY
        self.robot = gui.add_dropdown("Robot", session.robot_names, initial_value=session.robots.name)
        self.model = gui.add_dropdown("Model", MODELS, initial_value=session.robots.model)
        counts = sorted({1, 4, 16, len(session.robots)})
        self.count = gui.add_dropdown("Robots", [str(n) for n in counts], initial_value=str(len(session.robots)))
        self.controller = gui.add_dropdown("Controller", [*NAMES, POLICY], initial_value=chosen)
        self.policy = gui.add_text(
            "Policy file", "" if chosen != POLICY else session.controller, hint="path of an .onnx file"
        )
        self.sees = gui.add_dropdown(
            "Controller sees",
            tuple(SEES.values()),
            initial_value=SEES[session.observation],
            hint="estimate: what follows from gyroscope, accelerometer and encoders",
        )
        self.ghost = gui.add_dropdown(
            "Compare with", [NONE, *NAMES], hint="a second, transparent robot under this controller, treated alike"
        )
        for control in (self.model, self.robot, self.task, self.controller, self.policy, self.sees, self.count):
            control.on_update(self._choose)
        self.ghost.on_update(on_client(submit, self._compare))

    def _compare(self) -> Any:
        chosen = None if self.ghost.value == NONE else self.ghost.value
        return lambda session: session.compare_with(chosen)

    async def _choose(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is None:  # Our own correction of the display.
            return
        controller = self.policy.value if self.controller.value == POLICY else self.controller.value
        observation = next(name for name, label in SEES.items() if label == self.sees.value)
        wanted = {
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
            changes: dict[str, Any] = {name: value for name, value in wanted.items() if value != now[name]}
            try:
                if "num_robots" in changes:
                    changes["num_robots"] = int(changes["num_robots"])
                if waits_for_name:
                    changes.pop("controller", None)
                    session.notices.append("name a policy file")
                if changes:
                    session.choose(**changes)
            finally:
                if not waits_for_name:
                    self.correct(session)

        self._submit(command)

    def correct(self, session: Session) -> None:
        """Shows the actual choice where a choice was rejected."""
        chosen = session.controller if session.controller in NAMES else POLICY
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
        put(self.ghost, value=NONE if session.ghost is None else session.ghost.controller)


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
