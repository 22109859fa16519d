r"""Section II-A: the recipe for equations of motion, off the plane.

Eq. (1) is derived by writing the Lagrangian with the wheels' spin put in terms of the other coordinates,
$\dot\psi(q, \dot q)$, and applying Euler and Lagrange to it. In a plane that is right. For the 3D model that Section
II-A describes, and recommends for fast manoeuvres, the same recipe is wrong:
$\dot\psi = (r_k/r_w)\ u\cdot(R^T\omega_k - \Omega)$ is not the rate of any function of $q$ once the body turns out of
a plane, and a nonholonomic constraint must not be put into the Lagrangian before the variation. Here the recipe is
carried out numerically: $L$ from the energy of `SpatialModel`, whose wheels obey the constraint, its derivatives by
differences of fourth order. `SpatialModel.accelerations` is Kane's method, which needs no such step.

What the recipe adds to Kane's equations has a formula ([derivations](derivations.md)): with $w = R^T\omega_k$ and
$\Lambda = U^T\sigma$, the wheels' spins $\sigma$, the generalized force

$$\Delta = k J_w\bigl(S^T R(\Omega\times\Lambda) + S_\Omega^T((w - \Omega)\times\Lambda)\bigr),$$

which is compared here with the difference of both, mass matrix times difference of the accelerations, at random
states.

In a plane both agree to rounding; without wheel inertia they do everywhere, so that nothing but the wheels'
constraint distinguishes them. Off the plane they differ, here by up to 2 % of the acceleration, and energy does not
show it: both conserve it. The simulation `contact`, which uses neither (it has free bodies and contact forces),
follows Kane's equations, the closer the smaller its step. The figure: left, the difference over how far the motion is
from planar, for the wheel energy of the paper and of absolute spins; right, the distance of the ball in each from its
place in `contact` with steps of 0.1 ms, of a robot that falls while it turns.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.engines.rotations import matrix
from validation.mechanics import Array, wheel_directions
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: x, y, three angles, the ball's angle about the vertical; where the angles are.
_N, _ANGLES = 6, slice(2, 5)
_H = 1e-3
#: Four differences over this step are exact to fourth order.
_STENCIL = ((-2, 1.0 / 12.0), (-1, -8.0 / 12.0), (1, 8.0 / 12.0), (2, -1.0 / 12.0))
_DT, _SECONDS = 2e-3, 0.2
_STATES = 20
#: By whether they are absolute.
_SPINS = {False: "relative", True: "absolute"}

#: A fall that turns: coordinates and their rates.
_START = np.array([0.0, 0.0, 0.08, -0.06, 0.3, 0.0])
_START_RATES = np.array([0.1, -0.2, 0.3, 0.5, 4.0, 1.0])

Acceleration = Callable[[Array, Array, Array], Array]


def run() -> Findings:
    """Accelerations in and off the plane, and a fall."""
    params = bb.Params.paper()
    torques = np.array([0.2, -0.1, -0.1])
    in_plane, off_plane = motion(0.0), motion(1.0)
    massless = params.replace(wheel_inertia=1e-12)
    claims = [
        _no_difference("in the yz-plane", difference(params, *in_plane, torques, absolute=False)),
        _no_difference("in the yz-plane, absolute spins", difference(params, *in_plane, torques, absolute=True)),
        _no_difference("off the plane, no wheel inertia", difference(massless, *off_plane, torques, absolute=False)),
    ]
    for absolute in (False, True):
        worst = max(formula_error(params, *state, absolute) for state in random_states(_STATES))
        what = f"recipe − Kane against the formula, {_STATES} random states, {_SPINS[absolute]} spins"
        claims.append(Claim(what, worst, 0.0, 1e-8, "", absolute=True))
    weights = [share_of_quadratic(params, *off_plane, absolute) for absolute in (False, True)]
    shares = np.linspace(0.0, 1.0, 21)
    apart = {
        absolute: np.array([difference(params, *motion(s), torques, absolute) for s in shares])
        for absolute in (False, True)
    }

    paths, drifts = {}, {}
    for name, absolute in (("relative", False), ("absolute", True)):
        model = bb.SpatialModel(params, absolute, ball_spins_about_vertical=True)
        for method, law in (("Kane", kane(model)), ("recipe", recipe(model))):
            path = integrate(law)
            energies = [model.energy(quaternion(q), velocity(q, rates)) for q, rates in (path[0], path[-1])]
            paths[method, name], drifts[method, name] = path, abs(energies[1] / energies[0] - 1.0)
    for (method, name), drift in drifts.items():
        what = f"drift of the energy in the fall, {method}, {name} spins"
        claims.append(Claim(what, drift, 0.0, 1e-10, "", absolute=True))
    times = np.arange(len(paths["Kane", "absolute"])) * _DT
    away = {
        (method, dt): np.linalg.norm(simulated(params, dt) - _balls(paths[method, "absolute"]), axis=1)
        for method in ("Kane", "recipe")
        for dt in (1e-4, 2e-5)
    }
    scale = 1e-3
    claims.append(
        Claim(
            "ball in `contact` (0.02 ms) from Kane's after the fall",
            away["Kane", 2e-5][-1] / scale,
            0.0,
            0.005,
            "mm",
            True,
        )
    )
    ends = [float(values[-1]) / scale for values in away.values()]
    text = (
        f"After {_SECONDS} s the ball in `contact` is {1e3 * ends[0]:.1f} µm from Kane's at steps of 0.1 ms "
        f"and {1e3 * ends[1]:.1f} µm at 0.02 ms; "
        f"from the recipe's it is {1e3 * ends[2]:.0f} µm and {1e3 * ends[3]:.0f} µm. At the right end of the left "
        f"figure the term of the formula changes the accelerations by {1e2 * weights[0]:.0f} % (relative spins) or "
        f"{1e2 * weights[1]:.0f} % (absolute) of the contribution of all terms quadratic in the rates."
    )
    drawing = Comparison(
        "planes, angles and wheels of the models",
        "Section II-A, Fig. 1",
        "a drawing",
        "the frames and signs of [conventions](conventions.md)",
        "not comparable: the text prints no number of it",
    )
    compared = Comparison(
        "equations of the 3D model by Euler-Lagrange",
        "Section II-A",
        "planar model derived so; the 3D model described",
        f"right in a plane; off it accelerations differ by {1e2 * apart[False][-1]:.1f} % (in our example)",
        "the wheels' constraint is nonholonomic; energy is conserved all the same",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS, INK

        left, right = fig.subplots(1, 2)
        for values, name, color in zip(apart.values(), ("relative", "absolute"), COLORS, strict=False):
            left.plot(shares, 1e2 * values, color=color, label=f"{name} wheel spin")
        left.set(xlabel="fraction of the motion off the plane", ylabel="recipe − Kane, % of the acceleration")
        left.legend()
        for method, color in (("recipe", COLORS[1]), ("Kane", INK)):
            right.semilogy(times[1:], 1e6 * away[method, 1e-4][1:], color=color, label=f"{method} from contact")
        right.set(xlabel="time (s)", ylabel="distance of the ball (µm)")
        right.legend()

    return Findings(claims, draw, text, compared=(drawing, compared))


def _no_difference(where: str, found: float) -> Claim:
    return Claim(f"recipe and Kane, {where}", found, 0.0, 1e-9, "", absolute=True)


def motion(share: float) -> tuple[Array, Array]:
    """Coordinates and rates of a motion with a fraction out of the yz-plane."""
    q = np.array([0.0, 0.0, -0.3, 0.2 * share, 0.0, 0.0])
    return q, np.array([0.3 * share, 0.4, 0.9, 0.4 * share, share, 0.5 * share])


def quaternion(q: Array) -> Array:
    """Attitude of the body: rotated about z, then y, then x by the angles of `q`."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(0.5 * q[_ANGLES]), np.sin(0.5 * q[_ANGLES])
    return np.array(
        [
            cx * cy * cz + sx * sy * sz,
            sx * cy * cz - cx * sy * sz,
            cx * sy * cz + sx * cy * sz,
            cx * cy * sz - sx * sy * cz,
        ]
    )


