"""A robot balanced on waves: `contact`, `rigid`, and MuJoCo with a plane that follows the ground under the ball.

The regulator takes the robot to the origin for one second; the waves have 0.8 m and up to 0.08 rad. MuJoCo's plane
is tangent to the ground under the ball and is updated in each step, so that the engines differ only in their contacts;
its contact frames are turned to the wheels. Each difference is listed with the difference of the same motion on level
ground.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIM_DT, _STEPS, _CONTROLS = 0.5e-3, 10, 200
_PLACE, _YAW = (0.15, 0.1), 0.2
#: m; the robot comes 0.1 m far.
_LIMITS = {"rigid": 1e-7, "mujoco": 3e-5}


def run() -> Findings:
    """Balances in each engine on waves and on level ground."""
    waves = bb.Terrain.generate("wave", slope=0.08, wavelength=0.8, direction=0.4, size_x=4.0, size_y=4.0)
    paths = {
        ground: {engine: _path(engine, terrain) for engine in ("contact", "rigid", "mujoco")}
        for ground, terrain in (("waves", waves), ("level ground", None))
    }
    claims = []
    for ground, found in paths.items():
        for engine, limit in _LIMITS.items():
            apart = float(np.linalg.norm(found[engine][:, :3] - found["contact"][:, :3], axis=1).max())
            claims.append(
                Claim(f"ball apart from `contact` on {ground}, `{engine}`", apart, 0.0, limit, "m", absolute=True)
            )

    def draw(fig: "Figure") -> None:
        axes = fig.subplots(1, 2)
        times = _SIM_DT * _STEPS * np.arange(1, _CONTROLS + 1)
        for ax, (ground, found) in zip(axes, paths.items(), strict=True):
            for engine, line in (("contact", "-"), ("rigid", "--"), ("mujoco", ":")):
                ax.plot(
                    times,
                    1e3 * (found[engine][:, 0] - found[engine][0, 0]),
                    line,
                    label="MuJoCo" if engine == "mujoco" else engine,
                )
            ax.set(xlabel="time (s)", ylabel="x of the ball (mm)", title=ground)
        axes[0].legend()

    return Findings(claims, draw)


def _path(engine: str, terrain: bb.Terrain | None) -> Array:
    """Positions of the ball (3, m) after each control step."""
    params = bb.Params.paper()
    ours = bb.Ballbot(params, model="rigid" if engine == "rigid" else "contact", sim_dt=_SIM_DT, terrain=terrain)
    ours.place_on_ground(*_PLACE, yaw=_YAW, tilt=None if terrain is not None else (0.05, -0.03))
    law = bb.make_controller("lqr", params, control_dt=_SIM_DT * _STEPS)
    setpoint = bb.Setpoint(position=np.zeros(2), yaw=_YAW)
    robot: object = ours
    if engine == "mujoco":
        from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
        from ballbot_rs.engines.robot_geometry import robot_geometry

        there = MujocoRobot(robot_geometry(params), accurate(_SIM_DT), terrain)
        there.reset(ours.state)
        robot = there
    path = []
    for _ in range(_CONTROLS):
        state = ours.state if robot is ours else there.state()
        torques = law(state, setpoint)
        if robot is ours:
            ours.step(torques, _STEPS)
        else:
            there.step(torques, _STEPS)
        path.append((ours.state if robot is ours else there.state()).ball_position)
    return np.array(path)
