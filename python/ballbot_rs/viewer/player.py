"""Recording and replay of a session."""

from ballbot_rs.viewer.bounds import check_bounded
from ballbot_rs.viewer.history import History
from ballbot_rs.viewer.recording import Frame, Recording


class Player:
    """A recording, a replay of it, and what the plots show of either."""

    def __init__(self) -> None:
        self.recording = Recording()
        self.is_recording = False
        #: Replay time since the start of the recording, s; None while the robots move.
        self.replay_time: float | None = None
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
        self.replay_time = min(self.replay_time + seconds, self.recording.duration)
        self.history.add(self.recording.at(self.replay_time))

    def _note(self, frame: Frame) -> bool:
        """Keeps a frame; False if the recording is full, which ends it."""
        self.history.add(frame)
        if self.is_recording and not self.recording.add(frame):
            self.stop_recording()
            return False
        return True