def kinematics(q: Array) -> Array:
    """The matrix that maps rates of `q` to the generalized velocity."""
    (cx, cy), (sx, sy) = np.cos(q[2:4]), np.sin(q[2:4])
    rates = np.eye(_N)
    rates[_ANGLES, _ANGLES] = [[1.0, 0.0, -sy], [0.0, cx, cy * sx], [0.0, -sx, cy * cx]]
    return rates


def velocity(q: Array, rates: Array) -> Array:
    """The generalized velocity of `SpatialModel`."""
    product: Array = kinematics(q) @ rates
    return product


def _turned(q: Array, angle: int, steps: int) -> Array:
    moved: Array = q.copy()
    moved[2 + angle] += steps * _H
    return moved


def _quadratic(model: bb.SpatialModel, attitude: Array, units: Array) -> tuple[Array, float]:
    """Mass matrix of speeds along `units` (rows), potential energy; the kinetic energy of sums of units gives it."""
    potential = model.energy(attitude, np.zeros(_N))
    own = [model.energy(attitude, unit) - potential for unit in units]
    mass = np.diag(2.0 * np.array(own))
    for i in range(_N):
        for j in range(i):
            mass[i, j] = model.energy(attitude, units[i] + units[j]) - potential - own[i] - own[j]
            mass[j, i] = mass[i, j]
    return mass, potential


