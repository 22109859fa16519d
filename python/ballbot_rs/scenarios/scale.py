"""Difficulty for a robot: the numbers that scale scenarios from one robot to another."""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from ballbot_rs import _short
from ballbot_rs._core import Ballbot, LinearModel, Params, SpatialModel
from ballbot_rs._keywords import named
from ballbot_rs._robot import Robot, params_of

#: Directions in which the traction is checked.
_DIRECTIONS = 72


@dataclasses.dataclass(frozen=True, repr=False)
class Scale:
    """Numbers of one robot, from its linear model and its wheel loads when upright.

    ```python
    scale = bb.Scale.of("kugle")
    print(scale.holdable_lean, scale.capture_impulse)
    ```

    Derived in docs/scenarios.md.
    """

    #: Rate at which it topples, 1/s.
    toppling_rate: float
    #: Acceleration per steady lean, m/(s²·rad).
    acceleration_per_lean: float
    #: Lean that it can hold with the upright robot's traction in the worst direction, rad.
    holdable_lean: float
    #: Largest impulse at the center of mass that keeps the capture point within the holdable lean, N·s.
    capture_impulse: float
    #: Horizontal force at the center of mass per lean that balances it, N/rad.
    force_per_lean: float

    def __repr__(self) -> str:
        return _short.fields(self)

    @classmethod
    @named
    def of(cls, robot: Robot) -> "Scale":
        """The numbers of a robot: `Params`, the name of a preset, the path of a TOML file or a dict of parameters.

        Raises:
            TypeError, ValueError, OSError: as for the `robot` of `simulate`.
        """
        params = params_of(robot)
        linear = LinearModel(params)
        turning, toppling = linear.turning_torques, linear.toppling_squared
        hold = min(_holdable(params, turning, toppling, angle) for angle in _angles().tolist())
        rate = math.sqrt(toppling)
        moment = params.body_mass * params.gravity * float(np.linalg.norm(params.body_com))
        return cls(
            toppling_rate=rate,
            acceleration_per_lean=linear.acceleration_per_lean,
            holdable_lean=hold,
            capture_impulse=hold * rate / _rate_per_impulse(params),
            force_per_lean=moment / (params.body_com_height + params.ball_radius),
        )


def _angles() -> npt.NDArray[np.float64]:
    return np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False, dtype=np.float64)


def _holdable(params: Params, turning: npt.NDArray[np.float64], toppling: float, angle: float) -> float:
    """Lean in a direction at which a wheel slips under the holding torques, with upright wheel loads, rad."""
    torques = turning @ (-toppling * np.array([-np.sin(angle), np.cos(angle), 0.0]))
    level = params.replace(floor_tilt=(0.0, 0.0))
    upright = (1.0, 0.0, 0.0, 0.0)
    model = SpatialModel(level.replace(wheel_coulomb_friction=0.0))
    still, driven = (model.contacts(upright, np.zeros(6), factor * torques) for factor in (0.0, 1.0))
    loads = np.asarray(still.wheel_normal_forces), np.asarray(driven.wheel_normal_forces)
    pulls = np.asarray(still.wheel_tractions), np.asarray(driven.wheel_tractions)
    friction = params.wheel_dynamic_friction
    # f + s Δf = ± μ (N + s ΔN)
    shares = [
        (friction * loads[0] - sign * pulls[0])
        / np.maximum(sign * (pulls[1] - pulls[0]) - friction * (loads[1] - loads[0]), 1e-300)
        for sign in (1.0, -1.0)
    ]
    motors = params.max_wheel_torque / np.abs(torques).max()
    return float(min(np.min(shares), motors))


def _rate_per_impulse(params: Params) -> float:
    """Tilt rate per impulse at the center of mass, rad/(N·m·s²)."""
    fixed = params.with_payloads_fixed().on_still_floor()
    robot = Ballbot(fixed.replace(floor_tilt=(0.0, 0.0), roller_ripple=0.0), "spatial")
    impulse = 1e-3 * params.body_mass
    robot.push((impulse, 0.0, 0.0))
    return float(abs(robot.state.body_angular_velocity[1]) / impulse)
