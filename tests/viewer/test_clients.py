"""Clients of the page that are not browsers, or are hostile."""

import contextlib
import html
import math
import os
import socket
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

import msgspec  # noqa: E402
import zstandard  # noqa: E402
from websockets.datastructures import Headers  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402

from ballbot_rs import Params  # noqa: E402
from ballbot_rs.viewer.server import messages, server  # noqa: E402
from ballbot_rs.viewer.server.server import is_own, rejection  # noqa: E402
from ballbot_rs.viewer.session import Session  # noqa: E402
from ballbot_rs.viewer.session.setup import CHANGES, NEUTRAL  # noqa: E402
from ballbot_rs.viewer.view import View  # noqa: E402
from tests.support.view import CAMERA, CLICK, DRAG, connect, packed, query  # noqa: E402
from tests.support.waiting import wait_until  # noqa: E402


@pytest.fixture(scope="module")
def view():
    view = View(Session(), port=18830)
    yield view
    view.stop()
    assert view.runner.error is None


@contextlib.contextmanager
def client(view):
    address = view.url.replace("http", "ws")
    with connect(address, max_size=None, close_timeout=0.1) as connection:
        connection.send(packed(**CAMERA))
        yield connection


def control(view, label):
    return next(handle for handle in view.server.controls.values() if handle.label == label)


