r"""Table III: contacts and friction.

**Friction** has the same parameters in both simulators: static and dynamic coefficient and a critical velocity, and
ours have the printed values. The law is Stribeck's, $\mu(v) = \mu_d + (\mu_s - \mu_d)\ e^{-(v/v_c)^2}$. The figure
has what the contacts really do: friction over load, step by step, of wheels that break loose under 0.75 N·m each, and
of a ball that slides on the floor at 0.6 m/s under wheels without friction, at steps of 0.5 ms. At
rest the laws differ: Simscape's is smooth through zero slip ("smooth stick-slip"), so its contacts creep under any
tangential force; ours hold up to $\mu_s N$.

**Stiffness and damping** have no counterpart here. Simscape's block is a penalty method: the normal force is
$s(d)\ (k\ d + c\ \dot d)$ at a depth $d$, where $s$ rises from 0 to 1 over the transition region
([reference](https://www.mathworks.com/help/sm/ref/spatialcontactforce.html)). Our contacts are rigid: a row of the
solver forbids approach, and overlap that is there all the same is removed at a stated rate: in `contact` 100 1/s (at
most a fifth of it a step), in `rigid` at the rate of a spring of 200 Hz and damping ratio 5, 112 1/s at 1 kHz. The
table has what the printed numbers would do under the static loads, and what ours do. With $c = 10^8$ N/(m/s) on
$k = 10^6$ N/m, the printed wheel contact has a time constant $c/k$ of 100 s: within any run of the paper it is a
dashpot that yields 0.1 µm a second and hardly springs at all, nearer to a rigid contact than to a spring. The floor's,
0.1 s and 0.9 mm, is soft.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from validation.claim import Claim
from validation.engines import probes
from validation.mechanics import Array
from validation.page import table
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STIFFNESS = {"wheel on ball": 1e6, "ball on floor": 4e4}
DAMPING = {"wheel on ball": 1e8, "ball on floor": 4e3}
#: Static and dynamic coefficient.
FRICTION = {"wheel on ball": (1.1, 1.0), "ball on floor": (1.1, 1.05)}
CRITICAL_VELOCITY = 0.1

_SIM_DT = 5e-4
_BREAK_LOOSE = 0.75
_FASTEST = 0.6
#: Slip speed below which a step may hold a contact that slipped in the step before.
_SLIPS = 0.003
#: Limits of the largest and median error of a friction coefficient.
_LIMITS = {
    ("wheel on ball", "contact"): (5e-9, 1e-11),
    ("wheel on ball", "rigid"): (5e-9, 1e-11),
    ("ball on floor", "contact"): (1e-14, 1e-14),
    ("ball on floor", "rigid"): (5e-6, 1e-14),
}


class Curve(NamedTuple):
    """Friction over load against the slip speed at the start of the step."""

    speeds: Array
    coefficients: Array


def run() -> Findings:
    """Measures both contacts in both simulations."""
    params = bb.Params.paper()
    curves = {
        (contact, model): slide(params, model)
        for model in ("contact", "rigid")
        for contact, slide in (("wheel on ball", wheel_friction), ("ball on floor", floor_friction))
    }
    claims: list[Claim] = []
    for key, (largest, median) in _LIMITS.items():
        contact, model = key
        error = np.abs(curves[key].coefficients - stribeck(contact, curves[key].speeds))
        what = f"friction coefficient of {contact}, `{model}`, error"
        claims.append(Claim(f"{what}, largest", float(error.max()), 0.0, largest, absolute=True))
        claims.append(Claim(f"{what}, median", float(np.median(error)), 0.0, median, absolute=True))

    frequency, ratio = 2.0 * np.pi * 200.0, 5.0
    for model, rate in (("contact", 100.0), ("rigid", frequency / (frequency * 1e-3 + 2.0 * ratio))):
        found = recovery_rate(params, model)
        claims.append(Claim(f"rate at which an overlap is removed at 1 kHz, `{model}`", found, rate, 1e-2, "1/s"))

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import INK, MODEL_COLORS

        axes = fig.subplots(1, 2, sharey=True)
        speeds = np.linspace(0.0, _FASTEST, 200)
        for ax, contact in zip(axes, FRICTION, strict=True):
            ax.plot(speeds, stribeck(contact, speeds), color=INK, linewidth=4, alpha=0.25, label="closed form")
            for model, marker in (("rigid", "s"), ("contact", "o")):
                curve = curves[contact, model]
                ax.plot(*curve, marker, markersize=3, color=MODEL_COLORS[model], label=model)
            for printed in FRICTION[contact]:
                ax.axhline(printed, color=INK, linewidth=0.8, linestyle="--")
            ax.axvline(CRITICAL_VELOCITY, color=INK, linewidth=0.8, linestyle="--")
            ax.set(title=contact, xlabel="slip speed (m/s)", xlim=(0.0, _FASTEST), ylim=(0.95, 1.15))
        axes[0].set_ylabel("friction coefficient")
        axes[1].legend(title="dashed: Table III")

    return Findings(claims, draw, _normal_contacts(params), compared=_compared(params))


def stribeck(contact: str, speeds: Array) -> Array:
    """The law, with the printed values."""
    static, dynamic = FRICTION[contact]
    coefficients: Array = dynamic + (static - dynamic) * np.exp(-((speeds / CRITICAL_VELOCITY) ** 2))
    return coefficients


def wheel_friction(params: bb.Params, model: str) -> Curve:
    """Friction of wheel 0 while equal torques make all three slip, which does not change their loads."""
    robot = bb.Ballbot(params, model=model, sim_dt=_SIM_DT)
    robot.step(np.zeros(3), steps=100)
    speeds, coefficients, speed = [], [], 0.0
    while speed < _FASTEST:
        robot.step(np.full(3, _BREAK_LOOSE))
        contacts = robot.contacts
        speeds.append(speed)
        coefficients.append(abs(contacts.wheel_tractions[0]) / contacts.wheel_normal_forces[0])
        speed = abs(float(contacts.wheel_slip_speeds[0]))
    return _slipping(speeds, coefficients)


def floor_friction(params: bb.Params, model: str) -> Curve:
    """Friction of a ball that is set down spinning in place."""
    idle = params.replace(wheel_static_friction=1e-6, wheel_dynamic_friction=1e-6)
    robot = bb.Ballbot(idle, model=model, sim_dt=_SIM_DT)
    turning = [0.0, -_FASTEST / params.ball_radius, 0.0]
    robot.reset(bb.State.at_rest(params).replace(ball_angular_velocity=turning))
    speeds, coefficients, speed = [], [], _FASTEST
    while speed > _SLIPS:
        robot.step(np.zeros(3))
        force = robot.contacts.floor_force
        speeds.append(speed)
        coefficients.append(float(np.hypot(force[0], force[1]) / force[2]))
        speed = float(np.hypot(*robot.contacts.floor_slip_velocity))
    # In the last step the ball begins to roll, which takes less than full friction.
    return _slipping(speeds[:-1], coefficients[:-1])


def _slipping(speeds: list[float], coefficients: list[float]) -> Curve:
    slips = np.array(speeds) > _SLIPS
    return Curve(np.array(speeds)[slips], np.array(coefficients)[slips])


def _loads(params: bb.Params) -> dict[str, float]:
    weight = (params.body_mass + params.ball_mass) * params.gravity
    return {"wheel on ball": probes.resting_load(params), "ball on floor": weight}


def _friction_table(params: bb.Params) -> str:
    """Printed values and ours: `Params.paper` copies the printed values, so there is nothing to claim."""
    p = params
    ours = {
        "wheel on ball": (p.wheel_static_friction, p.wheel_dynamic_friction),
        "ball on floor": (p.floor_static_friction, p.floor_dynamic_friction),
    }
    rows = [
        [f"{contact}, {kind}", f"{printed:g}", f"{value:g}"]
        for contact, coefficients in FRICTION.items()
        for kind, printed, value in zip(("static", "dynamic"), coefficients, ours[contact], strict=True)
    ]
    rows.append(["critical velocity (m/s)", f"{CRITICAL_VELOCITY:g}", f"{p.friction_critical_velocity:g}"])
    return table(["friction", "printed", "`Params.paper()`"], rows)


def _normal_contacts(params: bb.Params) -> str:
    depths = {model: depths_at_rest(params, model) for model in ("contact", "rigid")}
    rows = []
    for contact, load in _loads(params).items():
        stiffness, damping = STIFFNESS[contact], DAMPING[contact]
        rows.append(
            [
                contact,
                f"{load:.3f}",
                f"{1e6 * load / stiffness:.1f}",
                f"{damping / stiffness:g}",
                f"{1e6 * load / damping:.2g}",
                *(_depth(depths[model][contact]) for model in ("contact", "rigid")),
            ]
        )
    head = [
        "",
        "static load (N)",
        "depth by the printed stiffness (µm)",
        "printed c/k (s)",
        "yielding of the printed damper (µm/s)",
        "depth in `contact` (µm)",
        "depth in `rigid` (µm)",
    ]
    note = (
        "The depth of 10.3 µm is below the printed transition region of 100 µm, in which the block gives less than "
        "$k\\ d$: "
        "at rest its wheels would sink deeper than that, over minutes. Ours are depths after 0.3 s at 1 kHz."
    )
    return f"{_friction_table(params)}\n\n{table(head, rows)}\n\n{note}"


def _depth(depth: float) -> str:
    return f"{1e6 * depth:.1f}" if depth > 1e-9 else "< 0.001"


def recovery_rate(params: bb.Params, model: str) -> float:
    """For a body set 20 µm into the ball: the fraction of the overlap removed per step, over the step, 1/s."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.step(np.zeros(3), steps=200)
    rest = robot.state
    robot.reset(rest.replace(body_position=rest.body_position - np.array([0.0, 0.0, 2e-5])))
    overlaps = []
    for _ in range(12):
        robot.step(np.zeros(3))
        overlaps.append(float(robot.state.ball_position[2] - robot.state.body_position[2]))
    # The first steps also settle the loads.
    return float(1.0 - (overlaps[-1] / overlaps[5]) ** (1.0 / 6.0)) / robot.sim_dt


