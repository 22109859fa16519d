"""The paper's robot in every engine, all at one time step, and its style in figures."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from validation.engines.any_robot import AnyRobot
from validation.engines.installed import missing
from validation.engines.our_robot import OurRobot

SIM_DT = 1e-3
#: Iterations of Bullet's solver: growth and loads have converged long before, the slip limit never does.
_BULLET_ITERATIONS = 50

SPATIAL, CONTACT, RIGID = "spatial", "contact", "rigid"
ROLLING, TURNED, STOCK, BULLET = "MuJoCo, no slip", "MuJoCo, turned contacts", "MuJoCo, contacts", "PyBullet"

COLORS = {
    SPATIAL: "#212529", CONTACT: "#0b7285", RIGID: "#d9480f",
    ROLLING: "#e0a800", TURNED: "#2b8a3e", STOCK: "#868e96", BULLET: "#5f3dc4",
}  # fmt: skip
DASHES = {ROLLING: (0, (4, 3)), TURNED: (0, (4, 1.5)), STOCK: (0, (1, 1)), BULLET: (0, (6, 1.5, 1, 1.5))}


@dataclass(frozen=True)
class Engine:
    """Its display name, and how to make a robot in it; or why it is missing."""

    name: str
    make: Callable[[bb.Params], AnyRobot]
    reason: str | None = None


def engines() -> list[Engine]:
    """All engines; missing engines with the reason."""
    mujoco, bullet = missing("mujoco"), missing("pybullet")
    return [
        *(Engine(model, partial(_ours, model)) for model in (SPATIAL, CONTACT, RIGID)),
        Engine(ROLLING, _rolling, mujoco),
        Engine(TURNED, partial(_mujoco, True), mujoco),
        Engine(STOCK, partial(_mujoco, False), mujoco),
        Engine(BULLET, _bullet, bullet),
    ]


def absent(found: list[Engine]) -> tuple[str, ...]:
    """The missing engines, and why."""
    return tuple(f"{engine.name} is {engine.reason}" for engine in found if engine.reason)


def _ours(model: str, params: bb.Params) -> AnyRobot:
    return OurRobot(model, params, SIM_DT)


def _rolling(params: bb.Params) -> AnyRobot:
    from validation.against_engines.mujoco_rolling import MujocoRolling

    return MujocoRolling(params, SIM_DT)


def _mujoco(turned: bool, params: bb.Params) -> AnyRobot:
    from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate

    return MujocoRobot(robot_geometry(params), accurate(turned=turned))


def _bullet(params: bb.Params) -> AnyRobot:
    from validation.engines.pybullet_robot import PybulletRobot

    return PybulletRobot(robot_geometry(params), SIM_DT, _BULLET_ITERATIONS)
