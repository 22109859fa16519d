r"""A ball alone on uneven ground, its bot out of reach above it.

With $k = J_k / (M_k r_k^2)$, without slip:

- down a slope $\gamma$ its acceleration is $g \sin\gamma / (1 + k)$; with slip $g (\sin\gamma - \mu \cos\gamma)$;
- in a bowl of radius $R$ small oscillations have $\omega^2 = g / ((R - r_k)(1 + k))$;
- where the center moves on the cycloid $x = a(\theta + \sin\theta)$, $z = a(1 - \cos\theta)$, the period is
  $4\pi\sqrt{a(1 + k)/g}$ for every amplitude;
- in a gutter, a horizontal cylinder, the speed along it after an angle $\varphi$ around it is
  $v_0 \cos(\sqrt{k/(1 + k)}\ \varphi)$, whatever the gravity. Wrong frames of friction, wrong axes of spin and tangents
  along fixed axes pass on planes and fail here;
- it leaves a cylinder down which it rolls from rest at $\theta_0$ where
  $\cos\theta = 2\cos\theta_0 / (3 + k)$;
- ten meters of waves cost it nothing: the limit is a fraction of $10^{-4}$ of its speed.

The integrators are of first order, so the limits depend on the time step, 0.5 ms; the curved surfaces are splines on a
grid of 2.5 to 10 mm. [terrain.md](terrain.md) explains how robots balance on them.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MODELS = ("contact", "rigid")
_SIM_DT = 0.5e-3
#: Height at which no part of the bot comes down within the ten seconds of the longest motion.
_OUT_OF_REACH = 2000.0
_GUTTER, _BOWL, _CYCLOID, _DOME = 0.5, 1.0, 0.3, 0.5
_ALONG = 0.3


def run() -> Findings:
    """Rolls the ball on each ground."""
    claims, turns = [], {}
    for model in _MODELS:
        claims += [*_slopes(model), *_valleys(model), _lift_off(model), _waves(model)]
        turns[model], worst = _gutter(model)
        claims.append(
            Claim(f"speed along the gutter, worst of 1.5 s, `{model}`", worst, 0.0, 2e-4, "m/s", absolute=True)
        )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.panels import MODEL_LOOKS

        ax = fig.subplots()
        for model, (times, speeds, _) in turns.items():
            ax.plot(times, speeds, label=model, **MODEL_LOOKS[model])
        times, _, exact = turns["contact"]
        ax.plot(times, exact, "k:", label="closed form")
        ax.set(xlabel="time (s)", ylabel="speed along the gutter (m/s)")
        ax.legend()

    return Findings(claims, draw, size=(6.0, 3.0))


def _rough(friction: float = 1000.0) -> bb.Params:
    return bb.Params.paper().replace(floor_static_friction=friction, floor_dynamic_friction=friction)


def _ratio(params: bb.Params) -> float:
    return params.ball_inertia / (params.ball_mass * params.ball_radius**2)


def ball(
    model: str, params: bb.Params, terrain: bb.Terrain, place: tuple[float, float], velocity: tuple[float, float]
) -> bb.Ballbot:
    """A ball on a terrain at x and y that rolls with horizontal velocity components, without spin."""
    robot = bb.Ballbot(params, model=model, sim_dt=_SIM_DT, terrain=terrain)
    robot.place_on_ground(*place, tilt=(0.0, 0.0))
    center = robot.state.ball_position
    touched = center[:2]
    for _ in range(100):
        normal = terrain.normal(*touched)
        touched = center[:2] - normal[:2] * params.ball_radius
    level = np.append(velocity, 0.0)
    moving = level - np.array([0.0, 0.0, normal @ level / normal[2]])
    robot.reset(
        robot.state.replace(
            ball_velocity=moving,
            ball_angular_velocity=np.cross(normal, moving) / params.ball_radius,
            body_position=center + np.array([0.0, 0.0, _OUT_OF_REACH]),
        )
    )
    return robot


def _states(robot: bb.Ballbot, seconds: float) -> Iterator[bb.State]:
    for _ in range(round(seconds / _SIM_DT)):
        robot.step(np.zeros(3))
        yield robot.state


def _slopes(model: str) -> list[Claim]:
    slope, seconds, slippery = 0.3, 0.5, 0.05
    terrain, params = bb.Terrain.plane(slope, 0.8), _rough()
    rolled = [*_states(ball(model, params, terrain, (0.3, -0.2), (0.0, 0.0)), seconds)][-1]
    down = params.gravity * seconds
    slid = [*_states(ball(model, _rough(slippery), terrain, (0.3, -0.2), (0.0, 0.0)), seconds)][-1]
    speeds = [float(np.linalg.norm(state.ball_velocity)) for state in (rolled, slid)]
    sliding = down * (np.sin(slope) - slippery * np.cos(slope))
    return [
        Claim(f"speed down a slope, `{model}`", speeds[0], down * np.sin(slope) / (1 + _ratio(params)), 1e-9, "m/s"),
        Claim(f"speed of sliding, `{model}`", speeds[1], sliding, 1e-9, "m/s"),
    ]


def _period(robot: bb.Ballbot) -> float:
    """Period from rest, s: between the first and the third passage through the origin."""
    passages: list[float] = []
    before = robot.state.ball_position[0]
    for step, state in enumerate(_states(robot, 10.0), 1):
        x = state.ball_position[0]
        if np.sign(before) != np.sign(x):
            passages.append((step - x / (x - before)) * _SIM_DT)
            if len(passages) == 3:
                return passages[2] - passages[0]
        before = x
    return np.nan


def below_cycloid(x: Array, _: Array) -> Array:
    """Ground below the cycloid of ball centers, m."""
    a, r = _CYCLOID, bb.Params.paper().ball_radius
    angle = np.linspace(-np.pi, np.pi, 20001)
    places = a * (angle + np.sin(angle)) + r * np.sin(0.5 * angle)
    theta: Array = np.asarray(np.interp(x, places, angle))
    for _step in range(4):
        miss = a * (theta + np.sin(theta)) + r * np.sin(0.5 * theta) - x
        theta = theta - miss / (a * (1.0 + np.cos(theta)) + 0.5 * r * np.cos(0.5 * theta))
    return np.asarray(a * (1.0 - np.cos(theta)) - r * np.cos(0.5 * theta) + r)


def _valleys(model: str) -> list[Claim]:
    params = _rough()
    inertia = (1.0 + _ratio(params)) / params.gravity

    def bowl_of(x: Array, y: Array) -> Array:
        heights: Array = _BOWL - np.sqrt(_BOWL**2 - x * x - y * y)
        return heights

    bowl = bb.Terrain.from_function(bowl_of, (1.0, 1.0), 0.01)
    small = 2.0 * np.pi * np.sqrt((_BOWL - params.ball_radius) * inertia)
    claims = [
        Claim(
            f"period in a bowl, `{model}`",
            _period(ball(model, params, bowl, (0.02, 0.0), (0.0, 0.0))),
            small,
            1e-3,
            "s",
        )
    ]
    valley = bb.Terrain.from_function(below_cycloid, (1.7, 0.5), 0.01)
    exact = 4.0 * np.pi * np.sqrt(_CYCLOID * inertia)
    for amplitude in (0.1, 0.65):
        found = _period(ball(model, params, valley, (amplitude, 0.0), (0.0, 0.0)))
        claims.append(Claim(f"period in a cycloid from {amplitude} m, `{model}`", found, exact, 2e-5, "s"))
    return claims


def _gutter(model: str) -> tuple[tuple[Array, Array, Array], float]:
    params = _rough()

    def gutter(x: Array, _: Array) -> Array:
        heights: Array = _GUTTER - np.sqrt(_GUTTER**2 - x * x)
        return heights

    terrain = bb.Terrain.from_function(gutter, (0.82, 4.0), 0.005)
    states = [*_states(ball(model, params, terrain, (0.0, 0.0), (1.05, _ALONG)), 1.5)]
    angle: Array = np.arcsin(np.array([float(s.ball_position[0]) for s in states]) / (_GUTTER - params.ball_radius))
    speeds: Array = np.array([float(s.ball_velocity[1]) for s in states])
    exact: Array = _ALONG * np.cos(np.sqrt(_ratio(params) / (1.0 + _ratio(params))) * angle)
    times = np.linspace(_SIM_DT, 1.5, len(states))
    return (times, speeds, exact), float(np.abs(speeds - exact).max())


def _lift_off(model: str) -> Claim:
    params, edge, start = _rough(), 1.03, 0.1

    def dome(x: Array, _: Array) -> Array:
        beyond = np.maximum(np.abs(x) - _DOME * np.sin(edge), 0.0)
        heights: Array = np.sqrt(_DOME**2 - (np.abs(x) - beyond) ** 2) - _DOME - beyond * np.tan(edge)
        return heights

    terrain = bb.Terrain.from_function(dome, (1.2, 0.05), 0.0025)
    radius = _DOME + params.ball_radius
    robot = ball(model, params, terrain, (radius * np.sin(start), 0.0), (0.0, 0.0))
    robot.step(np.zeros(3), 5)
    flying = (state for state in _states(robot, 5.0) if not robot.contacts.floor_force.any())
    found = float(np.degrees(np.arcsin(next(flying).ball_position[0] / radius)))
    exact = float(np.degrees(np.arccos(2.0 * np.cos(start) / (3.0 + _ratio(params)))))
    return Claim(f"angle of lift-off from a cylinder, `{model}`", found, exact, 0.2, "deg", absolute=True)


def _waves(model: str) -> Claim:
    params = _rough()
    terrain = bb.Terrain.generate("wave", slope=0.15, size_x=14.0, size_y=1.0)
    robot = ball(model, params, terrain, (-5.0, 0.0), (1.5, 0.0))
    first = robot.state
    state = next(state for state in _states(robot, 20.0) if state.ball_position[0] > 5.0)
    risen = 2.0 * params.gravity * (state.ball_position[2] - first.ball_position[2]) / (1.0 + _ratio(params))
    found = float(np.sqrt(state.ball_velocity @ state.ball_velocity + risen))
    return Claim(
        f"speed after 10 m of waves, `{model}`", found, float(np.linalg.norm(first.ball_velocity)), 1e-4, "m/s"
    )
