"""All robots of a batch as arrays: the input of tasks and functions in Python."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._arrays import read_only

FloatArray = npt.NDArray[np.float32]

#: Columns of the core's rows of robots by name.
COLUMNS: Final = {
    "gravity": slice(0, 3),
    "body_rate": slice(3, 6),
    "wheel_speeds": slice(6, 9),
    "wheel_angles": slice(9, 12),
    "ball_position": slice(12, 15),
    "ball_velocity": slice(15, 18),
    "ball_rate": slice(18, 21),
    "body_quaternion": slice(21, 25),
    "last_action": slice(25, 28),
    "body_com": slice(28, 31),
}

#: How many columns there are.
WIDTH: Final = 31


class Robots:
    """All robots after a control step, float32, first axis over robots.

    ```python
    class Slow(bb.Task):
        base = "balance"

        def reward(self, robots):
            return -np.linalg.norm(robots.velocity, axis=1) - robots.tilt**2

    bb.register("me/Slow-v0", Slow)
    print(bb.evaluate("lqr", task="me/Slow-v0", episodes=4))
    ```

    Arrays are read-only: views into one array of the batch, without copies, or computed once per step. With
    `observation="sensors"` the arrays for `observe` come from the sensor readings; `reward` and `terminated` get the
    true states.
    """

    def __init__(
        self,
        rows: FloatArray,
        command: npt.NDArray[np.float64],
        steps: npt.NDArray[np.int64],
        numbers: npt.NDArray[np.intp],
        control_dt: float,
    ) -> None:
        self._rows = read_only(rows)
        #: The present command of the task, shape (n, k), its parts as in `TASKS[task]["command"]`.
        self.command = read_only(command)
        #: Numbers of the robots in the batch, shape (n,).
        self.numbers = read_only(numbers)
        #: Control steps since the start of the episode, shape (n,), int64.
        self.steps = read_only(steps)
        #: Duration of a control step, s.
        self.control_dt = control_dt

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, chosen: npt.NDArray[np.intp]) -> Robots:
        """Some of the robots, by their numbers."""
        rest = (self.command[chosen], self.steps[chosen], self.numbers[chosen])
        return Robots(self._rows[chosen], *rest, self.control_dt)

    def __repr__(self) -> str:
        return f"Robots({len(self)}: {', '.join(COLUMNS)}, tilt, yaw, yaw_rate, velocity, command, steps, time)"

    @property
    def gravity(self) -> FloatArray:
        """Direction of gravity, body frame, shape (n, 3)."""
        return self._rows[:, COLUMNS["gravity"]]

    @property
    def body_rate(self) -> FloatArray:
        """Angular velocity of the body, body frame, shape (n, 3), rad/s."""
        return self._rows[:, COLUMNS["body_rate"]]

    @property
    def wheel_speeds(self) -> FloatArray:
        """Rates of the wheels' encoders, shape (n, 3), rad/s."""
        return self._rows[:, COLUMNS["wheel_speeds"]]

    @property
    def wheel_angles(self) -> FloatArray:
        """Angles of the wheels' encoders, shape (n, 3), rad."""
        return self._rows[:, COLUMNS["wheel_angles"]]

    @property
    def ball_position(self) -> FloatArray:
        """Center of the ball, inertial frame, shape (n, 3), m."""
        return self._rows[:, COLUMNS["ball_position"]]

    @property
    def ball_velocity(self) -> FloatArray:
        """Velocity of the ball's center, inertial frame, shape (n, 3), m/s."""
        return self._rows[:, COLUMNS["ball_velocity"]]

    @property
    def ball_rate(self) -> FloatArray:
        """Angular velocity of the ball, inertial frame, shape (n, 3), rad/s."""
        return self._rows[:, COLUMNS["ball_rate"]]

    @property
    def body_quaternion(self) -> FloatArray:
        """Attitude of the body, [w, x, y, z], body to inertial, shape (n, 4)."""
        return self._rows[:, COLUMNS["body_quaternion"]]

    @property
    def last_action(self) -> FloatArray:
        """The last action, clipped to ±1, shape (n, 3); zeros at the start of an episode."""
        return self._rows[:, COLUMNS["last_action"]]

    @property
    def body_com(self) -> FloatArray:
        """Center of mass of the body, body frame, whose origin is the ball's center, shape (n, 3), m."""
        return self._rows[:, COLUMNS["body_com"]]

    @cached_property
    def tilt(self) -> FloatArray:
        """Tilt from the equilibrium, shape (n,), rad: of the line from the ball's center to the CoM."""
        cosine = -np.einsum("ij,ij->i", self.gravity, self.body_com)
        across = np.linalg.norm(np.cross(self.gravity, self.body_com), axis=1)
        tilt: FloatArray = np.arctan2(across, cosine).astype(np.float32)
        return read_only(tilt)

    @cached_property
    def yaw(self) -> FloatArray:
        """Heading, shape (n,), rad, in ±π."""
        w, _, _, z = self.body_quaternion.T
        yaw: FloatArray = 2.0 * np.arctan2(z, w)
        wrapped: FloatArray = (yaw + np.float32(np.pi)) % np.float32(2.0 * np.pi) - np.float32(np.pi)
        return read_only(wrapped)

    @cached_property
    def yaw_rate(self) -> FloatArray:
        """Angular velocity of the body about the vertical, shape (n,), rad/s."""
        rate: FloatArray = -np.einsum("ij,ij->i", self.gravity, self.body_rate)
        return read_only(rate)

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocity of the ball, heading frame, shape (n, 2), m/s."""
        w, _, _, z = self.body_quaternion.T
        norm = np.maximum(w * w + z * z, np.float32(1e-30))
        cos, sin = (w * w - z * z) / norm, 2.0 * w * z / norm
        x, y, _ = self.ball_velocity.T
        turned: FloatArray = np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)
        return read_only(turned)

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Time since the start of the episode, shape (n,), s."""
        return read_only(np.multiply(self.steps, self.control_dt, dtype=np.float64))
