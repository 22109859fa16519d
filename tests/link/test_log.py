import json
import time

import numpy as np
import pytest
from mcap.reader import make_reader

import ballbot_rs as bb
from ballbot_rs.link.frames import Frame, encode
from ballbot_rs.link.layout import Flag, Kind, Status
from tests.support.links import Board, Damping, free_address, serving


def read(path):
    """The messages by topic, each with its time in ns, and the metadata."""
    topics = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        for _, channel, message in reader.iter_messages():
            topics.setdefault(channel.topic, []).append({"at": message.log_time, **json.loads(message.data)})
        (metadata,) = reader.iter_metadata()
    return topics, json.loads(metadata.metadata["statistics"])


def test_log_has_the_whole_exchange(tmp_path):
    path, address = tmp_path / "exchange.mcap", free_address()
    began = time.time_ns()
    with serving(Damping(), address), bb.Link(address, log=path) as link:
        motion = bb.simulate(link, sensors="kugle", tilt=(0.05, 0.0), seconds=0.2)
        assert not path.exists()
    topics, statistics = read(path)
    sent, got = topics["/link/readings"], topics["/link/torques"]
    first = [message for message in sent if message["repetition"] == 0]
    assert len(first) == 20
    assert [message["time"] for message in first] == [10_000 * i for i in range(20)]
    assert [message["flags"] for message in first] == [Flag.RESET] + [0] * 19
    accepted = [message for message in got if message["fate"] == "accepted"]
    assert [message["sequence"] for message in accepted] == [message["sequence"] for message in first]
    assert np.array([message["torques"] for message in accepted]) == pytest.approx(motion.torques[:20], rel=1e-6)
    assert first[0]["gyro"] != [0.0, 0.0, 0.0]
    assert first[0]["yaw"] == 0.0
    times = [message["at"] for message in first]
    assert times == sorted(times)
    assert began <= times[0] < time.time_ns()
    assert statistics["answered"] == link.statistics.answered == 20


def test_log_has_what_was_rejected_and_what_was_missed(tmp_path):
    path, board, seen = tmp_path / "exchange.mcap", Board(), []

    def answer(frame):
        seen.append(frame)
        good = encode(Frame(Kind.TORQUES, int(Status.LIMIT), frame.sequence, frame.time, (0.0, 0.0, float("inf"))))
        return [good] if len(seen) == 1 else [b"\x07garbage\0"]

    with (
        board.answering(answer),
        bb.Link(board.address, log=path, retries=0) as link,
        pytest.raises(bb.InvalidInputError, match="inf"),
    ):
        bb.simulate(link, seconds=0.1)
    topics, _ = read(path)
    # JSON has no infinity.
    assert topics["/link/torques"][0]["torques"] == [0.0, 0.0, None]
    assert topics["/link/torques"][0]["flags"] == Status.LIMIT

    path, board = tmp_path / "missed.mcap", Board()

    def garbage(frame):
        return [b"\x07garbage\0"] if frame.time else [encode(Frame(Kind.TORQUES, 0, frame.sequence, 0, (0.0,) * 3))]

    with board.answering(garbage), bb.Link(board.address, log=path, retries=0, hold=2) as link:
        bb.simulate(link, seconds=0.05)
    topics, statistics = read(path)
    assert {message["reason"] for message in topics["/link/rejected"]} == {"broken"}
    assert topics["/link/rejected"][0]["bytes"] == b"\x07garbage".hex()
    assert [message["torques"] for message in topics["/link/missed"]] == ["held", "held", "zeroed", "zeroed"]
    assert statistics["held"] == 2


def test_log_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="not written"):
        bb.Link(free_address(), log=tmp_path / "file" / "exchange.mcap").open()


def test_link_that_was_never_opened_writes_nothing(tmp_path):
    with bb.Link(free_address(), log=tmp_path / "exchange.mcap"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_link_that_is_reopened_writes_its_log_again(tmp_path):
    path, address = tmp_path / "exchange.mcap", free_address()
    link = bb.Link(address, log=path)
    for steps in (2, 3):
        with serving(Damping(), address), link:
            bb.simulate(link, seconds=0.01 * steps)
        assert len({message["sequence"] for message in read(path)[0]["/link/readings"]}) == steps
