r"""A floor that moves, or is slippery in places.

On the deck of a ship the floor tilts by $A\sin(2\pi t/T)$ (`floor_tilt_amplitude`), in a tram it accelerates with $a$
(`floor_acceleration`, here a trapezoid whose ramps take an eighth of its period, 8 s), and on a wet floor there are
patches in which its friction is multiplied by a factor (`floor_patch_friction`, here from $f$ to 1 on squares of
0.5 m); see [perturbed floors](terrain.md#perturbed-floors). A ball that slides decelerates with $\mu(x)\ g$; relative
to an accelerating floor a ball rolls with $-a/(1+\gamma)$, $\gamma = J_k/(M_k r_k^2)$; and a tram that accelerates
steadily is a slope of $\arctan(a/g)$ with the gravity $\sqrt{g^2 + a^2}$.

The table shows what each preset withstands with the law designed for it, in 50 episodes of 10 s of the balance task
with random phases and headings. *Holds*: none falls, and the ball stays within 0.5 m of its setpoint (root mean
square); *upright*: none falls, up to the largest values tried, 23° and 6 m/s². Laws assume a level floor at rest. `lqr`
holds the ball near its setpoint until its lean is limited, and then lets the robot roll along, upright; `lqr_pi` is
nearer to its setpoint on gentle floors, and falls on others. *Patches* is the smallest factor $f$ with which, in the
velocity task, no more of 50 episodes fall than on a dry floor: as the commanded speed changes gently, robots need
little friction.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.page import number, table
from validation.robots.sweep import PAPER
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROBOTS = ("paper", "kugle", "rezero", "asroballet")
LAWS = ("lqr", "lqr_pi")
#: Of a ship, s.
PERIOD = 10.0
EPISODES = 50
#: Of a tram, s, and the fraction of a quarter of it in which the acceleration rises.
_TRAM = (8.0, 0.5)
#: The largest tilt and acceleration that are tried, rad and m/s².
_MOST = (0.4, 6.0)
#: Largest root mean square of the ball's distance from the setpoint, m.
_NEAR = 0.5
#: Of a patch, m.
_PATCH = 0.5


def _phases(name: str) -> dict[str, Any]:
    return {"term": name, "range": [0.0, 2.0 * math.pi]}


def ship(amplitude: float) -> list[dict[str, Any]]:
    """Events of a ship that rolls, rad."""
    return [
        {"term": "floor_tilt_amplitude", "range": [[amplitude, amplitude], [0.0, 0.0]]},
        {"term": "floor_tilt_period", "range": [PERIOD, PERIOD]},
        _phases("floor_tilt_phases"),
    ]


def tram(acceleration: float) -> list[dict[str, Any]]:
    """Events of a tram, m/s²."""
    period, rise = _TRAM
    return [
        {"term": "floor_acceleration", "range": [[acceleration, acceleration], [0.0, 0.0]]},
        {"term": "floor_acceleration_period", "range": [period, period]},
        {"term": "floor_acceleration_rise", "range": [rise, rise]},
        _phases("floor_acceleration_phase"),
    ]


def patches(least: float) -> list[dict[str, Any]]:
    """Events of a floor with slippery patches."""
    return [
        {"term": "floor_patch_size", "range": [_PATCH, _PATCH]},
        {"term": "floor_patch_friction", "range": [[least, least], [1.0, 1.0]]},
        {"term": "floor_patch_seed", "range": [0.0, 1e6]},
    ]


def _result(law: str, robot: str, events: list[dict[str, Any]], task: str = "balance") -> Any:
    return bb.evaluate(law, task=task, episodes=EPISODES, robot=robot, events=events)


class Row(NamedTuple):
    """What a robot withstands with a law."""

    #: Tilts of a ship at which it holds its place and stays upright, rad.
    ships: tuple[float, float]
    #: Accelerations of a tram at which it holds its place and stays upright, m/s².
    trams: tuple[float, float]
    #: Least factor of patches.
    factor: float


def _most(holds: Callable[[float], bool], high: float, to: float) -> float:
    return high if holds(high) else largest(holds, 0.0, high, to=to)


@cache
def withstood(law: str, robot: str) -> Row:
    """The largest motions and the most slippery patches."""

    def holds(events: list[dict[str, Any]], near: float) -> bool:
        result = _result(law, robot, events)
        return bool(result.survival_rate == 1.0 and result.ball_rms <= near)

    def both(events: Callable[[float], list[dict[str, Any]]], high: float) -> tuple[float, float]:
        held, upright = (
            _most(lambda value, near=near: holds(events(value), near), high, high / 200.0)  # type: ignore[misc]
            for near in (_NEAR, math.inf)
        )
        return held, upright

    dry = _result(law, robot, patches(1.0), "velocity").survival_rate
    slippery = _most(
        lambda less: bool(_result(law, robot, patches(1.0 - less), "velocity").survival_rate >= dry), 1.0, 0.01
    )
    return Row(both(ship, _MOST[0]), both(tram, _MOST[1]), 1.0 - slippery)


def _ball(params: bb.Params, speed: float, model: str = "contact") -> bb.Ballbot:
    """A ball far below its bot, without spin."""
    robot = bb.Ballbot(params, model, 2e-4)
    state = bb.State.at_rest(params)
    row = state.to_array()
    row[7] = speed
    # Body position, z.
    row[15] += 200.0
    robot.reset(bb.State.from_array(row))
    return robot


def claims() -> list[Claim]:
    """A sliding ball, a ball on an accelerating floor, and a tram as a slope."""
    found = []
    slide = PAPER.replace(floor_static_friction=0.3, floor_dynamic_friction=0.3, floor_friction_gradient=(0.5, 0.0))
    rate, time, speed = math.sqrt(0.3 * PAPER.gravity * 0.5), 0.1, 3.0
    place = (math.cos(rate * time) - 1.0) / 0.5 + speed / rate * math.sin(rate * time)
    turning = PAPER.replace(floor_acceleration=(1.5, 0.0), floor_acceleration_period=0.8)
    gamma = PAPER.ball_inertia / (PAPER.ball_mass * PAPER.ball_radius**2)
    gained = -1.5 * 0.8 / (2.0 * math.pi) * (1.0 - math.cos(2.0 * math.pi * 0.3 / 0.8)) / (1.0 + gamma)
    for model, limits in {"contact": (1e-3, 1e-5), "rigid": (1e-3, 1e-3)}.items():
        ball = _ball(slide, speed, model)
        ball.step(np.zeros(3), 500)
        x = float(ball.state.ball_position[0])
        found.append(Claim(f"place of a ball that slides on a gradient of friction, {model}", x, place, limits[0], "m"))
        ball = _ball(turning, 0.0, model)
        ball.step(np.zeros(3), 1500)
        v = float(ball.state.ball_velocity[0])
        found.append(Claim(f"speed of a ball relative to an accelerating floor, {model}", v, gained, limits[1], "m/s"))
    steady = PAPER.replace(
        floor_acceleration=(-1.2, 0.0),
        floor_acceleration_period=1e9,
        floor_acceleration_phase=0.5 * math.pi,
        floor_acceleration_rise=0.5,
    )
    slope = PAPER.replace(floor_tilt=(0.0, math.atan(1.2 / PAPER.gravity)), gravity=math.hypot(1.2, PAPER.gravity))
    for model, limit in {"spatial": 1e-10, "contact": 1e-10, "rigid": 1e-7}.items():
        rows = []
        for params in (steady, slope):
            robot = bb.Ballbot(params, model, 0.001)
            robot.reset(bb.State.at_rest(PAPER, (0.05, -0.1)))
            robot.step(np.array([0.1, -0.05, 0.02]), 300)
            rows.append(robot.state.to_array())
        apart = float(np.abs(rows[1] - rows[0]).max())
        name = f"largest difference of a tram and its slope after 0.3 s, {model}"
        found.append(Claim(name, apart, 0.0, limit, "", True))
    return found


def run() -> Findings:
    """Measures laws on the four presets."""
    rows = []
    for robot in ROBOTS:
        for law in LAWS:
            row = withstood(law, robot)
            found = (*(math.degrees(tilt) for tilt in row.ships), *row.trams)
            rows.append([robot, law, *(number(value, 2) for value in found), f"{row.factor:.2f}"])
    head = ["robot", "law", f"ship of {PERIOD:g} s: holds, deg", "upright, deg"]
    text = table([*head, "tram: holds, m/s²", "upright, m/s²", "patches"], rows)

    def draw(fig: "Figure") -> None:
        axes = fig.subplots(1, 3)
        places = np.arange(len(ROBOTS))
        for shift, law in zip((-0.2, 0.2), LAWS, strict=True):
            found = [withstood(law, robot) for robot in ROBOTS]
            axes[0].bar(places + shift, [math.degrees(row.ships[0]) for row in found], 0.4, label=law)
            axes[1].bar(places + shift, [row.trams[0] for row in found], 0.4, label=law)
            axes[2].bar(places + shift, [row.factor for row in found], 0.4, label=law)
        labels = (f"ship of {PERIOD:g} s, holds (deg)", "tram, holds (m/s²)", "least factor of patches")
        for ax, label in zip(axes, labels, strict=True):
            ax.set(ylabel=label)
            ax.set_xticks(places, ROBOTS, fontsize="small")
        axes[0].legend()

    return Findings(claims(), draw, text, (10.0, 3.2))
