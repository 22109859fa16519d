"""The connection by which a page drives: what it may send, and that a robot whose page is gone stops."""

import contextlib
import json
import re
import time
import urllib.request

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from ballbot_rs.viewer.server import head, server, teleop  # noqa: E402
from ballbot_rs.viewer.session import Session  # noqa: E402
from ballbot_rs.viewer.view import View  # noqa: E402
from tests.support.view import query  # noqa: E402
from tests.support.waiting import LIMIT, wait_until  # noqa: E402


@pytest.fixture
def view():
    view = View(Session(task="velocity"), port=18860)
    yield view
    view.stop()
    assert view.runner.error is None


def page(view, **headers):
    address = view.url.replace("http", "ws") + teleop.PATH
    return connect(address, close_timeout=0.1, additional_headers=headers)


def command(view):
    return query(view, lambda session: session.frame().commands.values[0])


def is_by_hand(view):
    return query(view, lambda session: session.frame().commands.by_hand)


def drive_until(condition, connection, *shares):
    """Continues to send, as the page's script does, until a condition holds."""
    ends = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < ends
        connection.send(json.dumps(shares))
        time.sleep(0.05)


@pytest.mark.slow("real time")
def test_a_page_drives_while_it_sends(view):
    with page(view) as connection:
        assert connection.recv(timeout=LIMIT) == "on"
        assert not is_by_hand(view)
        drive_until(lambda: np.array_equal(command(view), [0.5, 0.0, 0.0]), connection, 1.0, 0.0, 0.0)
        # The connection stays, but nothing comes any more.
        wait_until(lambda: np.array_equal(command(view), [0.0, 0.0, 0.0]))
        assert any("nothing has come from the page" in text for text in query(view, lambda s: list(s.notices)))
        drive_until(lambda: np.array_equal(command(view), [0.0, 0.0, -1.0]), connection, 0.0, 0.0, -1.0)
    wait_until(lambda: np.array_equal(command(view), [0.0, 0.0, 0.0]))
    assert is_by_hand(view)


@pytest.mark.slow("real time")
def test_a_page_that_vanishes_stops_only_its_robot_at_once(view, monkeypatch):
    monkeypatch.setattr(teleop, "HOLD", 1e6)
    with page(view) as first, page(view) as second:
        drive_until(lambda: command(view)[0] == 0.5, first, 1.0, 0.0, 0.0)
        drive_until(lambda: command(view)[1] == 0.5, second, 0.0, 1.0, 0.0)
        first.socket.close()
        time.sleep(0.5)
        np.testing.assert_array_equal(command(view), [0.0, 0.5, 0.0])
        second.socket.close()
        wait_until(lambda: np.array_equal(command(view), [0.0, 0.0, 0.0]))


def test_pages_are_notified_whether_they_drive_and_only_drivers_drive(view):
    with page(view) as connection:
        assert connection.recv(timeout=LIMIT) == "on"
        view.runner.submit(lambda session: session.choose(task="goal"))
        assert connection.recv(timeout=LIMIT) == "off"
        connection.send("[1, 0, 0]")
        time.sleep(0.3)
        assert not is_by_hand(view)
        assert not query(view, lambda session: list(session.notices))
        view.runner.submit(lambda session: session.choose(task="velocity"))
        assert connection.recv(timeout=LIMIT) == "on"
        view.runner.submit(lambda session: (session.start_recording(), session.step(), session.replay()))
        assert connection.recv(timeout=LIMIT) == "off"


WRONG = [
    "",
    "[1, 0]",
    "[1, 0, 0, 0]",
    "[1.01, 0, 0]",
    "[NaN, 0, 0]",
    "[1e999, 0, 0]",
    "[true, 0, 0]",
    '["1", 0, 0]',
    '{"forward": 1}',
    "null",
    "[" * 5000,
    b"\xff\x00",
]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda raw: repr(raw)[:20])
def test_invalid_commands_are_dropped(wrong):
    assert teleop.message_of(wrong) is None
    assert teleop.message_of("[1, -1, 0.5]") == (1.0, -1.0, 0.5)


def test_a_page_that_sends_nonsense_is_closed_and_drives_nothing(view):
    with page(view) as connection, contextlib.suppress(ConnectionClosed):
        for _ in range(teleop.MAX_REJECTED + 10):
            connection.send("[2, 0, 0]")
        while True:
            connection.recv(timeout=LIMIT)
    assert connection.close_code == 1008
    assert not is_by_hand(view)


@pytest.mark.parametrize(
    "headers", [{"Origin": "https://evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"}]
)
def test_other_sites_do_not_drive(view, headers):
    with pytest.raises(InvalidStatus) as rejected, page(view, **headers):
        pass
    assert rejected.value.response.status_code == 403


def test_every_page_up_to_the_limit_may_connect(view, monkeypatch):
    monkeypatch.setattr(server, "MAX_CLIENTS", 2)
    with page(view) as first, page(view) as second:
        for connection in (first, second):
            assert connection.recv(timeout=LIMIT) == "on"
        with pytest.raises(InvalidStatus) as rejected, page(view):
            pass
        assert rejected.value.response.status_code == 503


def test_the_page_has_our_head_once_and_makes_no_external_requests(view):
    with urllib.request.urlopen(view.url, timeout=60) as answer:
        page = answer.read()
    own = head.head()
    assert page.count(own) == 1
    assert page.rstrip().endswith(b"</html>")
    assert page.count(b"<title>") == own.count(b"<title>") == 1
    assert own.count(b"<script>") == own.count(b"</script>") == len(head.SCRIPTS)
    assert b"https://" not in own
    assert re.findall(rb"http://[^'\"]*", own) == [b"http://www.w3.org/2000/svg"]