def recipe(model: bb.SpatialModel) -> Acceleration:
    """q̈ by d/dt ∂L/∂q̇ − ∂L/∂q = Q with the constraint substituted into L."""

    def energies(q: Array) -> tuple[Array, float]:
        """Mass matrix in `q` and potential energy."""
        return _quadratic(model, quaternion(q), kinematics(q).T)

    def acceleration(q: Array, rates: Array, torques: Array) -> Array:
        mass_slopes, potential_slopes = np.zeros((_N, _N, _N)), np.zeros(_N)
        for angle in range(3):
            for steps, weight in _STENCIL:
                mass, potential = energies(_turned(q, angle, steps))
                mass_slopes[2 + angle] += weight / _H * mass
                potential_slopes[2 + angle] += weight / _H * potential
        mass, _ = energies(q)
        attitude = quaternion(q)
        encoders = np.array([model.wheel_speeds(attitude, unit) for unit in kinematics(q).T])
        forces = encoders @ torques - potential_slopes
        forces += 0.5 * np.einsum("kij,i,j", mass_slopes, rates, rates)
        forces -= np.tensordot(rates, mass_slopes, 1) @ rates
        return np.asarray(np.linalg.solve(mass, forces), dtype=np.float64)

    return acceleration


def kane(model: bb.SpatialModel) -> Acceleration:
    """q̈ of `SpatialModel.accelerations`."""

    def acceleration(q: Array, rates: Array, torques: Array) -> Array:
        found = model.accelerations(quaternion(q), velocity(q, rates), torques)
        solved = np.linalg.solve(kinematics(q), found - _kinematics_rate(q, rates) @ rates)
        return np.asarray(solved, dtype=np.float64)

    return acceleration


def _kinematics_rate(q: Array, rates: Array) -> Array:
    total = np.zeros((_N, _N))
    for angle in range(3):
        for steps, weight in _STENCIL:
            total += rates[2 + angle] * weight / _H * kinematics(_turned(q, angle, steps))
    return total


def difference(params: bb.Params, q: Array, rates: Array, torques: Array, absolute: bool) -> float:
    """Difference between the two accelerations, relative to the larger."""
    model = bb.SpatialModel(params, absolute, ball_spins_about_vertical=True)
    a, b = kane(model)(q, rates, torques), recipe(model)(q, rates, torques)
    return float(np.linalg.norm(a - b) / np.linalg.norm(a))


