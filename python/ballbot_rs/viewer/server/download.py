"""Files of a recording: its robot 0 as a trajectory, written as by the command line."""

import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import viser
from typing_extensions import Self

from ballbot_rs._core import Renderer, State
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.media.video import renderer_for, write_video
from ballbot_rs.viewer.session.recording import Frame
from ballbot_rs.viewer.session.session import Session
from ballbot_rs.viewer.session.setup import Setup

#: Suffixes by the labels of the buttons.
KINDS: Final = {"CSV": ".csv", "MCAP": ".mcap", "Video": ".mp4"}

#: Videos: size, px, samples per pixel, and frames per second.
WIDTH, HEIGHT, SAMPLES, FRAME_RATE = 640, 480, 2, 25.0


class Recorded(NamedTuple):
    """The recording of a session, taken at once: its trajectory may be made in another thread."""

    frames: list[Frame]
    controller: str
    setup: Setup

    @classmethod
    def of(cls, session: Session) -> Self:
        """What a session has recorded."""
        # Frames do not change; the list does.
        return cls(list(session.recording.frames), session.controller, session.robots.setup)

    def trajectory(self) -> Trajectory:
        """Robot 0, with the parameters and settings that it has at the end."""
        frames, setup = self.frames, self.setup
        begin = frames[0].time
        places = [frame.setpoint for frame in frames if frame.setpoint is not None]
        fallen = [frame.time for frame in frames if frame.contacts.bot_on_floor]
        commands = [frame.commands for frame in frames if frame.commands is not None]
        pushes = {
            frame.push_time: frame.push for frame in frames if frame.push is not None and frame.push_time >= begin
        }
        return Trajectory(
            controller=Path(self.controller).name,
            model=setup.model,
            params=frames[-1].params,
            terrain=frames[-1].terrain,
            times=np.array([frame.time for frame in frames]) - begin,
            states=[State.from_array(frame.states[0]) for frame in frames],
            contacts=[frame.contacts for frame in frames],
            torques=np.array([frame.torques[0] for frame in frames]),
            draws={},
            estimates=[],
            fell_at=fallen[0] - begin if fallen else None,
            setpoints={"position": np.array(places)} if len(places) == len(frames) else {},
            pushes=[Push((x, y, 0.0), time - begin) for time, (x, y) in pushes.items()],
            max_wheel_torque=setup.max_torque,
            payloads=np.array([frame.loads[0][1] if frame.loads else np.zeros((2, 6)) for frame in frames])
            if any(frame.loads for frame in frames)
            else np.zeros((0, 2, 6)),
            commands=np.array([one.values[0] for one in commands])
            if len(commands) == len(frames)
            else np.zeros((0, 0)),
            task=setup.task,
            control_dt=setup.substeps * setup.sim_dt if setup.substeps > 1 else None,
            sim_dt=setup.sim_dt,
        )


class Downloads:
    """Writes one file at a time, in a separate thread, since rendering a video is slower than real time."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        #: Progress, or why there is no file; empty when done.
        self.progress = ""

    def start(self, session: Session, kind: str, client: viser.ClientHandle) -> None:
        """Writes the recording of a session and sends it to a client.

        Raises:
            ValueError: nothing has been recorded, or another file is being written.
        """
        if self._thread is not None and self._thread.is_alive():
            raise ValueError("a file is being written: wait for it")
        if len(session.recording.frames) < 2:
            raise ValueError("nothing has been recorded yet")
        recorded = Recorded.of(session)
        self._thread = threading.Thread(target=self._write, args=(recorded, kind, client), daemon=True)
        self.progress = f"{kind}: begins"
        self._thread.start()

    def _write(self, recorded: Recorded, kind: str, client: viser.ClientHandle) -> None:
        def report(done: int, total: int) -> None:
            self.progress = f"{kind}: frame {done} of {total}"

        try:
            content = file_of(recorded.trajectory(), kind, report)
            client.send_file_download(f"ballbot{KINDS[kind]}", content, save_immediately=True)
            self.progress = ""
        except Exception as error:  # A page shows why; the simulation continues.
            self.progress = f"{kind}: {error or type(error).__name__}"


def file_of(trajectory: Trajectory, kind: str, progress: Callable[[int, int], None]) -> bytes:
    """The contents of a file of a kind in `KINDS`.

    Raises:
        ModuleNotFoundError: a package that writes it is not installed.
        OSError: the video cannot be encoded.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"ballbot{KINDS[kind]}")
        if kind == "CSV":
            trajectory.to_csv(path)
        elif kind == "MCAP":
            trajectory.to_mcap(path)
        else:
            renderer: Renderer = renderer_for(trajectory, width=WIDTH, height=HEIGHT, samples=SAMPLES)
            write_video(trajectory, path, renderer=renderer, frame_rate=FRAME_RATE, progress=progress)
        return path.read_bytes()