def update(handle, value):
    return packed(type="GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})


WRONG = [
    ("Push by (N·s)", 1e308),
    ("Push by (N·s)", -1e308),
    ("Push by (N·s)", math.nan),
    ("Push by (N·s)", math.inf),
    ("Push by (N·s)", 6.8),
    ("Push by (N·s)", True),
    ("Push by (N·s)", "1.0"),
    ("Push by (N·s)", None),
    ("Push by (N·s)", [1.0]),
    ("Push to (deg)", 2**63),
    ("Speed (×)", 0.0),
    ("Trail", 1.0),
    ("Trail", "yes"),
    ("Time", "Stop"),
    ("Time", True),
    ("Model", "flat"),
    ("Robot", 3),
    ("Robots", "1e9"),
    ("Controller sees", "sensors"),
    ("Policy file", 5),
    ("Policy file", "x" * 2000),
    ("Replay at (s)", -1.0),
    ("Push", "now"),
]


#: Values that no slider of the robot accepts.
NO_NUMBERS = [math.nan, math.inf, -math.inf, 1e308, -1e308, 2**63, True, "1", None, [1.0], {"value": 1.0}]


@pytest.mark.parametrize(("label", "value"), WRONG)
def test_a_value_that_a_control_cannot_have_does_not_enter_it(view, label, value):
    handle = control(view, label)
    assert messages.accepted(update(handle, value), view.server.controls) is None


def test_only_valid_values_reach_other_clients(view):
    """A value of 1e308 in a control dropped every client that came later."""
    handle = control(view, "Push by (N·s)")
    before = handle.value
    with client(view) as sender:
        wait_until(lambda: view.server.get_clients())
        for value in (1e308, math.nan, "x", None):
            sender.send(update(handle, value))
        sender.send(packed(**{**DRAG, "end_position": [1e308] * 3}))
        sender.send(packed(**{**CAMERA, "position": [1e308, 0, 0]}))
        sender.send(update(control(view, "Speed (×)"), 0.5))
        wait_until(lambda: query(view, lambda session: session.speed) == 0.5)
        sender.send(update(control(view, "Speed (×)"), 1))
        wait_until(lambda: query(view, lambda session: session.speed) == 1.0)
        assert handle.value == before
    with client(view) as later:
        # All of the page comes, and can be read.
        assert any(part["type"] == "GuiSliderMessage" for part in everything(later))


@pytest.mark.parametrize("name", CHANGES)
def test_sliders_of_the_robot_accept_only_their_range(view, name):
    change = CHANGES[name]
    handle = control(view, change.label)
    for value in (change.low, change.neutral, change.high, 0.5 * (change.low + change.high)):
        assert messages.accepted(update(handle, value), view.server.controls) is not None
    for value in (*NO_NUMBERS, change.low - 1e-6, change.high + 1e-6):
        assert messages.accepted(update(handle, value), view.server.controls) is None


def moved(view, client, name, value):
    """The changes of the session after a client moves a slider, once the page shows them."""
    handle = control(view, CHANGES[name].label)
    client.send(update(handle, value))
    wait_until(lambda: handle.value == value)
    wait_until(lambda: query(view, lambda session: session.changes)[name] == handle.value)
    return query(view, lambda session: session.changes)


def test_sliders_change_the_running_robot_and_a_button_restores_it(view):
    query(view, lambda session: session.reset())
    with client(view) as sender:
        wait_until(lambda: view.server.get_clients())
        expected = {name: change.neutral for name, change in CHANGES.items()}
        for name, value in (("body_mass", 1.3), ("com_x", -4.0), ("motor_delay", 20.0), ("wheel_friction", 0.8)):
            expected[name] = value
            assert moved(view, sender, name, value) == expected
        params = query(view, lambda session: session.robots[0].params)
        assert params.body_mass == pytest.approx(1.3 * params.paper().body_mass)
        # The table follows each change with the next frame.
        wait_until(lambda: "| delay | | 0.02 | |" in view._page._parameters._table.content)
        assert "| body_mass | 2.228 | 2.896 |  |" in view._page._parameters._table.content
        sender.send(update(control(view, "Nominal robot"), True))
        wait_until(lambda: query(view, lambda session: session.changes) == dict(NEUTRAL))
        wait_until(lambda: all(control(view, CHANGES[name].label).value == NEUTRAL[name] for name in CHANGES))
        assert query(view, lambda session: session.robots[0].params) == params.paper()


def test_what_the_controller_sees_is_chosen_and_plotted(view):
    with client(view) as sender:
        wait_until(lambda: view.server.get_clients())
        sender.send(update(control(view, "Controller sees"), "estimate"))
        wait_until(lambda: query(view, lambda session: session.observation) == "sensors")
        assert moved(view, sender, "sensor_noise", 5.0)["sensor_noise"] == 5.0
        wait_until(lambda: "| encoder_ticks | | 7.1e+04 | |" in view._page._parameters._table.content)
        chart = next(chart for chart in view._page._plots._charts if chart._plot.row == "tilt")
        wait_until(lambda: "estimate" in chart._legend.content)
        wait_until(lambda: (np.array(chart._handle.data[1:3]) != np.array(chart._handle.data[3:5])).any())
        assert all("dash" in style for style in chart._handle.series[3:5])
        sender.send(update(control(view, "Controller sees"), "true state"))
        wait_until(lambda: query(view, lambda session: session.observation) == "ground_truth")
        sender.send(update(control(view, "Nominal robot"), True))
        wait_until(lambda: query(view, lambda session: session.changes) == dict(NEUTRAL))


def test_an_invalid_robot_is_rejected_with_the_reason_and_the_slider_returns(view):
    """Both values are within the sliders; the center of mass is then off the wheels."""
    query(view, lambda session: session.reset())
    with client(view) as sender:
        wait_until(lambda: view.server.get_clients())
        moved(view, sender, "com_height", 0.5)
        before = query(view, lambda session: (session.time, session.changes))
        sender.send(update(control(view, CHANGES["com_x"].label), 100.0))
        wait_until(lambda: query(view, lambda session: bool(session.notices)))
        notice = query(view, lambda session: session.notices[-1])
        assert notice.startswith("the load of wheel 1 in equilibrium = -")
        wait_until(lambda: html.escape(notice) in view._page._status._html.content)
        wait_until(lambda: control(view, CHANGES["com_x"].label).value == 0.0)
        assert query(view, lambda session: session.changes) == before[1]
        wait_until(lambda: query(view, lambda session: session.time) > before[0] + 0.1)
        sender.send(update(control(view, "Nominal robot"), True))
        wait_until(lambda: query(view, lambda session: session.changes) == dict(NEUTRAL))
    query(view, lambda session: session.notices.clear())


def test_a_slider_that_moves_stays_while_another_change_is_shown(view):
    """The page took the slider back before the session had its value."""
    com_height = control(view, CHANGES["com_height"].label)

    def busy(session):
        session.change(body_mass=1.2)
        wait_until(lambda: com_height.value == 0.5)
        view._page._parameters.show(session)
        return com_height.value

    with client(view) as sender:
        wait_until(lambda: view.server.get_clients())
        sender.send(update(com_height, 0.5))
        assert query(view, busy) == 0.5
        wait_until(lambda: query(view, lambda session: session.changes)["com_height"] == 0.5)
        assert control(view, CHANGES["body_mass"].label).value == 1.2
        sender.send(update(control(view, "Nominal robot"), True))
        wait_until(lambda: query(view, lambda session: session.changes) == dict(NEUTRAL))


def everything(connection):
    """What a new client gets within a second."""
    found = []
    with contextlib.suppress(TimeoutError):
        for _ in range(30):
            found.extend(decoded(connection.recv(timeout=1.0)))
    return found


def decoded(raw):
    """The messages of a frame of viser: two sizes of 8 bytes, and what zstd has made of the messages."""
    size = int.from_bytes(raw[8:16], "little")
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size]))["messages"]


