"""A session that shows a log: the measured motion, and the simulated one as its ghost."""

import dataclasses

import numpy as np

from ballbot_rs._state_rows import tilt_components_of
from ballbot_rs.identification.replay import Replay
from ballbot_rs.viewer.session.recording import Ghost
from ballbot_rs.viewer.session.session import Session


def session_of(replay: Replay, robot: str) -> Session:
    """A session that replays a log from its beginning, as far as a recording can hold it.

    Args:
        replay: the log and its simulation.
        robot: name of the robot, which has the look of the preset with this name.
    """
    session = Session(replay.model, robot, params=replay.params)
    template = session.frame()
    measured, simulated = (one.to_array() for one in replay.trajectories())
    com = np.add((*replay.params.body_com_offset, 0.0), (0.0, 0.0, replay.params.body_com_height))
    tilts, ghost_tilts = (tilt_components_of(states, com) for states in (measured, simulated))
    torques = replay.log.torques[replay.windows.rows]
    for row, time in enumerate(replay.time):
        frame = dataclasses.replace(
            template,
            time=float(time),
            states=measured[row : row + 1],
            torques=torques[row : row + 1],
            tilt=tilts[row],
            label="measured",
            ghost=Ghost("simulated", simulated[row], ghost_tilts[row]),
            has_forces=False,
            setpoint=None,
            target=None,
        )
        if not session.recording.add(frame):
            session.notices.append(f"the page shows the first {session.recording.duration:.0f} s of the log")
            break
    session.notices.append("solid: measured; transparent: simulated; forces are unknown")
    session.repeats = True
    session.replay()
    return session
