r"""Rolling and spinning friction of the floor.

On a compliant floor a torque of $c_r$ times the ball's load opposes rolling, and a torque of $c_s$ times the load
opposes spinning about the vertical ([losses](derivations.md#losses)). A rolling robot has the drag
$(c_r/r_k)(M_b + M_k)g$, a spinning ball the torque $c_s(M_b + M_k)g$. $c_r$ is some 0.1 mm to 1 mm on a hard floor, 1
mm to 3 mm on a carpet.

No robot falls, but near rest the robots hunt: the ball sticks, the body continues to lean, and the ball breaks loose.
At 2 mm LQR misses the success criterion at the end of one episode in eleven. Beyond 3 mm the friction damps the
hunting. Sticking friction creeps, in proportion to the time step: in steps of 0.2 ms instead of 2 ms the position rms
of LQR is 0.0298 m at 2 mm, not 0.0271 m (`--set sim_dt=0.0002`). An LQR designed for this robot is the same LQR,
because dry friction has no derivative at rest.
"""

import ballbot_rs as bb
from validation.claim import Claim
from validation.robots.energy import drag
from validation.robots.sweep import PAPER, Measured, Sweep, drawn
from validation.topic import Findings

SWEEP = Sweep(
    "coefficient of rolling friction (mm)",
    (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0),
    lambda mm: drawn("floor_rolling_friction", "abs", 1e-3 * mm),
    0.1,
    '--set \'events=[{"term": "floor_rolling_friction", "range": [0.0005, 0.0005]}]\'',
)
_WEIGHT = (PAPER.ball_mass + PAPER.body_mass) * PAPER.gravity


def rolling_drag(model: str, mm: float) -> float:
    """Drag of the robot at 0.2 m/s, N."""
    params = PAPER.replace(floor_rolling_friction=1e-3 * mm)
    return drag(params, model, bb.State.rolling(params, (0.2, 0.0)))


def spinning_torque(model: str, mm: float) -> float:
    """Torque on the spinning ball, N·m."""
    params = PAPER.replace(floor_spinning_friction=1e-3 * mm)
    return params.ball_radius * drag(params, model, bb.State.rolling(params, (0.0, 0.0), ball_spin=1.0))


def claims() -> list[Claim]:
    """Drag and torque in both simulations."""
    found = []
    for model in ("contact", "rigid"):
        expected = 2e-3 / PAPER.ball_radius * _WEIGHT
        found.append(Claim(f"drag at 2 mm, {model}", rolling_drag(model, 2.0), expected, 2e-3, "N"))
        found.append(
            Claim(
                f"torque on the spinning ball at 2 mm, {model}",
                spinning_torque(model, 2.0),
                2e-3 * _WEIGHT,
                2e-3,
                "N·m",
            )
        )
    return found


def run() -> Findings:
    """Sweeps the rolling friction."""
    lines = [1e-3 * mm / PAPER.ball_radius * _WEIGHT for mm in SWEEP.values]
    dots = [rolling_drag("contact", mm) for mm in SWEEP.values]
    return Measured(SWEEP).findings(claims(), "drag (N)", lines, dots)
