"""A frame, which shows a session at one instant; series of frames for replay and plots."""

import bisect
import dataclasses
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded
from ballbot_rs._core import Contacts, Params, Terrain
from ballbot_rs._state_rows import BALL_POSITION, BALL_VELOCITY

FloatArray = npt.NDArray[np.float64]

#: Capacity of a recording in robots times frames: ten minutes of one robot.
CAPACITY = 60_000

#: Least simulated time between two frames of a recording, s.
PERIOD = 0.01

#: Time span of the plots, s, and the least time between two samples, s.
SPAN, SAMPLE_PERIOD = 10.0, 0.02

#: Rows of `History.series` by name.
SERIES: dict[str, slice] = {
    "time": slice(0, 1),
    "tilt": slice(1, 3),
    "torques": slice(3, 6),
    "loads": slice(6, 9),
    "slip": slice(9, 12),
    "utilization": slice(12, 16),
    "estimated tilt": slice(16, 18),
    "position": slice(18, 20),
    "speed": slice(20, 21),
    "ghost tilt": slice(21, 23),
    "ghost position": slice(23, 25),
    "ghost speed": slice(25, 26),
}
ROWS = 26


@dataclasses.dataclass(frozen=True)
class Commands:
    """The commands of all robots, and the metrics of robot 0 so far."""

    #: Name of the task.
    task: str
    #: Shape (n, k), columns as in `TASKS[task]["command"]`.
    values: FloatArray
    #: Position of each ball when its command was given, m, shape (n, 2): a path begins there.
    begins: FloatArray
    #: Desired position of each ball now, m, shape (n, 2).
    points: FloatArray
    #: Last push of the task on each body, shape (n, 3): impulse (N·s), azimuth (rad), height; NaN without one.
    pushes: FloatArray
    #: Metrics of robot 0, by name; NaN where the episode is too short.
    metrics: Mapping[str, float]
    #: Whether the command came from the page.
    by_hand: bool
    #: Points of the line that a task in Python draws for each robot, shape (k, 2) each, m.
    drawings: Sequence[FloatArray] = ()


@dataclasses.dataclass(frozen=True)
class Ghost:
    """The robot to compare with."""

    #: Name of its controller, as shown.
    label: str
    #: As a row of `Frame.states`.
    state: FloatArray
    #: As `Frame.tilt`.
    tilt: FloatArray


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
    #: Robots with their payloads' deflections, as `Ballbot.payloads`; empty where none has a payload.
    loads: Sequence[tuple[Params, FloatArray]] = ()
    #: Name of the controller of robot 0, as shown.
    label: str = ""
    #: Setpoint of the robots, m; None if the controller does not follow a position, and in tasks other than balance.
    setpoint: FloatArray | None = None
    #: Intermediate target of robot 0's controller on the way to the goal, m.
    target: FloatArray | None = None
    #: Commands of a task other than balance.
    commands: Commands | None = None
    #: Limits that a control barrier keeps: speed of the ball, m/s, and least and largest x, then y, of its center, m.
    speed_limit: float | None = None
    boundary: tuple[float, float, float, float] | None = None
    #: The curve along which the setpoint moves, m, shape (k, 2).
    route: FloatArray | None = None
    ghost: Ghost | None = None
    #: Impulse (x, y) of a recent manual push, N·s, and its time, s.
    push: FloatArray | None = None
    push_time: float = 0.0
    #: The ground; None is level.
    terrain: Terrain | None = None
    #: Whether `contacts` are of this instant: a log has no forces.
    has_forces: bool = True

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


class History:
    """The last seconds of robot 0 for plots: samples at most `SPAN` old."""

    def __init__(self) -> None:
        self._samples: deque[FloatArray] = deque(maxlen=round(SPAN / SAMPLE_PERIOD))

    def add(self, frame: Frame) -> None:
        """Adds a sample unless it comes too soon; a sample from the past restarts the history."""
        if self._samples:
            elapsed = frame.time - self._samples[-1][0]
            if elapsed < 0.0:
                self.clear()
            elif elapsed < SAMPLE_PERIOD * (1.0 - 1e-9):
                return
        estimated = np.full(2, np.nan) if frame.estimated_tilt is None else frame.estimated_tilt
        contacts = frame.contacts
        forces: tuple[FloatArray, ...] = (
            contacts.wheel_normal_forces,
            contacts.wheel_slip_speeds,
            contacts.friction_utilization,
        )
        if not frame.has_forces:
            forces = tuple(np.full_like(force, np.nan) for force in forces)
        ghost = np.full(5, np.nan)
        if frame.ghost is not None:
            ghost = np.concatenate([frame.ghost.tilt, _motion(frame.ghost.state)])
        motion = _motion(frame.states[0])
        parts = ([frame.time], frame.tilt, frame.torques[0], *forces, estimated, motion, ghost)
        self._samples.append(np.concatenate(parts))

    def clear(self) -> None:
        """Removes all samples."""
        self._samples.clear()

    def series(self) -> FloatArray:
        """All samples, shape (26, n), rows as in `SERIES`; NaN without an estimate, and without a ghost."""
        return np.array(self._samples).T if self._samples else np.empty((ROWS, 0))


def _motion(state: FloatArray) -> FloatArray:
    """Position of a ball (x, y), m, and its speed, m/s."""
    return np.append(state[BALL_POSITION][:2], np.hypot(*state[BALL_VELOCITY][:2]))


class Player:
    """A recording, a replay of it, and what the plots show of either."""

    def __init__(self) -> None:
        self.recording = Recording()
        self.is_recording = False
        #: Replay time since the start of the recording, s; None while the robots move.
        self.replay_time: float | None = None
        #: Whether a replay begins again at its end.
        self.repeats = False
        self.history = History()

    def start_recording(self) -> None:
        """Begins a recording in place of the last."""
        self.replay_time = None
        self.recording = Recording()
        self.is_recording = True

    def stop_recording(self) -> None:
        """Ends the recording, if any."""
        self.is_recording = False

    def replay(self, seconds: float = 0.0) -> None:
        """Shows the recording from `seconds` after its beginning; the robots wait. Raises ValueError if it is empty."""
        self.stop_recording()
        self.recording.at(0.0)
        self.replay_time = check_bounded("seconds", seconds, 0.0, max(self.recording.duration, 0.0))
        self.history.clear()

    def end_replay(self) -> None:
        """Lets the robots move on."""
        self.replay_time = None
        self.history.clear()

    def _move_replay(self, seconds: float) -> None:
        assert self.replay_time is not None
        later, duration = self.replay_time + seconds, self.recording.duration
        self.replay_time = 0.0 if self.repeats and later > duration else min(later, duration)
        self.history.add(self.recording.at(self.replay_time))

    def _note(self, frame: Frame) -> bool:
        """Keeps a frame; False if the recording is full, which ends it."""
        self.history.add(frame)
        if self.is_recording and not self.recording.add(frame):
            self.stop_recording()
            return False
        return True
