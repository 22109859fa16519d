"""The tab Record: recording, replay and its position, and files and links to keep."""

import html

import viser

from ballbot_rs.viewer.panels.controls import add_button, add_note, bound, note, on_client, put
from ballbot_rs.viewer.server.download import KINDS, Downloads
from ballbot_rs.viewer.server.link import query_of
from ballbot_rs.viewer.session.runner import Submit
from ballbot_rs.viewer.session.session import Session

#: Color of the button; white text on it has a contrast of 6.9.
RED = (176, 32, 40)

#: Length of the scrubber without a recording, s.
EMPTY = 1.0


class RecordPanel:
    """Controls of the recording.

    Args:
        server: shows them.
        submit: puts a command into the queue.
    """

    def __init__(self, server: viser.ViserServer, submit: Submit) -> None:
        gui = server.gui
        self._submit, self._downloads = submit, Downloads()
        self._record = add_button(gui, submit, "Record", _toggle_recording, color=RED)
        self._replay = add_button(gui, submit, "Replay", _toggle_replay)
        self._position = gui.add_slider("Replay at (s)", min=0.0, max=EMPTY, step=0.01, initial_value=0.0)
        self._position.on_update(on_client(submit, lambda: bound(_seek, float(self._position.value))))
        self._files = gui.add_button_group("Save as", tuple(KINDS), hint="robot 0 of the recording")
        self._files.on_click(self._save)
        self._note = add_note(gui, "")
        gui.add_divider()
        self._taken = gui.add_html("")

    async def _save(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        kind, client = self._files.value, event.client
        if event.client_id is not None and client is not None:
            self._submit(lambda session: self._downloads.start(session, kind, client))

    def show(self, session: Session) -> None:
        """Shows the state of the recording."""
        duration = round(session.recording.duration, 2)
        is_empty = len(session.recording.frames) < 2
        put(self._record, label="Stop recording" if session.is_recording else "Record")
        is_shown = session.replay_time is not None
        put(self._replay, label="Back to the simulation" if is_shown else "Replay", disabled=is_empty)
        put(self._position, visible=not is_empty, max=max(duration, 0.01) if not is_empty else EMPTY)
        put(self._files, visible=not is_empty)
        # During a pause the user views one instant, and moves it by hand.
        if session.replay_time is not None and not session.paused:
            put(self._position, value=min(round(session.replay_time, 2), self._position.max))
        text = self._downloads.progress or ("" if is_empty else f"{duration:.2f} s recorded.")
        put(self._note, content=note(text))
        put(self._taken, content=taken_html(query_of(session)))


def taken_html(query: str) -> str:
    """Buttons handled by the page's script: a picture of the scene, and a link to the present choice."""
    return (
        '<div class="ballbot-buttons"><button data-ballbot="screenshot">Screenshot</button>'
        f'<button data-ballbot="link" data-query="{html.escape(query)}">Copy link</button></div>'
        f'<div class="ballbot-note">The link opens this page with what is chosen now: {html.escape(query)}</div>'
    )


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


def _seek(session: Session, seconds: float) -> None:
    session.replay(min(seconds, session.recording.duration))
