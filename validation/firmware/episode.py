"""A robot that follows commanded velocities under the firmware, and the same torques computed in this process."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

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

#: Computes torques and the setpoint from which they follow.
Compute: TypeAlias = Callable[[], tuple[Array, bb.Setpoint]]

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
    limit = bb.Params.paper().max_wheel_torque if policy is None else float(policy.env_options["max_wheel_torque"])
    options: dict[str, Any] = dict.fromkeys(("reset_tilt", "reset_yaw", "reset_ball_speed", "reset_tilt_rate"), 0.0)
    options |= {"control_dt": CONTROL_DT, "max_episode_steps": steps + 1, "max_wheel_torque": limit}
    options |= {"sensors": str(sensors), "observation": "sensors"}
    batch = bb.Batch(1, "velocity", seed=seed, num_threads=1, **options)
    batch.reset()
    compute = _law(controller, batch) if policy is None else _policy(policy, batch)
    torques, expected = np.zeros((2, steps, 3))
    with bb.Link(address, control_dt=CONTROL_DT, timeout=_TIMEOUT) as link:
        for step in range(steps):
            expected[step], setpoint = compute()
            torques[step] = link(batch.readings(0), setpoint)
            if batch.step([torques[step] / limit])[2][0]:
                raise RuntimeError(f"the robot falls after {step * CONTROL_DT:.2f} s")
        at_end()
        return Episode(torques, expected, batch.metrics(0), link.statistics.statuses)


def _law(name: str, batch: bb.Batch) -> Compute:
    """A law on the estimate and the setpoint of the task."""
    law = bb.Controller(name, "paper", CONTROL_DT)

    def compute() -> tuple[Array, bb.Setpoint]:
        setpoint = bb.Setpoint(**batch.setpoint(0))
        return law(batch.estimate(0), **{part: setpoint[part] for part in law.setpoint_parts}), setpoint

    return compute


def _policy(policy: OnnxPolicy, batch: bb.Batch) -> Compute:
    """A policy on the observation of the task, whose commanded velocity is in the heading frame."""

    def compute() -> tuple[Array, bb.Setpoint]:
        w, _, _, z = batch.estimate(0).body_quaternion
        x, y, yaw_rate = batch.command(0)
        yaw = 2.0 * np.arctan2(z, w)
        velocity = np.array([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y])
        setpoint = bb.Setpoint(velocity=velocity, yaw_rate=yaw_rate)
        action = np.clip(policy.act(batch.observations()[0]), -1.0, 1.0).astype(np.float64)
        return batch.max_wheel_torque * action, setpoint

    return compute
