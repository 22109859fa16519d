"""Which controller for which robot.

Robots that differ from the model their controller was designed for: 20 per cell, on the task `balance`, from starts
within 5°. The number is the distance of the ball from the setpoint from 10 s to 20 s, RMS over the robots that stay
upright, in mm; falls are counted. The controllers know none of the deviations: neither the center of mass, 0.5° off as
seen from the ball's center, nor Coulomb friction in the wheel joints of 5 % of the torque that makes a wheel slip, nor
the delay of the motors, nor the slope.

`lqr` with `lean_observer=4` is the best choice if the robot must hold its position: it estimates the equilibrium, which
a center-of-mass offset or a slope shifts. The other controllers come to rest where the torque from their position error
balances the disturbance. Joint friction leaves all of them in a small limit cycle, often smallest with `lqr_pi`. Where
nothing differs, plain `lqr` is enough.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS
from ballbot_rs._state_rows import BALL_POSITION
from validation.claim import Claim
from validation.page import table
from validation.topic import Findings

ROBOTS_OF_A_CELL: Final = 20
SECONDS: Final = (10.0, 20.0)
ENDLESS: Final = 1_000_000

#: Controllers and their options.
CHOICES: Final[Mapping[str, tuple[str, dict[str, Any]]]] = {
    "`lqr`": ("lqr", {}),
    "`lqr`, `lean_observer=4`": ("lqr", {"lean_observer": 4.0}),
    "`lqr_pi`": ("lqr_pi", {}),
    "`cascade_pid`": ("cascade_pid", {}),
}
#: Of the controller that the page recommends.
OBSERVING: Final = 1


def run() -> Findings:
    """All controllers on all robots, nominal and off."""
    rows, claims = [], []
    for robot in ROBOTS:
        params = bb.Params.preset(robot)
        fell, away = 0, 0.0
        for what, options in _conditions(params).items():
            found = [_late(params, options, *choice) for choice in CHOICES.values()]
            rows.append([f"{robot}, {what}", *(_cell(distance, falls) for distance, falls in found)])
            fell += sum(falls for _, falls in found)
            away = max(away, found[OBSERVING][0])
        claims.append(Claim(f"robots that fall, {robot}", float(fell), 0.0, 0.0, "", True))
        claims.append(Claim(f"largest distance of {list(CHOICES)[OBSERVING]}, {robot}", away, 0.0, 5.0, "mm", True))
    return Findings(claims, None, table(["robot", *CHOICES], rows))


def _conditions(params: bb.Params) -> dict[str, dict[str, Any]]:
    """What differs, as options of an environment."""
    offset = params.body_com_height * float(np.tan(np.deg2rad(0.5)))
    rubbing = params.wheel_coulomb_friction + 0.05 * bb.Batch(1, robot=params, num_threads=1).max_wheel_torque
    slope = float(np.deg2rad(1.0))
    return {
        "nominal": {},
        "center of mass": {"events": [_event("body_com_offset", [[offset, offset], [0.0, 0.0]])]},
        "wheel joints": {"events": [_event("wheel_coulomb_friction", [rubbing, rubbing])]},
        "delay 20 ms": {"actuators": {"delay": 0.02}},
        "slope 1°": {"events": [_event("floor_tilt", [[slope, slope], [0.0, 0.0]])]},
    }


def _event(term: str, values: list[Any]) -> dict[str, Any]:
    return {"term": term, "mode": "startup", "range": values}


def _late(params: bb.Params, options: Mapping[str, Any], name: str, chosen: Mapping[str, Any]) -> tuple[float, int]:
    """The late distance in mm, and falls."""
    batch = bb.Batch(ROBOTS_OF_A_CELL, robot=params, seed=1, autoreset="disabled", max_episode_steps=ENDLESS, **options)
    law = bb.Controller(name, params, batch.control_dt, **chosen)
    batch.reset()
    fell = np.zeros(batch.num_envs, dtype=bool)
    squares = []
    first, last = (round(seconds / batch.control_dt) for seconds in SECONDS)
    for step in range(last):
        fell |= batch.step(batch.control(law))[2]
        if step >= first:
            squares.append((batch.states()[:, BALL_POSITION][:, :2] ** 2).sum(axis=1))
        if fell.any():
            batch.reset(mask=fell)
    upright = np.array(squares)[:, ~fell]
    return 1e3 * float(np.sqrt(upright.mean())) if upright.size else float("nan"), int(fell.sum())


def _cell(distance: float, falls: int) -> str:
    text = "none upright" if np.isnan(distance) else "below 0.1" if distance < 0.1 else f"{distance:.3g}"
    return f"{text}, {falls} of {ROBOTS_OF_A_CELL} fall" if falls else text
