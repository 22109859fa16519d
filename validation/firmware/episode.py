"""A robot that follows commanded velocities under the firmware, and the same torques computed in this process."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs.control.onnx_policy import OnnxPolicy
from validation.firmware.qemu import ROOT, SENSORS

Array = npt.NDArray[np.float64]

POLICY: Final = ROOT / "assets" / "policies" / "velocity.onnx"
#: What the firmware runs: laws by their names, and a policy.
CONTROLLERS: Final[Mapping[str, str]] = {
    **{name: name for name in ("lqr", "cascade_pid", "lqr_pi")},
    "velocity.onnx": str(POLICY),
}
CONTROL_DT: Final = 0.01

#: Longest wait for an answer, which QEMU gives in milliseconds on a computer that does nothing else, s.
_TIMEOUT: Final = 5.0


@dataclass(frozen=True)
class Episode:
    """Result of a run."""

    #: Torques of the firmware and of this process, shape (steps, 3), N·m.
    torques: Array
    expected: Array
    #: Metrics of the task at the end.
    metrics: dict[str, float]
    #: Answers of the firmware by status.
    statuses: dict[str, int]

    @property
    def difference(self) -> float:
        """Largest difference of a torque, N·m."""
        return float(np.abs(self.torques - self.expected).max())


def run(
    controller: str,
    address: str,
    seconds: float,
    *,
    seed: int = 0,
    sensors: Path = SENSORS,
    at_end: Callable[[], None] = lambda: None,
) -> Episode:
    """Runs the paper's robot in the task `velocity` from rest, with commands that change every 3 to 8 s.

    Args:
        controller: one of `CONTROLLERS`, which the firmware has and this process computes on the same readings.
        address: of the firmware.
        seconds: of the simulation.
        seed: of commands and sensors.
        sensors: a file of the sensors for which the firmware was built.
        at_end: called before the line is closed.

    Raises:
        RuntimeError: the robot falls.
    """
    steps = round(seconds / CONTROL_DT)
    policy = OnnxPolicy(POLICY) if controller == "velocity.onnx" else None
    limit = policy.env_options["max_wheel_torque"] if policy else bb.Params.paper().max_wheel_torque
    batch = bb.Batch(
        1,
        "velocity",
        seed=seed,
        num_threads=1,
        control_dt=CONTROL_DT,
        max_episode_steps=steps + 1,
        max_wheel_torque=limit,
        sensors=str(sensors),
        observation="sensors",
        **dict.fromkeys(("reset_tilt", "reset_yaw", "reset_ball_speed", "reset_tilt_rate"), 0.0),
    )
    batch.reset()
    law = None if policy else bb.Controller(controller, "paper", CONTROL_DT)
    torques, expected = np.zeros((2, steps, 3))
    with bb.Link(address, control_dt=CONTROL_DT, timeout=_TIMEOUT) as link:
        for step in range(steps):
            estimate = batch.estimate(0)
            if law:
                setpoint = batch.setpoint(0)
                target = {part: setpoint[part] for part in ("position", "velocity", "yaw", "yaw_rate")}
                expected[step] = law(estimate, **target)
            else:
                target = _target_of(batch.command(0), estimate)
                expected[step] = limit * np.clip(policy.act(batch.observations()[0]), -1.0, 1.0)
            torques[step] = link(batch.readings(0), **target)
            if batch.step([torques[step] / limit])[2][0]:
                raise RuntimeError(f"the robot falls after {step * CONTROL_DT:.2f} s")
        at_end()
        return Episode(torques, expected, batch.metrics(0), link.statistics.statuses)


def _target_of(command: Array, estimate: bb.State) -> dict[str, Any]:
    """The setpoint of a command of the task, whose velocity is in the heading frame."""
    w, _, _, z = estimate.body_quaternion
    heading = 2.0 * np.arctan2(z, w)
    x, y, yaw_rate = command
    cos, sin = np.cos(heading), np.sin(heading)
    return {
        "position": np.zeros(2),
        "velocity": np.array([cos * x - sin * y, sin * x + cos * y]),
        "yaw": 0.0,
        "yaw_rate": yaw_rate,
    }
