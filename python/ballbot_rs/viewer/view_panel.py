"""The tab View: display options of the scene."""

import functools
from collections.abc import Callable

import viser

from ballbot_rs.viewer.controls import Submit, add_button, on_client
from ballbot_rs.viewer.scene import Scene
from ballbot_rs.viewer.session import Session


class ViewPanel:
    """Switches of the scene.

    Args:
        server: shows them.
        submit: puts a command into the queue, whose thread owns the scene.
        scene: the scene that they switch.
        frame: places the cameras of all pages so that they see all robots.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit, scene: Scene, frame: Callable[[], None]) -> None:
        gui = server.gui
        switches = (
            ("follows", "Camera follows", "robot 0 stays in the middle"),
            ("shows_trail", "Trail", "where the ball of robot 0 has been"),
            ("shows_forces", "Forces", "on robot 0: loads blue, tractions green, force along the ground red"),
            ("shows_shadow", "Shadow", "of the robots on the floor"),
        )
        for name, label, hint in switches:
            box = gui.add_checkbox(label, getattr(scene, name), hint=hint)
            box.on_update(on_client(submit, functools.partial(_switch, scene, name, box)))
        add_button(gui, submit, "Look at all robots", lambda session: frame())  # noqa: ARG005


def _switch(scene: Scene, name: str, box: viser.GuiCheckboxHandle) -> Callable[[Session], None]:
    return lambda session: setattr(scene, name, box.value)  # noqa: ARG005
