"""Shared by the panels of the page: callbacks that put commands into the queue, and notes."""

import html
from collections.abc import Callable, Coroutine
from typing import Any

import viser

from ballbot_rs.viewer.session.runner import Command, Submit


def on_client(
    submit: Submit, make: Callable[[], Command]
) -> Callable[[viser.GuiEvent[Any]], Coroutine[Any, Any, None]]:
    """A callback that submits a command if a client, not the server, changed something.

    It is a coroutine, as are all callbacks that read a control: viser calls a function later, in a thread, when the
    page may have restored the session's old value.
    """

    async def callback(event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None:
            submit(make())

    return callback


def bound(method: Callable[..., Any], *arguments: Any) -> Command:
    """A command that calls a method of the session."""
    return lambda session: method(session, *arguments)


def add_button(
    gui: viser.GuiApi, submit: Submit, label: str, command: Command, hint: str | None = None, **look: Any
) -> viser.GuiButtonHandle:
    """A button that always submits the same command."""
    button = gui.add_button(label, hint=hint, **look)
    button.on_click(on_client(submit, lambda: command))
    return button


def add_note(gui: viser.GuiApi, text: str) -> viser.GuiHtmlHandle:
    """A line of explanation."""
    return gui.add_html(note(text))


def note(text: str) -> str:
    """Text as a note."""
    return f'<div class="ballbot-note">{html.escape(text)}</div>'


def put(handle: Any, **values: Any) -> None:
    """Sets the properties of a control that differ; each change goes to all pages."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
