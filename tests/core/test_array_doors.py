"""Arrays on their way into the core: type, shape and count are checked before anything is copied."""

import subprocess
import sys

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.paths import ROOT


@pytest.mark.slow("a process per function")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is limited only on Linux")
def test_no_array_ends_the_process(tmp_path):
    log = tmp_path / "calls.txt"
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.huge_arrays", str(log)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    calls = log.read_text(encoding="utf-8").splitlines()
    assert done.returncode == 0, f"{done.stdout}{done.stderr}the last call: {calls[-1]}"
    assert len(calls) > 5000


HUGE = np.broadcast_to(0.0, 10**12)
#: (what is called, what its message must have)
TOO_LARGE = {
    "heights": (
        lambda: bb.Terrain.from_heights(np.broadcast_to(0.0, (200_000, 200_000)), 0.05),
        r"heights has shape \(200000, 200000\), 40000000000 numbers, expected at most 4194304",
    ),
    "states": (
        lambda: bb.Renderer(width=8, height=8).render_batch(np.broadcast_to(0.0, (10**10, 32))),
        r"states has shape \(10000000000, 32\), .* expected at most 33554432",
    ),
    "strength": (lambda: bb.BalanceEnv(actuators={"strength": HUGE}), "strength has shape .* at most 4096"),
    "setpoint": (lambda: bb.BalanceEnv(setpoint=HUGE), "setpoint has shape .* at most 4096"),
    "parameter": (lambda: bb.Params.paper().replace(body_com_offset=HUGE), "body_com_offset has shape .* at most 4096"),
    "seeds": (lambda: bb.Batch(2).reset(seeds=np.broadcast_to(1, 10**12)), "seeds has 1000000000000 entries.* most 2"),
    "starts": (lambda: bb.Batch(2).reset(starts=np.broadcast_to(None, 10**12)), "starts has 1000000000000 entries"),
    "record": (lambda: bb.Batch(2).rollout(bb.Lqr(), 1, record=np.broadcast_to("states", 10**12)), "record has 10"),
    "range": (lambda: bb.State(range(10**12)), "ball_position has 1000000000000 entries, expected at most 3"),
}


@pytest.mark.parametrize("name", TOO_LARGE)
def test_arrays_that_are_too_large_are_rejected_with_shape_and_limit(name):
    call, message = TOO_LARGE[name]
    with pytest.raises(bb.InvalidInputError, match=message):
        call()


def test_sizes_limited_only_by_memory_are_rejected_with_their_need():
    for call in (
        lambda: bb.Reference.hold((0.0, 0.0)).sample(HUGE),
        lambda: bb.Terrain.plane(0.1).height(HUGE, 0.0),
    ):
        with pytest.raises(MemoryError, match=r"needs about \d+\.\d GB of memory"):
            call()


@pytest.mark.parametrize("kind", ["f8", "f4", "i4", ">f8", "f2"])
def test_fields_of_records_are_read_as_numpy_reads_them(kind):
    """Their distance is not a multiple of their size."""
    records = np.zeros((5, 2), dtype=[("flag", "u1"), ("number", kind), ("other", "u2")])
    records["number"] = np.arange(10).reshape(5, 2)
    numbers = records["number"]
    assert numbers.strides[1] % numbers.itemsize
    assert bb.State(numbers[:3, 1]).ball_position.tolist() == [1.0, 3.0, 5.0]
    assert bb.State(numbers[::-1][:3, 0]).ball_position.tolist() == [8.0, 6.0, 4.0]
    terrain = bb.Terrain.from_heights(0.01 * numbers[:4].repeat(2, axis=1), 0.1)
    field = np.zeros((4, 4), dtype=[("flag", "u1"), ("height", "f8")])
    field["height"] = 0.01 * numbers[:4].repeat(2, axis=1)
    again = bb.Terrain.from_heights(field["height"], 0.1)
    assert again.height(0.05, 0.1) == terrain.height(0.05, 0.1)
    batch = bb.Batch(3)
    batch.reset()
    actions = np.zeros((3, 3), dtype=[("flag", "u1"), ("action", "f4")])
    actions["action"] = 0.1 * np.arange(9).reshape(3, 3)
    observations = batch.step(actions["action"])[0]
    other = bb.Batch(3)
    other.reset()
    assert (other.step(actions["action"].copy())[0] == observations).all()


def test_numbers_that_are_not_aligned_are_read():
    unaligned = np.frombuffer(b"x" + np.arange(1.0, 4.0).tobytes(), dtype="f8", offset=1)
    assert not unaligned.flags.aligned
    assert bb.State(unaligned).ball_position.tolist() == [1.0, 2.0, 3.0]
