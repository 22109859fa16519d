r"""A payload that sways.

A load on a compliant tray, in an arm or in a glass is a point of the mass $m$ on springs and dampers
([payloads](simulate.md#payloads)). In free fall its springs, which held its weight, push it up: with the mass $M$ of
the body alone it moves along the mast by

$$d = \frac{m g}{k}\ (1 - \cos\omega t), \qquad \omega^2 = k\left(\frac{1}{m} + \frac{1}{M}\right).$$

The table has the heaviest payload, in masses of the body alone, that each preset balances in all of 50 episodes of the
[balance task](tasks/balance.md), up to 2; at 1.5 times the height of the CoM, with a damping ratio of 0.05. *Rigid*: it
is fixed to the body; *stiff* and *soft*: it sways 3 and 1 times a second on a body at rest. A law that *expects* it is
designed for the body with the payload at its place, a law that does *not* for the body alone.
"""

import math
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.page import number, table
from validation.robots.sweep import PAPER
from validation.search import largest
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROBOTS: Final = ("paper", "kugle", "rezero", "asroballet")
LAWS: Final = ("lqr", "lqr_pi", "cascade_pid")
#: Names and frequencies of payloads on a body at rest, Hz; None is fixed.
SPRINGS: Final = {"rigid": None, "stiff": 3.0, "soft": 1.0}
EPISODES: Final = 50
#: Heaviest payload that is tried, in masses of the body.
MOST: Final = 2.0
_RATIO: Final = 0.05


def loaded(params: bb.Params, share: float, hertz: float | None) -> bb.Params:
    """The robot with a payload of a fraction of the mass of its body."""
    mass = share * params.body_mass
    stiffness = mass * (2.0 * math.pi * (hertz or 1.0)) ** 2
    robot = params.with_payload(
        mass,
        position=(0.0, 0.0, 1.5 * params.body_com_height),
        stiffness=stiffness,
        damping=2.0 * _RATIO * math.sqrt(stiffness * mass),
    )
    return robot if hertz else robot.with_payloads_fixed()


@cache
def heaviest(robot: str, law: str, spring: str, *, expects: bool) -> float:
    """The heaviest payload with which no episode ends in a fall, in masses of the body alone."""
    alone = bb.Params.preset(robot)

    def holds(share: float) -> bool:
        params = loaded(alone, share, SPRINGS[spring])
        controller = bb.make_controller(law, params if expects else alone, control_dt=0.01)
        return bool(bb.evaluate(controller, episodes=EPISODES, robot=params).survival_rate == 1.0)

    return MOST if holds(MOST) else largest(holds, 0.01, MOST, to=0.02)


def claims() -> list[Claim]:
    """The deflection of a payload in free fall."""
    found = []
    robot = loaded(PAPER, 0.5, 2.0).replace(payload_damping=(0.0, 0.0, 0.0))
    mass, alone = robot.payload_mass, robot.without_payloads().body_mass
    stiffness, time = robot.payload_stiffness[2], 0.1
    omega = math.sqrt(stiffness * (1.0 / mass + 1.0 / alone))
    expected = mass * robot.gravity / stiffness * (1.0 - math.cos(omega * time))
    for model, limit in {"contact": 1e-3, "rigid": 1e-3}.items():
        falling = bb.Ballbot(robot, model, 1e-4)
        row = bb.State.at_rest(robot).to_array()
        # Ball and body, far apart and far above the floor.
        row[2], row[15] = 50.0, 100.0
        falling.reset(bb.State.from_array(row))
        falling.step(np.zeros(3), round(time * 1e4))
        name = f"deflection of a payload after {time:g} s of free fall, {model}"
        found.append(Claim(name, float(falling.payloads[0, 2]), expected, limit, "m"))
    return found


def run() -> Findings:
    """Measures laws on the four presets."""
    rows = []
    for robot in ROBOTS:
        for law in LAWS:
            shares = [heaviest(robot, law, spring, expects=expects) for spring in SPRINGS for expects in (True, False)]
            rows.append([robot, law, *(number(share, 2) for share in shares)])
    head = [f"{spring}{', expects' if expects else ', not'}" for spring in SPRINGS for expects in (True, False)]
    text = table(["robot", "law", *head], rows)

    def draw(fig: "Figure") -> None:
        axes = fig.subplots(1, len(SPRINGS), sharey=True)
        places = np.arange(len(ROBOTS))
        for ax, spring in zip(axes, SPRINGS, strict=True):
            for k, law in enumerate(LAWS):
                found = [heaviest(robot, law, spring, expects=True) for robot in ROBOTS]
                ax.bar(places + 0.25 * (k - 1), found, 0.25, label=law)
            ax.set(title=spring)
            ax.set_xticks(places, ROBOTS, fontsize="small")
        axes[0].set(ylabel="heaviest payload (masses of the body)")
        axes[0].legend()

    return Findings(claims(), draw, text, (10.0, 3.2))
