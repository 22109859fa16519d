import time

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.link.frames import Frame, encode
from ballbot_rs.link.layout import Kind
from ballbot_rs.link.statistics import Statistics
from tests.support.links import Board, Damping, free_address, serving


def reply(frame, torques=(0.1, 0.0, 0.0)):
    return encode(Frame(Kind.TORQUES, 0, frame.sequence, frame.time, torques))


def test_steps_are_not_faster_than_the_clock():
    address = free_address()
    with serving(Damping(), address), bb.Link(address, real_time=True) as link:
        began = time.perf_counter()
        bb.simulate(link, sensors="exact", seconds=0.5, tilt=(0.0, 0.0))
        assert time.perf_counter() - began >= 0.49
    counts = link.statistics
    assert counts.steps == counts.answered + counts.held + counts.zeroed == 50
    assert len(counts.delays) == 49
    assert min(counts.delays) >= 0.0


def test_deadline_that_is_missed_holds_and_is_counted():
    """Answers after two periods come too late, whatever the machine does."""
    board, begun = Board(), []

    def answer(frame):
        if begun:
            time.sleep(0.1)
        begun.append(frame)
        return [reply(frame)]

    with board.answering(answer), bb.Link(board.address, real_time=True, hold=3, control_dt=0.05) as link:
        motion = bb.simulate(link, seconds=0.4)
    counts = link.statistics
    assert (counts.answered, counts.held, counts.zeroed) == (1, 3, 4)
    assert counts.late > 0
    assert counts.repeated == 0
    assert motion.torques.any(axis=1).tolist() == [True] * 4 + [False] * 5


def test_slow_simulation_is_counted_and_not_made_up_for():
    address = free_address()

    class Slow:
        reads_sensors = True
        calls = 0

        def __call__(self, readings, setpoint):
            self.calls += 1
            if self.calls == 3:
                time.sleep(0.2)
            return link(readings, setpoint)

    with serving(Damping(), address), bb.Link(address, real_time=True) as link:
        began = time.perf_counter()
        bb.simulate(Slow(), sensors="exact", seconds=0.1)
        assert time.perf_counter() - began >= 0.2 + 0.06
    assert link.statistics.overruns >= 1
    assert max(link.statistics.delays) >= 0.18


def test_run_in_real_time_ends_after_silence():
    board, answered = Board(), []

    def answer(frame):
        answered.append(frame)
        return [reply(frame)] if len(answered) < 3 else []

    with (
        board.answering(answer),
        bb.Link(board.address, real_time=True, give_up=0.2) as link,
        pytest.raises(bb.ControllerError, match="no torques from udp:"),
    ):
        bb.simulate(link, seconds=60.0)


def test_histogram_has_every_time_and_the_worst():
    statistics = Statistics(steps=1000, answered=1000, round_trips=[*np.full(900, 90e-6), *np.full(99, 3e-3), 0.25])
    text = statistics.text()
    assert "round trip: median 90 µs, 99 % 3 ms, worst 250 ms" in text
    rows = [line.split() for line in text.splitlines() if line.startswith("  up to")]
    assert sum(int(row[4]) for row in rows) == 1000
    assert [row[2:5] for row in rows if row[4] != "0"] == [
        ["128", "µs", "900"],
        ["4.1", "ms", "99"],
        ["262", "ms", "1"],
    ]
    assert max(map(len, text.splitlines())) < 80


def test_histogram_of_a_wide_range_collects_what_is_below():
    statistics = Statistics(round_trips=[1e-6, 1e-6, 1.0])
    rows = [line for line in statistics.text().splitlines() if line.startswith("  up to")]
    assert len(rows) == 12
    assert rows[0].split()[4] == "2"


def test_report_of_times_has_percentiles_and_the_worst():
    report = Statistics(round_trips=[1.0, 2.0, 3.0, 10.0]).report()
    assert report["round_trip"]["p50"] == 2.5
    assert report["round_trip"]["worst"] == 10.0
    assert report["jitter"] is None
