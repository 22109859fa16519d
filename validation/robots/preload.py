r"""Preload of the wheels.

Springs, magnets or a keeper below the ball's equator press the wheels on the ball with $P$ (`wheel_preload`), beyond
the weight. The load of each wheel grows in any motion; upright at rest, it is

$$N = \frac{M_b g + P}{3\cos\alpha}$$

The load on the floor remains the weight, and a rolling robot moves as it would without preload
([preload](derivations.md#preload)). So wheels slip later: three equal torques break loose at a torque in proportion to
$N$.

The second table has each preset with LQR made for it, which uses the traction: the largest tilt from which it recovers
([scenario](scenarios.md) `S2-rest`) and the largest push that it withstands (`S3-at-once`), in the worst of 24
directions, and next to them the tilt that traction and motors can hold and the push that moves the capture point to
that limit (`Scale`).

Where traction is the limit, tilts grow with the preload: the paper's robot recovers from twice the tilt at one weight.
Then other limits take over. The motors limit kugle at any preload and asroballet above half a weight, so that more
gains nothing; and the friction of the floor, which the preload does not load, is the same. The push limit gains less
than the tilt limit: from none to two weights three quarters on the paper's robot, where the capture push triples.
"""

import dataclasses
import math
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.closed_forms import friction_limit
from validation.page import number, table
from validation.robots.sweep import PAPER
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Preloads, in weights of the body.
WEIGHTS = (0.0, 0.5, 1.0, 2.0)
ROBOTS = ("paper", "kugle", "rezero", "asroballet")
#: Tilts of the paper's robot: least and step, deg. They end at the floor.
TILTS = (12.0, 1.0)
#: Its pushes: least, most and step, N·s.
PUSHES = (0.2, 3.8, 0.1)
DIRECTIONS = 24
#: Models, and the errors of their loads.
_MODELS = {"spatial": 1e-12, "contact": 1e-9, "rigid": 1e-6}


def pressed(params: bb.Params, weights: float) -> bb.Params:
    """The robot with a preload, in weights of its body."""
    return params.replace(wheel_preload=weights * params.body_mass * params.gravity)


def load(params: bb.Params) -> float:
    """Closed form of the load of each wheel upright at rest, N."""
    return (params.body_mass * params.gravity + params.wheel_preload) / (3.0 * math.cos(params.wheel_zenith))


def slip_torque(params: bb.Params, model: str) -> float:
    """Three equal torques at which the wheels break loose, N·m."""
    return largest(partial(friction_limit.grips, params, model, 0.0), 0.0, 3.0, to=1e-5)


def claims() -> list[Claim]:
    """Loads in each model, slip, and a motion with it and without it."""
    found = []
    robot = pressed(PAPER, 1.0)
    floor = (PAPER.body_mass + PAPER.ball_mass) * PAPER.gravity
    for model, limit in _MODELS.items():
        at_rest = bb.Ballbot(robot, model, 0.001)
        at_rest.step(np.zeros(3), 300)
        forces = at_rest.contacts
        found += [
            Claim(f"load of a wheel at P = M_b g, {model}", forces.wheel_normal_forces[0], load(robot), limit, "N"),
            Claim(f"load of the floor at P = M_b g, {model}", forces.floor_force[2], floor, limit, "N"),
        ]
    for model in ("contact", "rigid"):
        expected = friction_limit.slip_torque(PAPER) * load(robot) / load(PAPER)
        name = f"three equal torques at which the wheels slip at P = M_b g, {model}"
        found.append(Claim(name, slip_torque(robot, model), expected, 2e-3, "N·m"))
    rolled = []
    for params in (PAPER, robot):
        rolling = bb.Ballbot(params)
        rolling.reset(bb.State.at_rest(params, (0.03, -0.02)))
        rolling.step(np.array([0.05, -0.03, 0.02]), 100)
        rolled.append(rolling.state.to_array())
    apart = float(np.abs(rolled[1] - rolled[0]).max())
    found.append(Claim("largest change of a state after 0.2 s of rolling, contact", apart, 0.0, 1e-12, "", True))
    return found


