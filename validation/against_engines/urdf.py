r"""The same robot from the same file.

`assets/bot.urdf` is loaded, as it is, by Pinocchio, MuJoCo and PyBullet. Each engine's links, joints and joint-space
mass matrix are turned into the body frame (origin at the ball's center, $z$ along the mast) and compared with Table II:
mass $M_b$, center of mass at $l$, and with the wheels locked the inertia
$I = \operatorname{diag}(J_b, J_b, J_z) + J_w\sum_i a_i a_i^\top$ about it, where the axles are $a_i = -p_i\times d_i$.
The bot floats free; with $c = l e_z$, $A = (a_1\ a_2\ a_3)$ and velocities $(v, \Omega, \dot\psi)$ in the body frame
its mass matrix is

$$M = \begin{pmatrix} M_b & -M_b[c]_\times & 0\cr M_b[c]_\times & I - M_b[c]_\times^2 & J_w A\cr
0 & J_w A^\top & J_w\end{pmatrix},$$

and it falls by Euler's equations of a gyrostat,
$I\dot\Omega + J_wA\ddot\psi + \Omega\times(I\Omega + J_wA\dot\psi) = 0$ and
$J_w(\ddot\psi + A^\top\dot\Omega) = \tau$. Both are evaluated at random attitudes, rates, wheel angles and torques.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array, robot_geometry
from validation.against_engines import urdf_readers
from validation.against_engines.urdf_readers import FreeState, Read
from validation.claim import Claim
from validation.engines.installed import missing
from validation.engines.rotations import matrix
from validation.page import table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_READERS = {
    "Pinocchio": ("pinocchio", urdf_readers.pinocchio),
    "MuJoCo": ("mujoco", urdf_readers.mujoco),
    "PyBullet": ("pybullet", urdf_readers.pybullet),
}
_TOLD = (
    "Two engines need options to read the file. PyBullet by default recomputes the inertias from the "
    "collision shapes. MuJoCo by default welds a URDF's first link to the world and drops its mass (`fusestatic`); "
    "here it is given a free joint through `MjSpec` with `fusestatic` off, and the file is not changed. All three "
    "keep double precision."
)
_STATES = 20
_LIMIT = 5e-14
_NAMES = ("$v_x$", "$v_y$", "$v_z$", r"$\Omega_x$", r"$\Omega_y$", r"$\Omega_z$", r"$\psi_0$", r"$\psi_1$", r"$\psi_2$")


def run() -> Findings:
    """Loads the file everywhere."""
    params = bb.Params.paper()
    rng = np.random.default_rng(0)
    states = [random_state(rng) for _ in range(_STATES)]
    expected = free_mass_matrix(params)
    claims, rows, matrices, absent = [], [_row("Table II", *_composite(params))], {}, []
    for engine, (package, read) in _READERS.items():
        if reason := missing(package):
            absent.append(f"{engine} is {reason}")
            continue
        bot = read()
        claims += _claims(engine, bot, params, states)
        matrices[engine] = bot.mass_matrix(states[0])
        rows.append(_row(engine, *bot.composite()))
    if "PyBullet" in matrices:
        rows.append(_row("PyBullet without `URDF_USE_INERTIA_FROM_FILE`", *urdf_readers.pybullet(False).composite()))
    head = ["read from the URDF", "mass (kg)", "CoM height (m)", "I_xx (kg·m²)", "I_yy", "I_zz"]
    notes = [table(head, rows)]
    if len(matrices) == len(_READERS):
        notes.append(_TOLD)

    def draw(fig: "Figure") -> None:
        left, right = fig.subplots(1, 2, width_ratios=[1.0, 1.35])
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        shown = expected / scale
        image = left.imshow(np.where(shown == 0.0, np.nan, shown), cmap="PuOr", vmin=-1.0, vmax=1.0)
        left.set_xticks(range(9), _NAMES)
        left.set_yticks(range(9), _NAMES)
        left.grid(False)
        left.set_title(r"$M_{ij}\ (M_{ii}M_{jj})^{-1/2}$ by the formula")
        fig.colorbar(image, ax=left, shrink=0.8)
        for (engine, found), marker in zip(matrices.items(), "osx", strict=False):
            error = np.abs((found - expected) / scale).ravel()
            # An exact zero does not fit on this axis.
            right.semilogy(np.where(error > 0.0, error, np.nan), marker, markersize=4, fillstyle="none", label=engine)
        right.axhline(np.finfo(float).eps, color="#868e96", linewidth=1, linestyle="--")
        right.set(xlabel="entry of $M$, row by row", ylabel="difference, same scale", ylim=(1e-20, 1e-13))
        if matrices:
            right.legend(ncols=3, loc="upper center")

    return Findings(claims, draw, "\n\n".join(notes), missing=tuple(absent))


def _claims(engine: str, bot: Read, params: bb.Params, states: list[FreeState]) -> list[Claim]:
    mass, com, inertia = bot.composite()
    expected_mass, expected_com, expected_inertia = _composite(params)
    robot, expected = robot_geometry(params), free_mass_matrix(params)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    largest = {
        "links: mass, CoM, inertia": max(
            abs(mass / expected_mass - 1.0),
            np.abs(com - expected_com).max() / expected_com[2],
            np.abs(inertia - expected_inertia).max() / np.abs(expected_inertia).max(),
            np.abs(bot.masses[1:] / params.wheel_mass - 1.0).max(),
        ),
        "joints: axes and centers": max(
            np.abs(bot.axes - robot.axles).max(), np.abs(bot.centers - robot.centers).max()
        ),
        "mass matrix": max(np.abs((bot.mass_matrix(state) - expected) / scale).max() for state in states),
    }
    if bot.acceleration is not None:
        found = np.array([bot.acceleration(state) for state in states]).reshape(-1, 3, 3)
        right = np.array([free_acceleration(params, state) for state in states]).reshape(-1, 3, 3)
        # Origin, rate and wheels, each relative to its size.
        largest["free-flight accelerations"] = (np.abs(found - right).max(axis=2) / np.abs(right).max(axis=2)).max()
    return [
        Claim(f"{engine}, {what}: largest difference", float(value), 0.0, _LIMIT, absolute=True)
        for what, value in largest.items()
    ]


def _row(name: str, mass: float, com: Array, inertia: Array) -> list[str]:
    return [name, *(f"{value:.8g}" for value in (mass, com[2], *np.diag(inertia)))]


def _composite(params: bb.Params) -> tuple[float, Array, Array]:
    """Mass, center of mass and inertia about it, wheels locked, by Table II."""
    axles = robot_geometry(params).axles
    com = np.array([0.0, 0.0, params.body_com_height])
    return params.body_mass, com, np.diag(params.body_inertia) + params.wheel_inertia * axles.T @ axles


def free_mass_matrix(params: bb.Params) -> Array:
    """The 9×9 matrix of the text."""
    mass, com, inertia = _composite(params)
    axles = robot_geometry(params).axles
    # Row j of cross(1, c) is e_j × c: its transpose maps Ω to Ω × c.
    turn = np.cross(np.eye(3), com).T
    m = np.zeros((9, 9))
    m[:3, :3], m[:3, 3:6], m[3:6, :3] = mass * np.eye(3), mass * turn, mass * turn.T
    m[3:6, 3:6] = inertia + mass * turn.T @ turn
    m[3:6, 6:], m[6:, 3:6] = params.wheel_inertia * axles.T, params.wheel_inertia * axles
    m[6:, 6:] = params.wheel_inertia * np.eye(3)
    return m


def free_acceleration(params: bb.Params, s: FreeState) -> Array:
    """Accelerations of the origin (inertial), the rate (body) and the wheel speeds of the gyrostat in free fall."""
    _, com, inertia = _composite(params)
    axles, turn = robot_geometry(params).axles, matrix(s.quaternion)
    momentum = inertia @ s.rate + params.wheel_inertia * axles.T @ s.wheel_speeds
    without_wheels = inertia - params.wheel_inertia * axles.T @ axles
    rate = np.linalg.solve(without_wheels, -axles.T @ s.torques - np.cross(s.rate, momentum))
    about = np.cross(rate, com) + np.cross(s.rate, np.cross(s.rate, com))
    origin = np.array([0.0, 0.0, -params.gravity]) - turn @ about
    return np.concatenate([origin, rate, s.torques / params.wheel_inertia - axles @ rate])


def random_state(rng: np.random.Generator) -> FreeState:
    """Any attitude, rates of some rad/s, fast wheels."""
    quaternion = rng.normal(size=4)
    velocity, rate, angles, torques = rng.normal(size=(4, 3))
    return FreeState(
        quaternion / np.linalg.norm(quaternion), velocity, 3.0 * rate, 50.0 * rng.normal(size=3), angles, torques
    )
