r"""Torque-speed curve of the motors.

A motor with the stall torque $\tau_s$ and the no-load speed $\omega_0$ gives at most
$\tau_s(1 - \dot\psi/\omega_0)$ in the direction of motion
(`actuators={"stall_torque": 0.3, "no_load_speed": 20}`). Three equal torques turn ball and body about the vertical
against each other. Under full command the wheels approach $\omega_0$ as

$$\dot\psi(t) = \omega_0(1 - (1 - h/T)^{t/h}),\qquad T = \omega_0/\ddot\psi_0,$$

with $\ddot\psi_0$ the acceleration under $\tau_s$ and $h$ the model step, in which the torque is held. The table
has $\tau_s$ = 0.3 N·m, a little above the largest torque of the policy. LQR falls because it turns the robot to
its heading, which takes most of the wheel speed: started at this heading (`--set reset_yaw=0`), it does not.
"""

from typing import TYPE_CHECKING

import numpy as np

import ballbot_rs as bb
from ballbot_rs.envs.options import Actuators
from validation.claim import Claim
from validation.mechanics import Array
from validation.robots.sweep import EPISODES, PAPER, Measured, Sweep
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STALL = 0.3
_SIM_DT, _SECONDS = 1e-4, 0.5
_CLAIMED = (5.0, 20.0)
SWEEP = Sweep(
    "no-load speed (rad/s)",
    (50.0, 30.0, 20.0, 15.0, 10.0, 7.0, 5.0),
    lambda speed: {"actuators": motors(speed)},
    0.1,
    "--set actuators.stall_torque=0.3 --set actuators.no_load_speed=30",
)


def motors(no_load_speed: float) -> Actuators:
    """The option `actuators`."""
    return {"stall_torque": STALL, "no_load_speed": no_load_speed}


def spin_up(actuators: Actuators | None) -> tuple[Array, Array]:
    """Times, s, and wheel speeds, rad/s, in `spatial` under a full command of 0.3 N·m to all motors, from rest."""
    batch = bb.Batch(1, model="spatial", sim_dt=_SIM_DT, control_dt=1e-3, max_wheel_torque=STALL, actuators=actuators)
    batch.reset(starts=[bb.State.at_rest(PAPER)])
    speeds = [0.0]
    for _ in range(round(_SECONDS / batch.control_dt)):
        batch.step(np.ones((1, 3)))
        speeds.append(float(batch.state(0).wheel_speeds[0]))
    times: Array = batch.control_dt * np.arange(len(speeds), dtype=np.float64)
    return times, np.array(speeds)


def closed_form(times: Array, no_load_speed: float) -> Array:
    """The same with the torque-speed curve, from the acceleration of ideal motors."""
    ends, ideal = spin_up(None)
    share = _SIM_DT * float(ideal[-1] / ends[-1]) / no_load_speed
    speeds: Array = no_load_speed * (1.0 - (1.0 - share) ** (times / _SIM_DT))
    return speeds


def claims() -> list[Claim]:
    """The time constant, the final speed, and the reason why LQR needs the speed."""
    found = []
    for speed in _CLAIMED:
        times, speeds = spin_up(motors(speed))
        expected = closed_form(times, speed)
        half = int(np.argmin(np.abs(expected - 0.5 * speed)))
        found += [
            Claim(
                f"wheel speed at half the no-load speed of {speed:g} rad/s", speeds[half], expected[half], 1e-6, "rad/s"
            ),
            Claim(f"wheel speed after {_SECONDS:g} s, {speed:g} rad/s", speeds[-1], expected[-1], 1e-6, "rad/s"),
        ]
    facing = bb.evaluate("lqr", episodes=EPISODES, actuators=motors(5.0), reset_yaw=0.0)
    found.append(Claim("fraction of upright robots, LQR, 5 rad/s, `reset_yaw` = 0", facing.survival_rate, 1.0, 0.0))
    return found


def run() -> Findings:
    """Sweeps the no-load speed."""
    measured = Measured(SWEEP)
    curves = {speed: spin_up(motors(speed)) for speed in _CLAIMED}

    def draw(fig: "Figure") -> None:
        left, middle, right = fig.subplots(1, 3)
        for speed, (times, found) in curves.items():
            (line,) = left.plot(times, closed_form(times, speed), label=f"{speed:g} rad/s")
            left.plot(times[::25], found[::25], "o", color=line.get_color())
        left.set(xlabel="time (s)", ylabel="wheel speed (rad/s)")
        left.legend()
        measured.draw(middle, right)

    return Findings(claims(), draw, measured.markdown(), (10.0, 3.2))
