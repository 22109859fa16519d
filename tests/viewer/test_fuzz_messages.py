"""Messages that no page sends: whatever passes is harmless to viser, to the session and to other clients."""

import asyncio
import math

import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")
pytest.importorskip("hypothesis", reason="nothing is fuzzed: install 'ballbot-rs[dev]'")

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from viser import GuiButtonGroupHandle
from viser._messages import Message

from ballbot_rs.viewer.server import messages
from ballbot_rs.viewer.session import Session
from ballbot_rs.viewer.session.setup import CHANGES
from ballbot_rs.viewer.view import View
from tests.support.fuzzing import budget, numbers, values
from tests.support.view import CAMERA, CLICK, DRAG, connect, packed, query
from tests.support.waiting import wait_until


@pytest.fixture(scope="module")
def view():
    view = View(Session(), port=18890)
    with connect(view.url.replace("http", "ws"), max_size=None, close_timeout=0.1) as client:
        client.send(packed(**CAMERA))
        wait_until(lambda: view.server.get_clients())
        yield view
    view.stop()
    assert view.runner.error is None


def is_finite(value):
    if isinstance(value, float):
        return math.isfinite(value) and abs(value) <= 1e6
    if isinstance(value, dict):
        return all(map(is_finite, value.values()))
    return all(map(is_finite, value)) if isinstance(value, list | tuple) else True


def check(view, raw):
    """Hands a message that passes to viser, as its server does."""
    message = messages.accepted(raw, view.server.controls)
    if message is None:
        return False
    assert is_finite(msgspec.to_builtins(message))
    parsed = Message.deserialize(messages.encoded(message))
    (identifier,) = view.server.get_clients()
    server = view.server._websock_server
    for handler in (server, view.server.get_clients()[identifier]._websock_connection):
        done = asyncio.run_coroutine_threadsafe(
            handler._handle_incoming_message(identifier, parsed), view.server._event_loop
        )
        done.result(5.0)
    return True


def check_unharmed(view, capfd):
    """The simulation runs, nothing was printed, and what later clients get is finite."""
    before = query(view, lambda session: session.reset() or session.time)
    wait_until(lambda: query(view, lambda session: session.paused) or query(view, lambda s: s.time) > before)
    for message in list(view.server._websock_server._broadcast_buffer.message_from_id.values()):
        if type(message).__name__ in ("GuiUpdateMessage", "SetPositionMessage"):
            assert is_finite(message.as_serializable_dict())
    assert capfd.readouterr() == ("", "")


@budget(500)
@given(raw=st.one_of(st.binary(max_size=300), st.text(max_size=50), values.map(msgspec.msgpack.encode)))
def test_arbitrary_bytes_are_not_messages(view, raw):
    assert not check(view, raw)


def edited(template):
    """A message with some parts replaced, left out, or added; half of them numbers for numbers."""
    places = st.sampled_from([key for key in template if key != "type"] + ["more"])
    shares = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=3)
    entries = st.one_of(values, st.lists(numbers, min_size=2, max_size=4), numbers, shares)
    return st.dictionaries(places, entries, max_size=2).map(lambda changes: packed(**{**template, **changes}))


def test_edited_messages_of_the_scene_do_no_harm(view, capfd):
    passed = []

    @budget(600)
    @given(raw=st.one_of(*map(edited, (CAMERA, CLICK, DRAG))))
    def feed(raw):
        passed.append(check(view, raw))

    feed()
    assert 10 < passed.count(True) < len(passed) - 100
    check_unharmed(view, capfd)


def near(handle):
    """Values that a control accepts, or nearly accepts."""
    if hasattr(handle, "min"):
        # The range of the recording's slider grows; fractions of it do not.
        return st.floats(-0.2, 1.2).map(lambda share: handle.min + share * (handle.max - handle.min))

    def choice(i):
        # The options of some controls follow the task; the number does not.
        choices = [handle.value, True, False, "lqr", *getattr(handle, "options", ())]
        return choices[i % len(choices)]

    return st.integers(0, 999).map(choice)


@pytest.mark.slow("fuzzes all controls")
def test_values_of_controls_do_no_harm(view, capfd):
    handles = sorted(view.server.controls.values(), key=lambda handle: handle.order)
    # No policy is loaded in the name of another test, and nothing waits in a replay or a pause.
    candidates = [handle for handle in handles if handle.label not in ("Time", "Replay", "Policy file")]
    assert {change.label for change in CHANGES.values()} <= {handle.label for handle in candidates}
    others = st.dictionaries(st.sampled_from(["value", "visible", "min", "label", "__class__"]), values, max_size=2)

    def updates(handle):
        value = st.one_of(near(handle), near(handle), values, numbers)
        return st.tuples(st.just(handle), st.one_of(value.map(lambda v: {"value": v}), others))

    passed = []

    @budget(600)
    @given(update=st.sampled_from(candidates).flatmap(updates))
    def feed(update):
        handle, changes = update
        passed.append(check(view, packed(type="GuiUpdateMessage", uuid=handle._impl.uuid, updates=changes)))

    feed()
    assert 50 < passed.count(True) < len(passed) - 100
    for handle in handles:
        assert is_finite(handle.value)
        if hasattr(handle, "min"):
            assert handle.min <= handle.value <= handle.max
        # The value of a group of buttons is the last button, which the present task may not have.
        if hasattr(handle, "options") and not isinstance(handle, GuiButtonGroupHandle):
            assert handle.value in handle.options
    for name, value in query(view, lambda session: session.changes).items():
        assert CHANGES[name].low <= value <= CHANGES[name].high
    check_unharmed(view, capfd)
