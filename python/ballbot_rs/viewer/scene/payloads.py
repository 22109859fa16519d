"""The payloads of a robot in the scene."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt
import viser

from ballbot_rs._core import Params
from ballbot_rs._payloads import payloads_of
from ballbot_rs.viewer.scene.look import Color

FloatArray = npt.NDArray[np.float64]

#: Density of the drawn balls, kg/m³: water.
DENSITY: Final = 1000.0
COLOR: Color = (66, 120, 184)


class PayloadNodes:
    """Balls of the payloads' masses, in the frame of a body."""

    def __init__(self, server: viser.ViserServer, body: str) -> None:
        self._scene, self._body = server.scene, body
        self._nodes: list[viser.IcosphereHandle] = []

    def show(self, params: Params, deflections: FloatArray | None) -> None:
        """Moves them to their deflections, as `Ballbot.payloads`; None is of a robot without payload."""
        payloads, moved = ([], np.zeros((0, 6))) if deflections is None else (payloads_of(params), deflections)
        while len(self._nodes) < len(payloads):
            name = f"{self._body}/payload_{len(self._nodes)}"
            self._nodes.append(self._scene.add_icosphere(name, 1.0, COLOR, subdivisions=2))
        for node in self._nodes[len(payloads) :]:
            node.visible = False
        for node, payload, deflection in zip(self._nodes, payloads, moved, strict=False):
            node.visible = True
            node.scale = (0.75 * payload.mass / (math.pi * DENSITY)) ** (1.0 / 3.0)
            node.position = np.add(payload.position, deflection[:3])
