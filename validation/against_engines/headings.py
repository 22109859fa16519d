r"""Where engines differ, the closed form decides.

Four experiments whose outcome is known, at many headings, since no direction of the floor is special:

- a tilt of $10^{-4}$ rad grows at the pole of the linearized robot, $\lambda = 6.09174451\ \mathrm{s}^{-1}$; other
  engines with contacts start at $10^{-3}$ rad, where the noise of these matters less, and nonlinearity
  $5\cdot 10^{-5}$;
- each wheel of the robot at rest carries $M_b g/(3\cos\alpha)$;
- a wheel driven far beyond its grip pushes with $\mu M_b g/(3\cos\alpha)$, as the load of three wheels that turn the
  robot on the spot equals the load at rest;
- in a fall without torque, from 1 deg and 0.6 s long, no energy is lost. Its change is a fraction of the kinetic energy
  at the end; one formula computes the energy of every engine's state. What its weight loses as it sinks into soft
  contacts (in `rigid` 15.8 µm, $5.7\cdot 10^{-4}$ J, half as much as the step's own error) is taken off.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array, robot_geometry
from validation.against_engines.engine_list import (
    BULLET,
    COLORS,
    CONTACT,
    DASHES,
    RIGID,
    ROLLING,
    SIM_DT,
    SPATIAL,
    STOCK,
    TURNED,
    Engine,
    absent,
    engines,
)
from validation.claim import Claim
from validation.engines import probes
from validation.engines.any_robot import AnyRobot
from validation.engines.our_robot import OurRobot
from validation.engines.rotations import matrix
from validation.mechanics import unstable_pole
from validation.page import table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Result = TypeVar("Result")

_HEADINGS, _AZIMUTHS = 24, 4
#: The callback of the robot without slip is slow.
_FEWER = {ROLLING: (6, 2)}
_TILT = 1e-4
_LARGER = {TURNED: 1e-3, STOCK: 1e-3, BULLET: 1e-3}
_FALL, _FALL_SECONDS = np.radians(1.0), 0.6
#: Allowed relative deviation from 2 of the ratio of energy errors at a step and at half of it.
_HALVES = {CONTACT: 5e-3, RIGID: 5e-3}
#: Limits of growth rate, load, grip and energy, relative.
_LIMITS = {
    SPATIAL: (1e-6, 1e-14, None, 3e-11),
    ROLLING: (1e-6, 3e-14, None, 3e-11),
    CONTACT: (1e-5, 1e-14, 3e-13, None),
    RIGID: (3e-5, 3e-7, 1e-3, None),
}


class Measured:
    """One engine's results: each is its ratio to the closed form, minus one."""

    def __init__(self, engine: Engine, params: bb.Params, pole: float) -> None:
        model = robot_geometry(params)
        headings, azimuths = _FEWER.get(engine.name, (_HEADINGS, _AZIMUTHS))
        self.yaws = np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False)
        tilt = _LARGER.get(engine.name, _TILT)
        # Off the axes, where symmetry might hide an error.
        towards = 0.2 + 2.0 * np.pi * np.arange(azimuths) / azimuths

        def fresh(probe: Callable[[AnyRobot], Result]) -> Result:
            # Bullet's contacts keep memory across a reset.
            robot = engine.make(params)
            try:
                return probe(robot)
            finally:
                robot.close()

        def growth(yaw: float, azimuth: float) -> float:
            return fresh(lambda robot: probes.growth(robot, params, yaw, azimuth, tilt))

        def grip(yaw: float) -> float:
            return fresh(lambda robot: probes.slip_limit(robot, model, yaw))

        self.growth = np.array([[growth(yaw, azimuth) for azimuth in towards] for yaw in self.yaws]) / pole - 1.0
        self.load = fresh(lambda robot: probes.wheel_loads(robot, params)) / probes.resting_load(params) - 1.0
        self.grip: Array | None = None
        if engine.name not in (SPATIAL, ROLLING):
            grips = [grip(yaw) for yaw in self.yaws]
            self.grip = np.array(grips) - 1.0
        self.energy = fresh(lambda robot: _energy_drift(robot, params))


