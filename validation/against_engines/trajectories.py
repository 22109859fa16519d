"""The same experiment in every engine, and how far each deviates from `spatial`."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array
from validation.against_engines.engine_list import COLORS, CONTACT, ROLLING, SPATIAL, Engine, absent
from validation.claim import Claim
from validation.engines.any_robot import AnyRobot
from validation.page import number, table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CONTROL_DT = 0.005
_FALLEN = np.radians(20.0)

#: Wheel torques of the state and the time.
Law = Callable[[bb.State, float], Array]


class Trajectory:
    """Tilt components (rad), ball positions (m), yaws (rad) at every control step, loads (N) after it."""

    def __init__(self, robot: AnyRobot, start: bb.State, law: Law, seconds: float) -> None:
        robot.reset(start)
        samples = round(seconds / CONTROL_DT) + 1
        self.times = CONTROL_DT * np.arange(samples)
        self.tilts, self.positions = np.full((samples, 2), np.nan), np.full((samples, 2), np.nan)
        self.yaws, self.loads = np.full(samples, np.nan), np.full((samples, 3), np.nan)
        for k, time in enumerate(self.times):
            state = robot.state()
            self.tilts[k], self.positions[k], self.yaws[k] = state.tilt_components, state.ball_position[:2], state.yaw
            if state.tilt > _FALLEN:
                break
            robot.step(law(state, float(time)), round(CONTROL_DT / robot.sim_dt))
            self.loads[k] = robot.wheel_loads()
        robot.close()

    @property
    def fell(self) -> bool:
        """Whether it ended early."""
        return bool(np.isnan(self.yaws[-1]))

    def strays(self, other: "Trajectory") -> tuple[float, float, float]:
        """RMS difference of the tilt (deg), the position (mm) and the yaw (deg)."""
        tilt = np.degrees(np.linalg.norm(self.tilts - other.tilts, axis=1))
        position = 1e3 * np.linalg.norm(self.positions - other.positions, axis=1)
        yaw = np.degrees(np.arctan2(np.sin(self.yaws - other.yaws), np.cos(self.yaws - other.yaws)))
        rms = tuple(float(np.sqrt(np.mean(np.square(part)))) for part in (tilt, position, yaw))
        return rms[0], rms[1], rms[2]


def in_all(
    engines: list[Engine], params: bb.Params, start: bb.State, law: Law, seconds: float
) -> dict[str, Trajectory]:
    """One trajectory in each available engine, by its name."""
    return {e.name: Trajectory(e.make(params), start, law, seconds) for e in engines if not e.reason}


def findings(claims: list[Claim], runs: dict[str, Trajectory], engines: list[Engine]) -> Findings:
    """The claims with the figure and the table of all trajectories."""

    def figure(fig: "Figure") -> None:
        draw(fig, runs)

    return Findings(claims, figure, strays_table(runs), (9.0, 5.2), missing=absent(engines))


def tilt_claims(trajectories: dict[str, Trajectory], limits: dict[str, float], when: str = "") -> list[Claim]:
    """RMS deviation of the tilts from `spatial`, for each engine that ran and has a limit (deg)."""
    claims = []
    for name, limit in limits.items():
        if name in trajectories:
            tilt, _, _ = trajectories[name].strays(trajectories[SPATIAL])
            what = f"{name}: RMS tilt apart from `spatial`{when}"
            claims.append(Claim(what, tilt, 0.0, limit, "deg", absolute=True))
    return claims


def load_claims(trajectories: dict[str, Trajectory], limit: float) -> list[Claim]:
    """That both models without slip put the same loads (N) on the wheels, if the other engine's ran."""
    if ROLLING not in trajectories:
        return []
    apart = float(np.abs(trajectories[ROLLING].loads - trajectories[SPATIAL].loads).max())
    return [Claim(f"{ROLLING}: largest wheel load apart", apart, 0.0, limit, "N", absolute=True)]


def strays_table(trajectories: dict[str, Trajectory]) -> str:
    """Deviation of each from `spatial`, and of its tilt from `contact`, which has the others' first-order step."""
    rows = []
    for name, trajectory in trajectories.items():
        if name == SPATIAL:
            continue
        if trajectory.fell:
            rows.append([name, *["falls"] * 4])
            continue
        tilt, position, yaw = trajectory.strays(trajectories[SPATIAL])
        from_contact = trajectory.strays(trajectories[CONTACT])[0]
        rows.append([name, *(number(value) for value in (tilt, position, yaw, from_contact))])
    return table(["RMS difference", "tilt (deg)", "position (mm)", "yaw (deg)", "tilt from `contact` (deg)"], rows)


def draw(fig: "Figure", trajectories: dict[str, Trajectory]) -> None:
    """A column per engine, over `spatial` in gray: tilt, ball position, and the tilt's difference from `spatial`."""
    from ballbot_rs.media.figures.panels import letter
    from ballbot_rs.media.figures.style import INK

    exact = trajectories[SPATIAL]
    others = [name for name in trajectories if name != SPATIAL]
    axes = fig.subplots(3, len(others), sharex="row", sharey="row", squeeze=False)
    pale = {"color": INK, "linewidth": 4.0, "alpha": 0.25}
    for (tilt, path, apart), name in zip(axes.T, others, strict=True):
        t, style = trajectories[name], {"color": COLORS[name], "linewidth": 1.3}
        for ax, x, y in ((tilt, exact.times, _tilt(exact)), (path, *(1e3 * exact.positions.T))):
            ax.plot(x, y, **pale)
        tilt.plot(t.times, _tilt(t), **style)
        path.plot(1e3 * t.positions[:, 0], 1e3 * t.positions[:, 1], **style)
        difference = np.degrees(np.linalg.norm(t.tilts - exact.tilts, axis=1))
        apart.semilogy(t.times[1:], np.maximum(difference[1:], 1e-13), **style)
        tilt.set_title("\n".join(name.split(", ")), fontsize="medium", pad=12)
        tilt.tick_params(labelbottom=False)
        apart.set_xlabel("time (s)")
        path.set_xlabel("ball x (mm)")
    for ax, label in zip(axes[:, 0], ("tilt (deg)", "ball y (mm)", "difference of the\ntilt (deg)"), strict=True):
        ax.set_ylabel(label)
    _limit(axes[0, 0], axes[1, 0], exact)
    letter(axes[:, 0])
    fig.align_ylabels(axes[:, 0])
    fig.legend([axes[0, 0].lines[0]], [SPATIAL], loc="outside lower center", handlelength=2.0)


def _tilt(trajectory: Trajectory) -> Array:
    """Tilts, deg."""
    return np.asarray(np.degrees(np.linalg.norm(trajectory.tilts, axis=1)))


def _limit(tilt: "Axes", path: "Axes", exact: Trajectory) -> None:
    """Limits the axes so that an engine that falls does not squeeze the others."""
    top = float(_tilt(exact).max())
    tilt.set_ylim(-0.05 * top, 1.4 * top)
    low, high = 1e3 * exact.positions.min(axis=0), 1e3 * exact.positions.max(axis=0)
    margin = 0.25 * float((high - low).max())
    path.set_xlim(low[0] - margin, high[0] + margin)
    path.set_ylim(low[1] - margin, high[1] + margin)
