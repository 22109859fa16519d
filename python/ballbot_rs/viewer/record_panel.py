"""The tab Record: a recording, a replay of it, and where in it."""

import viser

from ballbot_rs.viewer.controls import Submit, add_button, add_note, note, on_client, put
from ballbot_rs.viewer.runner import Command
from ballbot_rs.viewer.session import Session

#: Of the button; white text on it has a contrast of 6.9.
RED = (176, 32, 40)

#: Length of the scrubber while there is nothing to replay, s.
EMPTY = 1.0


class RecordPanel:
    """Controls of the recording.

    Args:
        server: shows them.
        submit: puts a command into the queue.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit) -> None:
        gui = server.gui
        self._record = add_button(gui, submit, "Record", _toggle_recording, color=RED)
        self._replay = add_button(gui, submit, "Replay", _toggle_replay)
        self._position = gui.add_slider(
            "Replay at (s)", min=0.0, max=EMPTY, step=0.01, initial_value=0.0, disabled=True
        )
        self._position.on_update(on_client(submit, lambda: _seek(float(self._position.value))))
        self._note = add_note(gui, "")

    def show(self, session: Session) -> None:
        """Shows what there is."""
        duration = round(session.recording.duration, 2)
        is_shown = session.replay_time is not None
        is_empty = not session.recording.frames
        put(self._record, label="Stop recording" if session.is_recording else "Record")
        put(self._replay, label="Back to the simulation" if is_shown else "Replay", disabled=is_empty)
        put(self._position, disabled=is_empty or session.is_recording, max=max(duration, EMPTY if is_empty else 0.01))
        # A pause is for a look at one instant; a user who drags sets the value.
        if is_shown and not session.paused:
            put(self._position, value=min(round(session.replay_time or 0.0, 2), self._position.max))
        put(self._note, content=note("" if is_empty else f"{duration:.2f} s recorded."))


def _toggle_recording(session: Session) -> None:
    if session.is_recording:
        session.stop_recording()
    else:
        session.start_recording()


def _toggle_replay(session: Session) -> None:
    if session.replay_time is None:
        session.replay()
    else:
        session.end_replay()


def _seek(seconds: float) -> Command:
    return lambda session: session.replay(min(seconds, session.recording.duration))
