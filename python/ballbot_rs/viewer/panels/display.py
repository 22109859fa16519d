"""The tab View: the camera, what is shown, and light or dark colors."""

import functools
from collections.abc import Callable
from typing import Final

import viser

from ballbot_rs.viewer.panels.controls import add_button, on_client, put
from ballbot_rs.viewer.panels.plots import Plots
from ballbot_rs.viewer.scene.cameras import CAMERAS, CHASE, FOLLOW
from ballbot_rs.viewer.scene.scene import Scene
from ballbot_rs.viewer.session.runner import Command, Submit

#: Color of buttons and selections: white text on it has a contrast of 8.
BRAND = (26, 76, 140)

#: Choices of the colors.
SYSTEM, LIGHT, DARK = "as the system", "light", "dark"

SWITCHES: Final = (
    ("shows_trail", "Trail", "where the balls of robot 0 and of the robot to compare with have been"),
    ("shows_forces", "Forces", "on robot 0: loads blue, tractions green, force along the ground red"),
    ("shows_shadow", "Shadow", "of the robots on the floor"),
)


class DisplayPanel:
    """Controls of the scene and of the page's colors.

    Args:
        server: shows them.
        submit: puts a command into the queue.
        scene: what they change.
        plots: have colors as the page.
        frame_all: has all cameras look at all robots.
    """

    def __init__(
        self, server: viser.ViserServer, submit: Submit, scene: Scene, plots: Plots, frame_all: Callable[[], None]
    ) -> None:
        gui = server.gui
        self._server, self._scene, self._plots, self._frame_all = server, scene, plots, frame_all
        self._is_dark = self._system_is_dark = False
        self._camera = gui.add_dropdown(
            "Camera",
            CAMERAS,
            initial_value=scene.camera.kind,
            hint="chases: behind robot 0, turning with its heading, for driving (key C)",
        )
        self._camera.on_update(on_client(submit, self._choose_camera))
        for name, label, hint in SWITCHES:
            box = gui.add_checkbox(label, getattr(scene, name), hint=hint)
            box.on_update(on_client(submit, functools.partial(self._switch, name, box)))
        self._colors = gui.add_dropdown("Colors", (SYSTEM, LIGHT, DARK), initial_value=SYSTEM)
        self._colors.on_update(on_client(submit, lambda: lambda _: self._apply_colors()))
        add_button(gui, submit, "Look at all robots", lambda _: frame_all())
        self._configure_theme()

    def _choose_camera(self) -> Command:
        kind = self._camera.value
        return lambda _: self.set_camera(kind)

    def set_camera(self, kind: str) -> None:
        """Has the camera follow as one of `CAMERAS`."""
        was_behind, self._scene.camera.kind = self._scene.camera.kind == CHASE, kind
        put(self._camera, value=kind)
        if was_behind != (kind == CHASE):
            self._frame_all()

    def toggle_chase(self) -> None:
        """Puts the camera behind robot 0, or back."""
        self.set_camera(FOLLOW if self._scene.camera.kind == CHASE else CHASE)

    def _switch(self, name: str, box: viser.GuiCheckboxHandle) -> Command:
        return lambda _: setattr(self._scene, name, box.value)

    def set_system_dark(self, is_dark: bool) -> None:
        """Notes the color scheme of the system of the last page."""
        self._system_is_dark = is_dark
        self._apply_colors()

    def _apply_colors(self) -> None:
        is_dark = self._system_is_dark if self._colors.value == SYSTEM else self._colors.value == DARK
        if is_dark != self._is_dark:
            self._is_dark = is_dark
            self._configure_theme()
            self._scene.set_dark(is_dark)
            self._plots.set_dark(is_dark)

    def _configure_theme(self) -> None:
        self._server.gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=BRAND,
            dark_mode=self._is_dark,
        )