def depths_at_rest(params: bb.Params, model: str) -> dict[str, float]:
    """Overlap of wheel 0 and the ball, and of the ball and the floor, m."""
    robot = bb.Ballbot(params, model=model, sim_dt=1e-3)
    robot.step(np.zeros(3), steps=300)
    state = robot.state
    apart = params.ball_radius + params.wheel_radius
    center = state.body_position + robot_geometry(params).centers[0] - state.ball_position
    return {
        "wheel on ball": max(apart - float(np.linalg.norm(center)), 0.0),
        "ball on floor": max(params.ball_radius - float(state.ball_position[2]), 0.0),
    }


def _compared(params: bb.Params) -> tuple[Comparison, ...]:
    depth = _loads(params)["ball on floor"] / STIFFNESS["ball on floor"]
    return (
        Comparison(
            "friction coefficients, critical velocity",
            "Table III",
            "1.1, 1.0; 1.1, 1.05; 0.1 m/s",
            "the same",
            "they do not: `Params.paper()` has what is printed",
        ),
        Comparison(
            "stiffness and damping of contacts",
            "Table III",
            f"10⁶, 10⁸ (wheels); 40 000, 4000 (others): {1e3 * depth:.1f} mm into the floor",
            f"rigid contacts: {1e6 * max(depths_at_rest(params, 'rigid').values()):.0f} µm",
            "rows of a solver in place of a penalty method",
        ),
    )
