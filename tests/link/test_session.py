"""A linked robot on the page."""

import pytest

import ballbot_rs as bb
from ballbot_rs.control.resolve import find
from ballbot_rs.link.frames import Frame, encode
from ballbot_rs.link.layout import Flag, Kind
from ballbot_rs.viewer.session import Session
from tests.support.links import Board, Damping, free_address, serving


def zero(frame):
    return [encode(Frame(Kind.TORQUES, 0, frame.sequence, frame.time, (0.0, 0.0, 0.0)))]


def test_robot_of_a_session_is_driven_over_the_link():
    seen, board = [], Board()

    def answer(frame):
        seen.append(frame)
        return zero(frame)

    with board.answering(answer), bb.Link(board.address) as link:
        session = Session(controller=find(link))
        for _ in range(20):
            session.step()
        session.reset()
        session.step()
    # Nothing but the steps of the robot went out, in two episodes.
    assert len(seen) == link.statistics.answered == 21
    assert [i for i, frame in enumerate(seen) if frame.flags & Flag.RESET] == [0, 20]
    assert session.observation == "sensors"
    assert session.driver.reads_sensors


def test_setpoint_of_the_page_goes_to_the_controller():
    seen, board = [], Board()

    def answer(frame):
        seen.append(frame)
        return zero(frame)

    with board.answering(answer), bb.Link(board.address) as link:
        session = Session(controller=find(link))
        session.step()
        session.move_setpoint(0.3, -0.2)
        session.step()
    assert seen[0].numbers[9:11] == (0.0, 0.0)
    x, y = seen[1].numbers[9:11]
    assert x > 0 > y


def test_tasks_of_the_page_command_the_controller():
    address = free_address()
    with serving(Damping(), address), bb.Link(address) as link:
        session = Session(controller=find(link), task="velocity")
        for _ in range(5):
            session.step()
        assert link.statistics.answered == 5


def test_silent_controller_is_an_error_of_the_step():
    with bb.Link(free_address(), connect=0.2) as link, pytest.raises(bb.ControllerError, match="no torques from udp:"):
        Session(controller=find(link)).step()


def test_link_drives_one_robot_of_a_page():
    with pytest.raises(TypeError, match="a link drives one robot"):
        Session(controller=find(bb.Link(free_address())), num_robots=2)


@pytest.mark.parametrize("address", ["exec:touch /tmp/never", "udp://127.0.0.1:9", "serial:/dev/null"])
def test_page_cannot_name_an_address(address):
    with pytest.raises(ValueError, match="unknown controller"):
        Session(controller=address)