@pytest.mark.parametrize(
    "edit",
    [
        {"wxyz": [0.0, 0.0, 0.0, 0.0]},
        {"wxyz": [1.0, 0.0, 0.0]},
        {"fov": 0.0},
        {"fov": 4.0},
        {"image_width": 0},
        {"image_height": math.inf},
        {"near": -1.0},
        {"look_at": [1.0, 1.0, 1.0]},
        {"look_at": [1.0, 1.0, 5.0]},
        {"up_direction": [0, 0, 0]},
        {"position": [math.nan, 0.0, 0.0]},
        {"position": [1e308, 0.0, 0.0]},
        {"more": 1},
        {"type": "ShareUrlRequest"},
        {"type": "NoSuchMessage"},
        {"type": 3},
    ],
)
def test_a_camera_that_sees_nothing_is_dropped(edit):
    assert messages.accepted(packed(**CAMERA), {}) is not None
    assert messages.accepted(packed(**{**CAMERA, **edit}), {}) is None


def test_uploads_are_rejected(view):
    button = control(view, "Push")
    start = packed(
        type="FileTransferStart",
        source_component_uuid=button._impl.uuid,
        transfer_uuid="1",
        filename="x",
        mime_type="text/plain",
        part_count=1,
        size_bytes=10**9,
    )
    part = packed(
        type="FileTransferPart", source_component_uuid=button._impl.uuid, transfer_uuid="1", part=0, content=b"x" * 100
    )
    assert messages.accepted(start, view.server.controls) is None
    with client(view) as sender:
        for message in (start, part):
            sender.send(message)
        sender.send(update(control(view, "Time"), "Pause"))
        wait_until(lambda: query(view, lambda session: session.paused))
        # The pause button is then the continue button.
        wait_until(lambda: "Continue" in control(view, "Time").options)
        sender.send(update(control(view, "Time"), "Continue"))
        wait_until(lambda: not query(view, lambda session: session.paused))
    assert not view.server.gui._current_file_upload_states


def is_closed(connection):
    """Whether the server ends a connection within a while."""
    try:
        for _ in range(1000):
            connection.recv(timeout=60.0)
    except ConnectionClosed:
        return True
    except TimeoutError:
        pass
    return False


