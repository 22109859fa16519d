"""What the firmware does where something goes wrong: frame by frame against QEMU."""

import math
import time

import numpy as np
import pytest

from ballbot_rs.link.channel import Channel
from ballbot_rs.link.frames import WRAP, Frame, encode
from ballbot_rs.link.layout import READINGS, Flag, Kind, Status
from ballbot_rs.link.statistics import Statistics
from ballbot_rs.link.transports import connect
from validation.firmware import qemu

pytestmark = pytest.mark.slow("compiles the firmware and runs QEMU")

#: Of a control step, µs, and the steps whose readings may be missing.
PERIOD = 10_000
LOST = 3
#: Longest wait for an answer, s.
DEADLINE = 10.0
#: A controller with memory, and a watchdog that waits for slow tests.
PATIENT = {"CONTROLLER": "cascade_pid", "WATCHDOG_MS": 60_000}
#: At rest, with the setpoint 0.1 m away.
REST = {"specific_force": (0.0, 0.0, 9.81), "position": (0.1, 0.0)}


class Board:
    """The firmware in QEMU, frame by frame."""

    def __init__(self, elf, monitor=None):
        self._transport = connect(qemu.address(elf, "netduinoplus2", monitor=monitor))
        self._channel = Channel(self._transport, Kind.TORQUES, Statistics())
        #: The frame that it sends when it is up.
        self.first = self.receive()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._channel.close()

    def receive(self, seconds=DEADLINE):
        """The next frame; None without one."""
        return self._channel.receive(time.perf_counter() + seconds)

    def send(self, step, flags=0, **readings):
        """Sends the readings of a step: of a robot at rest, except for the given ones."""
        self._channel.send(self.frame(step, flags, **readings))

    def send_bytes(self, wire):
        """Sends bytes as they are."""
        self._transport.send(wire)

    @staticmethod
    def frame(step, flags=0, **readings):
        """READINGS of a step."""
        parts = {**REST, **readings}
        numbers = np.concatenate([np.broadcast_to(parts.get(field.name, 0.0), field.length) for field in READINGS])
        return Frame(Kind.READINGS, flags, step % WRAP, step * PERIOD % WRAP, tuple(numbers.tolist()))

    def ask(self, step, flags=0, **readings):
        """Status and torques that answer readings."""
        self.send(step, flags, **readings)
        answer = self.receive()
        assert (answer.sequence, answer.time) == (step % WRAP, step * PERIOD % WRAP)
        return Status(answer.flags), np.array(answer.numbers)

    def begin(self, step=0):
        """Begins an episode; returns its first torques."""
        status, torques = self.ask(step, Flag.RESET)
        assert status == Status.RUNNING
        assert np.abs(torques).max() > 0.01
        return torques


def is_zero(answer, status):
    """Whether an answer has this status and no torque."""
    found, torques = answer
    return found == status and not torques.any()


@pytest.fixture
def board(built):
    """A board that has just been switched on."""
    with Board(built(**PATIENT)) as running:
        yield running


def test_there_is_no_torque_before_the_first_episode(board):
    assert (board.first.flags, board.first.sequence, board.first.numbers) == (
        Status.STARTING,
        WRAP - 1,
        (0.0, 0.0, 0.0),
    )
    # Nothing more without readings.
    assert board.receive(0.3) is None
    # It was switched on in the middle of an episode.
    for step in range(3):
        assert is_zero(board.ask(step), Status.STARTING)
    board.begin(3)


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81)])
def test_an_episode_does_not_begin_without_an_attitude(board, force):
    board.begin()
    assert is_zero(board.ask(1, Flag.RESET, specific_force=force), Status.STARTING)
    assert is_zero(board.ask(2), Status.STARTING)
    board.begin(3)