@dataclasses.dataclass(frozen=True)
class Row:
    """A robot with a preload: what LQR survives, and what traction and motors can hold."""

    #: deg.
    recovered: float
    #: N·s.
    withstood: float
    #: deg.
    held: float
    #: N·s.
    captured: float


@cache
def floor_tilt(robot: str) -> float:
    """Largest tilt at which the robot touches the floor in none of the directions, deg."""
    params = bb.Params.preset(robot)
    at = bb.Ballbot(params)

    def clear(degrees: float) -> bool:
        for angle in np.arange(DIRECTIONS) * 2.0 * np.pi / DIRECTIONS:
            tilt = math.radians(degrees) * np.array([-np.sin(angle), np.cos(angle)])
            try:
                at.reset(bb.State.at_equilibrium(params, tilt=tuple(tilt)))
            except bb.InvalidInputError:
                return False
        return True

    return largest(clear, 0.0, 89.0, to=0.01)


@cache
def measured(robot: str, weights: float) -> Row:
    """LQR in both scenarios, with the same tilts and pushes whatever the preload."""
    plain = bb.Params.preset(robot)
    params = pressed(plain, weights)
    own, scale, paper = (bb.Scale.of(one) for one in (plain, params, PAPER))
    # Scenarios scale their numbers from the paper's robot to the robot in them.
    least, size = (one.holdable_lean / paper.holdable_lean for one in (own, scale))
    first, step = (least / size * tilt for tilt in TILTS)
    tilts = (first, first + step * int((floor_tilt(robot) / size - first) / step), step)
    gentle, hard, by = (own.capture_impulse / scale.capture_impulse * push for push in PUSHES)
    known = bb.load_scenarios()
    scenarios = [
        dataclasses.replace(known["S2-rest"], tilt=tilts),
        dataclasses.replace(known["S3-at-once"], push=(gentle, hard, by)),
    ]
    recovered, withstood = (outcome.score for outcome in bb.run_scenarios("lqr", scenarios, robot=params))
    return Row(recovered, withstood, math.degrees(scale.holdable_lean), scale.capture_impulse)


def run() -> Findings:
    """Measures LQR on the four presets with preloads."""
    torques = [[slip_torque(pressed(PAPER, weights), model) for weights in WEIGHTS] for model in ("contact", "rigid")]
    shares = np.linspace(0.0, WEIGHTS[-1], 50)
    line = friction_limit.slip_torque(PAPER) * np.array([load(pressed(PAPER, x)) for x in shares]) / load(PAPER)
    rows = []
    for robot in ROBOTS:
        for weights in WEIGHTS:
            row = measured(robot, weights)
            found = (row.recovered, row.held, row.withstood, row.captured)
            rows.append([robot, f"{weights:g}", *(number(value, 3) for value in found)])
    head = ["robot", "P / (M_b g)", "recovers from, deg", "can hold, deg", "withstands, N·s", "capture, N·s"]
    text = table(head, rows)

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MARKERS, look

        left, middle, right = fig.subplots(1, 3)
        left.plot(shares, line, label="closed form")
        for torque, model, marker in zip(torques, ("contact", "rigid"), ("o", "x"), strict=True):
            left.plot(WEIGHTS, torque, marker, label=model)
        left.set(xlabel="preload (weights)", ylabel="torque at which wheels slip (N·m)")
        left.legend()
        for place, robot in enumerate(ROBOTS):
            style = {**look(place), "marker": MARKERS[place], "label": robot}
            found = [measured(robot, weights) for weights in WEIGHTS]
            middle.plot(WEIGHTS, [row.recovered for row in found], **style)
            right.plot(WEIGHTS, [row.withstood / found[0].captured for row in found], **style)
        middle.set(xlabel="preload (weights)", ylabel="recovers from (deg)", ylim=(0.0, None))
        right.set(xlabel="preload (weights)", ylabel="withstands / capture without", ylim=(0.0, None))
        middle.legend()

    return Findings(claims(), draw, text, (10.0, 3.2))