def test_a_flood_of_malformed_messages_ends_the_connection_and_prints_nothing(view, capfd):
    for garbage in (b"\xff\x00garbage", b"", "text", b"\x81\xa4type\xa7NoSuchM", b"\xc1" * 1000, b"\x91" * 15_000):
        with client(view) as sender:
            with contextlib.suppress(ConnectionClosed):
                for _ in range(server.MAX_REJECTED + 1):
                    sender.send(garbage)
            assert is_closed(sender)
    # Larger than any message of the page; and bytes that are not a handshake.
    with client(view) as sender:
        with contextlib.suppress(ConnectionClosed):
            sender.send(b"\0" * (messages.MAX_MESSAGE + 1))
        assert is_closed(sender)
    for noise in (b"\0" * 100 + b"\r\n\r\n", b"GET\r\n\r\n", b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", view.server.get_port()), timeout=60) as raw:
            raw.sendall(noise)
            with contextlib.suppress(OSError):
                raw.recv(1000)
    # A click before the first camera, with which viser could not name the client.
    with connect(view.url.replace("http", "ws"), max_size=None, close_timeout=0.1) as sender:
        sender.send(packed(**CLICK))
    before = query(view, lambda session: session.time)
    wait_until(lambda: query(view, lambda session: session.time) > before + 0.3)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


@pytest.mark.slow("many clients")
def test_clients_beyond_the_limit_are_rejected_with_the_reason_and_leave_nothing(view):
    wait_until(lambda: not view.server._clients)
    address = view.url.replace("http", "ws")
    with contextlib.ExitStack() as stack:
        for _ in range(server.MAX_CLIENTS):
            stack.enter_context(client(view))
        wait_until(lambda: len(view.server.get_clients()) == server.MAX_CLIENTS)
        for _ in range(50):
            with pytest.raises(InvalidStatus, match="503"), connect(address):
                pass
        with pytest.raises(urllib.error.HTTPError) as rejected:
            urllib.request.urlopen(view.url, timeout=60)
        assert rejected.value.code == 503
        assert (
            rejected.value.read().decode() == "16 pages of this server are open already, which is the limit: close one"
        )
    wait_until(lambda: not view.server.get_clients() and not view.server._clients)
    assert not view.server._websock_server._client_state_from_id
    with client(view):
        wait_until(lambda: len(view.server.get_clients()) == 1)


@pytest.mark.slow("200 clients")
@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="reads the memory of Linux")  # noqa: PTH110
def test_two_hundred_clients_use_bounded_memory(view):
    def megabytes():
        with open("/proc/self/statm") as file:  # noqa: PTH123
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    address = view.url.replace("http", "ws")
    before = megabytes()
    with contextlib.ExitStack() as stack:
        for _ in range(200):
            with contextlib.suppress(InvalidStatus):
                # They read nothing.
                stack.enter_context(connect(address, max_size=None, close_timeout=0.1, max_queue=1)).send(
                    packed(**CAMERA)
                )
        # Four times what it was measured to take; without the limit it was 1 GB.
        assert megabytes() - before < 250.0
    wait_until(lambda: not view.server._clients)


GOOD = ["127.0.0.1:8080", "localhost", "localhost:1", "LOCALHOST:65535", "[::1]:9000"]
BAD = [
    "evil.example",
    "evil.example@127.0.0.1",
    "127.0.0.1@evil.example",
    "127.0.0.1:8080@evil.example",
    "127.0.0.1.evil.example",
    "localhost.evil.example",
    "localhost.",
    "localhost:",
    "localhost:0",
    "localhost:65536",
    "localhost:-1",
    "localhost:80:80",
    "localhost/",
    "localhost#",
    "localhost?x",
    " localhost",
    "localhost\t",
    "127.1",
    "0.0.0.0",
    "0x7f000001",
    "::1",
    "[::1",
    "[::1%lo]",
    "null",
    "",
]


@pytest.mark.parametrize("host", GOOD)
def test_our_names_pass(host):
    assert rejection("/", Headers({"Host": host})) is None
    for scheme in ("http", "https"):
        assert rejection("/", Headers({"Host": host, "Origin": f"{scheme}://{host}"})) is None


@pytest.mark.parametrize("host", BAD)
def test_other_forms_of_names_are_rejected(host):
    assert rejection("/", Headers({"Host": host})) is not None
    assert rejection("/", Headers({"Host": "localhost:8080", "Origin": f"http://{host}"})) is not None


