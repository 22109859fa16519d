"""A frame, which shows a session at one instant, and a series of frames for replay."""

import bisect
import dataclasses

import numpy as np
import numpy.typing as npt

from ballbot_rs._core import Contacts, Params, Terrain
from ballbot_rs.viewer.asked import Asked

FloatArray = npt.NDArray[np.float64]

#: Capacity of a recording in robots times frames: ten minutes of one robot.
CAPACITY = 60_000

#: Least simulated time between two frames of a recording, s.
PERIOD = 0.01


@dataclasses.dataclass(frozen=True)
class Frame:
    """All robots of a session at one instant; forces are on robot 0."""

    #: Name of the robot.
    robot: str
    #: Simulated time, s.
    time: float
    #: Rows as `State.to_array`, shape (n, 32).
    states: FloatArray
    #: Torques of the last control step, N·m, shape (n, 3).
    torques: FloatArray
    #: Components about inertial x and y of the tilt of robot 0 from its equilibrium, rad.
    tilt: FloatArray
    #: These columns of the state that its controller gets; None where it gets the true state.
    estimated_tilt: FloatArray | None
    #: Forces of the last time step on robot 0, and its parameters after changes and events.
    contacts: Contacts
    params: Params
    #: Loads of the wheels of robot 0, N.
    loads: FloatArray
    #: Slip speeds of the wheels of robot 0, m/s.
    slip: FloatArray
    #: Fraction of the dynamic friction limit in use, three wheels and floor of robot 0.
    utilization: FloatArray
    #: Setpoint of the robots, m; None if the controller does not follow a position, and in tasks other than balance.
    setpoint: FloatArray | None
    #: Intermediate target of robot 0's controller on the way to the goal, m.
    target: FloatArray | None
    #: Commands of a task other than balance.
    asked: Asked | None = None
    #: The curve along which the setpoint moves, m, shape (k, 2).
    route: FloatArray | None = None
    #: State of the ghost, as a row of `states`.
    ghost: FloatArray | None = None
    #: Impulse (x, y) of a recent manual push, N·s.
    push: FloatArray | None = None
    #: The ground; None is level.
    terrain: Terrain | None = None

    def heights(self, points: npt.ArrayLike) -> FloatArray:
        """Heights of the ground at points (x, y), m; shape (n, 2) gives (n,)."""
        x, y = np.asarray(points, dtype=np.float64).T[:2]
        return np.zeros(np.shape(x)) if self.terrain is None else np.asarray(self.terrain.height(x, y))


class Recording:
    """Frames ordered by time, at most `CAPACITY`."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def add(self, frame: Frame) -> bool:
        """Adds a frame unless it comes too soon after the last; False if the recording is full."""
        if (len(self.frames) + 1) * len(frame.states) > CAPACITY:
            return False
        if not self.frames or frame.time - self.frames[-1].time >= PERIOD * (1.0 - 1e-9):
            self.frames.append(frame)
        return True

    @property
    def duration(self) -> float:
        """From the first frame to the last, s."""
        return self.frames[-1].time - self.frames[0].time if self.frames else 0.0

    def at(self, seconds: float) -> Frame:
        """The last frame within `seconds` after the first.

        Raises:
            ValueError: there are no frames.
        """
        if not self.frames:
            raise ValueError("nothing has been recorded yet")
        time = self.frames[0].time + seconds + 1e-9
        index = bisect.bisect_right(self.frames, time, key=lambda frame: frame.time) - 1
        return self.frames[max(index, 0)]