def test_clock_and_sequence_may_wrap(board):
    """2^32 is not a multiple of the step: the clock wraps within it."""
    gyro = np.random.default_rng(0).normal(0.0, 0.01, (20, 3))
    runs = []
    for first in (0, WRAP // PERIOD - 10, WRAP - 10):
        answers = [(Status.RUNNING, board.begin(first))]
        answers += [board.ask(first + i, gyro=rates) for i, rates in enumerate(gyro, start=1)]
        assert all(status == Status.RUNNING for status, _ in answers)
        runs.append([torques for _, torques in answers])
    np.testing.assert_array_equal(runs[1:], [runs[0]] * 2)


@pytest.mark.parametrize("reading", ["gyro", "specific_force", "wheel_angles", "position", "yaw_rate"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_readings_that_are_not_finite_give_no_torque_and_are_bridged(board, reading, value):
    board.begin()
    for step in range(1, 1 + LOST):
        assert is_zero(board.ask(step, **{reading: value}), Status.NOT_FINITE)
    status, torques = board.ask(1 + LOST)
    assert status == Status.RUNNING
    assert np.isfinite(torques).all()
    assert torques.any()


def test_too_many_readings_that_are_not_finite_end_the_episode(board):
    first = board.begin()
    for step in range(1, 2 + LOST):
        assert is_zero(board.ask(step, gyro=math.nan), Status.NOT_FINITE)
    for step in range(2 + LOST, 5 + LOST):
        assert is_zero(board.ask(step), Status.STALE)
    # An episode does not begin with such readings.
    assert is_zero(board.ask(20, Flag.RESET, gyro=math.nan), Status.NOT_FINITE)
    assert is_zero(board.ask(21), Status.STARTING)
    np.testing.assert_array_equal(board.begin(22), first)


def test_lost_frames_are_bridged_and_the_wheels_keep_their_rates(built):
    """Wheels that turn uniformly: missing readings change no estimate, and no torque of a law without memory."""
    turned = np.array([0.0002, -0.0001, 0.0003])
    with Board(built(WATCHDOG_MS=60_000)) as board:

        def run(first, steps):
            board.begin(first)
            return [board.ask(first + step, wheel_angles=step * turned) for step in steps]

        whole, holey = run(0, range(1, 12)), run(1000, [1, 2, 3, 7, 8, 11])
        assert all(status == Status.RUNNING for status, _ in holey)
        np.testing.assert_allclose(holey[-1][1], whole[-1][1], atol=1e-9)
        assert is_zero(board.ask(1011 + LOST + 2), Status.STALE)


def test_motors_heat_also_where_readings_are_missing(built):
    """A torque beyond what a motor can have forever falls at the same time if only every fourth reading arrives."""
    limits = "continuous_torque=0.02 heating_time=0.5"
    with Board(built(WATCHDOG_MS=60_000, LIMITS=limits)) as board:
        first = np.abs(board.begin()).max()
        whole = {step: board.ask(step)[1] for step in range(1, 121)}
    # Cold motors: only a reset of the board has them.
    with Board(built(WATCHDOG_MS=60_000, LIMITS=limits)) as board:
        board.begin()
        for step in range(1 + LOST, 121, 1 + LOST):
            status, torques = board.ask(step)
            assert status == Status.RUNNING
            np.testing.assert_allclose(torques, whole[step], rtol=1e-9, atol=1e-12)
    assert np.abs(torques).max() < 0.5 * first


def test_repeated_readings_are_answered_again_without_a_step(board):
    board.begin()
    once = board.ask(1, gyro=(0.01, 0.0, 0.0))
    for _ in range(3):
        again = board.ask(1, gyro=(0.01, 0.0, 0.0))
        assert again[0] == once[0]
        np.testing.assert_array_equal(again[1], once[1])
    assert board.ask(2)[0] == Status.RUNNING


def test_late_readings_are_ignored(board):
    board.begin()
    for step in range(1, 6):
        board.ask(step)
    board.send(3, gyro=(0.5, 0.0, 0.0))
    board.send(0, Flag.RESET)
    assert board.receive(0.3) is None
    assert board.ask(6)[0] == Status.RUNNING


def test_damaged_frames_are_not_answered(board):
    board.begin()
    wire = bytearray(encode(Board.frame(1)))
    wire[40] ^= 4
    board.send_bytes(bytes(wire))
    # Torques are of the simulation's side.
    board.send_bytes(encode(Frame(Kind.TORQUES, 0, 1, PERIOD, (1.0, 2.0, 3.0))))
    board.send_bytes(bytes(range(1, 256)) * 20 + b"\0")
    assert board.receive(0.3) is None
    assert board.ask(2)[0] == Status.RUNNING


def test_a_robot_that_falls_gets_torques_that_fall_to_zero_until_the_next_episode(board):
    """Faster than 2.6 rad/s, which the paper's robot recovers from; it topples with the time constant 0.164 s."""
    board.begin()
    answers = [board.ask(step, gyro=(3.0, 0.0, 0.0)) for step in range(1, 40)]
    tripped = [status == Status.LIMIT for status, _ in answers]
    # Half of that time later.
    first = tripped.index(True)
    assert 7 <= first <= 9
    assert all(tripped[first:])
    assert np.abs(answers[first + 1][1]).max() > np.abs(answers[first + 12][1]).max() > 0.0
    assert all(is_zero(answer, Status.LIMIT) for answer in answers[first + 16 :])
    assert is_zero(board.ask(40), Status.LIMIT)
    board.begin(41)


def test_a_simulation_that_stops_leaves_no_torque(board):
    board.begin()
    assert is_zero(board.ask(1, Flag.STOP), Status.STARTING)
    assert is_zero(board.ask(2), Status.STARTING)


def test_a_reset_of_the_board_loses_the_state_and_gives_no_torque(built, tmp_path):
    """A brown-out: the robot moved in between, the memory is not kept."""
    monitor = tmp_path / "monitor"
    with Board(built(**PATIENT), monitor) as board:
        first = board.begin()
        for step in range(1, 20):
            board.ask(step, gyro=(0.02, 0.0, 0.0))
        # In the middle of a frame.
        board.send_bytes(encode(Board.frame(20))[:50])
        qemu.command(monitor, "system_reset")
        up = board.receive()
        assert (up.flags, up.numbers) == (Status.STARTING, (0.0, 0.0, 0.0))
        # What was left of the frame on the line may have come after the reset; a link would repeat its readings.
        board.send_bytes(b"\0")
        for step in range(21, 25):
            assert is_zero(board.ask(step), Status.STARTING)
        np.testing.assert_array_equal(board.begin(25), first)


def test_the_watchdog_ends_torques_where_readings_stop(built):
    milliseconds = 100
    with Board(built(WATCHDOG_MS=milliseconds)) as board:
        board.begin()
        began = time.perf_counter()
        stale = board.receive()
        assert (stale.flags, stale.sequence, stale.numbers) == (Status.STALE, 0, (0.0, 0.0, 0.0))
        # QEMU's clock is the computer's: not early.
        assert time.perf_counter() - began > 0.9e-3 * milliseconds
        assert board.receive(0.3) is None
        assert is_zero(board.ask(1), Status.STALE)
        board.begin(2)


def test_the_watchdog_also_ends_torques_that_are_falling(built):
    with Board(built(WATCHDOG_MS=100)) as board:
        board.begin()
        answers = [board.ask(step, gyro=(3.0, 0.0, 0.0)) for step in range(1, 12)]
        assert answers[-1][0] == Status.LIMIT
        assert answers[-1][1].any()
        stale = board.receive()
        assert (stale.flags, stale.numbers) == (Status.STALE, (0.0, 0.0, 0.0))