@pytest.mark.parametrize("host", ["localhost:٨٠", "localhost\n", "127.0.0.1\0", "127.0.0.1\r\nX: y"])
def test_names_that_no_header_can_have_are_not_ours(host):
    assert not is_own(host)


def test_missing_double_and_foreign_headers_are_rejected():
    own = ("Host", "localhost:8080")
    for headers in (
        [],
        [own, own],
        [own, ("Origin", "http://localhost:8080"), ("Origin", "http://localhost:8080")],
        [own, ("Origin", "null")],
        [own, ("Origin", "localhost:8080")],
        [own, ("Origin", "file://localhost:8080")],
        [own, ("Origin", "http://localhost:8080/")],
        [own, ("Origin", "http://user@localhost:8080")],
        # Another page of this machine.
        [own, ("Origin", "http://localhost:3000")],
        [own, ("Origin", "http://127.0.0.1:8080")],
    ):
        assert rejection("/", Headers(headers)) == "this server is only for this machine"


def test_a_page_that_ends_within_a_frame_prints_nothing(recwarn):
    ending = View(Session(), port=18835)
    showing, ended = threading.Event(), threading.Event()
    show = ending._page.show

    def slow(session, frame):
        showing.set()
        ended.wait(60.0)
        ending.server.scene.add_frame("/late")
        show(session, frame)

    ending._page.show = slow
    assert showing.wait(60.0)
    ending.stop()
    ended.set()
    wait_until(lambda: not ending.runner.running)
    assert ending.runner.error is None
    assert not [str(warning.message) for warning in recwarn]


def test_a_page_that_is_closed_while_its_camera_is_set_prints_nothing(view, recwarn):
    with client(view):
        wait_until(lambda: view.server.get_clients())
        (handle,) = view.server.get_clients().values()
    wait_until(lambda: not view.server.get_clients())
    view._page._frame(handle)
    assert not [str(warning.message) for warning in recwarn]


def test_the_memory_of_pages_that_are_closed_is_given_back(view, monkeypatch):
    given_back = []
    monkeypatch.setattr(server, "give_back_memory", lambda: given_back.append(len(view.server._clients)))
    with client(view), client(view):
        wait_until(lambda: len(view.server.get_clients()) == 2)
    wait_until(lambda: given_back[-1:] == [0])


def test_a_request_without_a_host_is_rejected_on_the_wire(view):
    with socket.create_connection(("127.0.0.1", view.server.get_port()), timeout=60) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n")
        assert raw.recv(1000).startswith(b"HTTP/1.1 403")


def test_the_largest_push_topples_the_robot_that_is_chosen(view):
    handle = control(view, "Push by (N·s)")
    assert handle.max == pytest.approx(6.7)
    query(view, lambda session: session.choose(robot="kugle"))
    wait_until(lambda: handle.max == pytest.approx(48.5))
    assert messages.accepted(update(handle, 45.0), view.server.controls) is not None
    query(view, lambda session: session.push(0.0, 45.0))
    wait_until(lambda: query(view, lambda session: session.robots.fallen.any()))
    # Other tests have the same page.
    query(view, lambda session: session.choose(robot="paper"))
    query(view, lambda session: session.reset())


def test_the_page_of_a_robot_of_some_grams_opens():
    """Its largest push is below the first value of the slider."""
    given = Params.paper()
    scale = 0.01 / given.body_mass
    masses = ("body_mass", "ball_mass", "ball_inertia", "wheel_mass", "wheel_inertia")
    inertia = [scale * one for one in given.body_inertia]
    light = given.replace(**{name: scale * getattr(given, name) for name in masses}, body_inertia=inertia)
    page = View(Session(robot="light", params=light), port=18831)
    try:
        handle = control(page, "Push by (N·s)")
        assert 0.0 < handle.value <= handle.max == pytest.approx(0.1)
    finally:
        page.stop()