def run() -> Findings:
    """Measures every engine."""
    params, found = bb.Params.paper(), engines()
    pole = unstable_pole(params)
    measured = {e.name: Measured(e, params, pole) for e in found if not e.reason}
    claims, rows = [], []
    for name, m in measured.items():
        outcomes = (m.growth, m.load, m.grip, np.array(m.energy))
        for what, values, limit in zip(_WHAT, outcomes, _LIMITS.get(name, (None,) * 4), strict=True):
            if limit is not None and values is not None:
                claims.append(Claim(f"{name}: {what}", float(np.abs(values).max()), 0.0, limit, absolute=True))
        rows.append([name, *("no slip" if values is None else _span(values) for values in outcomes)])
    for name in (CONTACT, RIGID):
        halved = _energy_drift(OurRobot(name, params, 0.5 * SIM_DT), params)
        ratio = measured[name].energy / halved
        claims.append(Claim(f"{name}: energy error over that with half the step", ratio, 2.0, _HALVES[name]))
    head = ["relative error against the closed form", "growth rate", "load at rest", "limit of grip", "energy"]

    def draw(fig: "Figure") -> None:
        left, right = fig.subplots(1, 2)
        for name, m in measured.items():
            line = {"color": COLORS[name], "linestyle": DASHES.get(name, "-"), "label": name}
            yaws = np.degrees(np.append(m.yaws, 2.0 * np.pi))
            left.semilogy(yaws, _closed(np.maximum(np.abs(m.growth).max(axis=1), 1e-9)), **line)
            if m.grip is not None:
                right.plot(yaws, _closed(1.0 + m.grip), **line)
        left.set(xlabel="yaw (deg)", ylabel="largest relative error of the growth rate")
        right.set(xlabel="yaw (deg)", ylabel="limit of grip over μN")
        for axes in (left, right):
            axes.set_xticks(range(0, 361, 60))
        handles, labels = left.get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=4)

    return Findings(claims, draw, f"{table(head, rows)}\n\n{_explain(measured)}", (8.5, 3.8), missing=absent(found))


_WHAT = ("growth rate, any heading", "load at rest", "limit of grip, any heading", "energy in a fall")


def _closed(values: Array) -> Array:
    return np.append(values, values[0])


def _span(values: Array) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:+.1e}" if high - low < 1e-3 * abs(low) else f"{low:+.1e} … {high:+.1e}"


def _explain(measured: dict[str, Measured]) -> str:
    sentences = []
    if STOCK in measured:
        sentences.append(
            "Stock MuJoCo lays a contact's friction directions by the world's axes: as the robot turns, its wheels "
            "hold where they should roll. Turned to the wheels, the growth rate is right at every heading; the grip is "
            "not, as the load of MuJoCo's convex contacts rises with the slip until the wheels hop. `impratio` does "
            "not help there, and `noslip_iterations` spoil the growth rate."
        )
    if BULLET in measured:
        sentences.append(
            "Bullet splits a wheel's friction over two rows, both along its drive, each with a separate limit, so "
            "that the grip varies with the heading."
        )
    sentences.append(
        r"All engines that step by semi-implicit Euler have the same energy error: their positions are half a step "
        r"$h$ ahead of their velocities, which is about $\lambda h = 0.006$ of the kinetic energy in a fall. For "
        r"`contact` and `rigid` a claim tests that half the step halves it; the other engines are not tested for this."
    )
    return " ".join(sentences)


def energy(params: bb.Params, state: bb.State) -> tuple[float, float]:
    """Kinetic and potential energy, J, of any state, slip or not."""
    turn, rate = matrix(state.body_quaternion), state.body_angular_velocity
    com = np.array([0.0, 0.0, params.body_com_height])
    velocity = state.body_velocity + turn @ np.cross(rate, com)
    spins = state.wheel_speeds + robot_geometry(params).axles @ rate
    kinetic = 0.5 * (
        params.ball_mass * state.ball_velocity @ state.ball_velocity
        + params.ball_inertia * state.ball_angular_velocity @ state.ball_angular_velocity
        + params.body_mass * velocity @ velocity
        + rate @ (np.array(params.body_inertia) * rate)
        + params.wheel_inertia * spins @ spins
    )
    height = (state.body_position + turn @ com)[2]
    potential = params.gravity * (params.ball_mass * state.ball_position[2] + params.body_mass * height)
    return float(kinetic), float(potential)


def _energy_drift(robot: AnyRobot, params: bb.Params) -> float:
    robot.reset(bb.State.at_rest(params, _FALL * np.array([np.cos(0.7), np.sin(0.7)]), 0.5))
    before = sum(energy(params, robot.state()))
    probes.advance(robot, np.zeros(3), _FALL_SECONDS)
    state = robot.state()
    kinetic, potential = energy(params, state)
    depths = params.ball_radius - np.array([state.ball_position[2], state.body_position[2]])
    sunk = float(params.gravity * np.array([params.ball_mass, params.body_mass]) @ depths)
    return (kinetic + potential + sunk - before) / kinetic