def random_states(count: int) -> list[tuple[Array, Array]]:
    """Coordinates and rates: tilts up to 0.5 rad, rates of some rad/s."""
    rng = np.random.default_rng(0)
    spread = np.array([0.0, 0.0, 0.5, 0.5, 3.0, 0.0])
    return [(spread * rng.uniform(-1.0, 1.0, _N), rng.normal(size=_N)) for _ in range(count)]


def formula(params: bb.Params, q: Array, rates: Array, absolute: bool) -> Array:
    """The recipe's excess over Kane's inertia forces, from the conventions."""
    p, nu, turn, directions = params, velocity(q, rates), matrix(quaternion(q)), wheel_directions(params)
    ratio, rate = p.ball_radius / p.wheel_radius, nu[_ANGLES]
    rolling = np.zeros((3, _N))
    rolling[0, 1], rolling[1, 0], rolling[2, 5] = -1.0 / p.ball_radius, 1.0 / p.ball_radius, 1.0
    ball = turn.T @ rolling @ nu
    spins = ratio * directions @ (ball - rate) - float(absolute) * directions @ rate
    about = directions.T @ spins
    added: Array = rolling.T @ turn @ np.cross(rate, about)
    added[_ANGLES] += np.cross(ball - rate, about)
    return ratio * p.wheel_inertia * added


def mass_matrix(model: bb.SpatialModel, q: Array) -> Array:
    """Mass matrix of the generalized velocity, from sums of unit velocities: the kinetic energy is quadratic."""
    return _quadratic(model, quaternion(q), np.eye(_N))[0]


def formula_error(params: bb.Params, q: Array, rates: Array, absolute: bool) -> float:
    """Error of the formula against the difference of recipe and Kane, relative to the larger."""
    model, idle = bb.SpatialModel(params, absolute, ball_spins_about_vertical=True), np.zeros(3)
    apart = kane(model)(q, rates, idle) - recipe(model)(q, rates, idle)
    found, expected = mass_matrix(model, q) @ kinematics(q) @ apart, formula(params, q, rates, absolute)
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def share_of_quadratic(params: bb.Params, q: Array, rates: Array, absolute: bool) -> float:
    """Ratio of accelerations by the formula's term to those by all terms quadratic in the rates."""
    model, idle = bb.SpatialModel(params, absolute, ball_spins_about_vertical=True), np.zeros(3)
    attitude = quaternion(q)
    moving = model.accelerations(attitude, velocity(q, rates), idle) - model.accelerations(attitude, np.zeros(_N), idle)
    added = np.linalg.solve(mass_matrix(model, q), formula(params, q, rates, absolute))
    return float(np.linalg.norm(added) / np.linalg.norm(moving))


def integrate(law: Acceleration) -> list[tuple[Array, Array]]:
    """The fall, by RK4."""
    idle = np.zeros(3)

    def rate(y: Array) -> Array:
        return np.concatenate([y[_N:], law(y[:_N], y[_N:], idle)])

    y = np.concatenate([_START, _START_RATES])
    path = [(y[:_N], y[_N:])]
    for _ in range(round(_SECONDS / _DT)):
        a = rate(y)
        b = rate(y + 0.5 * _DT * a)
        c = rate(y + 0.5 * _DT * b)
        d = rate(y + _DT * c)
        y = y + _DT / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        path.append((y[:_N], y[_N:]))
    return path


def _balls(path: list[tuple[Array, Array]]) -> Array:
    return np.array([q[:2] for q, _ in path])


def simulated(params: bb.Params, sim_dt: float) -> Array:
    """The ball of the same fall in `contact`."""
    robot = bb.Ballbot(params, model="contact", sim_dt=sim_dt)
    start = velocity(_START, _START_RATES)
    robot.reset(bb.State.rolling(params, start[:2], quaternion(_START), start[_ANGLES], float(start[5])))
    rows = [robot.state.ball_position[:2]]
    for _ in range(round(_SECONDS / _DT)):
        robot.step(np.zeros(3), steps=round(_DT / sim_dt))
        rows.append(robot.state.ball_position[:2])
    return np.array(rows)
