"""The robot as links of parts, with their mass properties."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from cad.ball import ball
from cad.body import body
from cad.drive import drives
from cad.keeper import keeper
from cad.omniwheel import wheel
from cad.parameters import WHEEL
from cad.part import Mass, Part, combined, mass_of, wheel_location


@dataclass(frozen=True)
class RobotSolids:
    """Parts of each link, in the frame of the link."""

    body: list[Part]
    wheel: list[Part]
    ball: list[Part]

    def wheels(self) -> list[list[Part]]:
        """Parts of the three wheels in the body frame."""
        return [[part.moved(wheel_location(azimuth)) for part in self.wheel] for azimuth in WHEEL.azimuths]

    def links(self) -> dict[str, Mass]:
        """Mass properties of the links, each in its frame."""
        return {"body": mass_of(self.body), "wheel": mass_of(self.wheel), "ball": mass_of(self.ball)}

    def properties(self) -> dict[str, float]:
        """Mass properties by the names of Table II, in SI units."""
        links = self.links()
        wheels = [mass_of(parts) for parts in self.wheels()]
        spin = links["wheel"].inertia[2, 2]
        bot = combined([links["body"], *wheels])
        # J_b and J_z exclude the inertia of the wheels about their axles.
        inertia = bot.inertia - sum(spin * np.outer(axle, axle) for axle in axles())
        return {
            "M_b": bot.mass,
            "l": bot.center[2],
            "J_b": 0.5 * (inertia[0, 0] + inertia[1, 1]),
            "J_z": inertia[2, 2],
            "wheel mass": links["wheel"].mass,
            "J_w": spin,
            "M_k": links["ball"].mass,
            "J_k": links["ball"].inertia[0, 0],
        }


def axles() -> list[np.ndarray]:
    """Unit vectors of the wheel axles in the body frame."""
    a = math.radians(WHEEL.zenith)
    azimuths = [math.radians(azimuth) for azimuth in WHEEL.azimuths]
    return [np.array([math.cos(a) * math.cos(b), math.cos(a) * math.sin(b), -math.sin(a)]) for b in azimuths]


@cache
def robot() -> RobotSolids:
    """The robot of the paper, built once."""
    return RobotSolids(body() + drives() + keeper(), wheel(), ball())
