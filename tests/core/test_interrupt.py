"""Ctrl-C ends every call that may be long, and the process continues."""

import signal
import subprocess
import sys
import textwrap

import pytest

from tests.support.paths import ROOT

#: The object, and the call that would last minutes.
CALLS = {
    "step": ("robot = bb.Ballbot(model='contact')", "robot.step([0, 0, 0], 10**12)"),
    "step of a rigid robot": ("robot = bb.Ballbot(model='rigid')", "robot.step([0, 0, 0], 10**9)"),
    "batch": ("", "[bb.Batch(200_000, 'balance', model='planar', num_threads=1) for _ in range(100)]"),
    "step of a batch": ("batch = slow(3000)", "batch.step(np.zeros((3000, 3)))"),
    "step of a batch on two threads": ("batch = slow(3000, 2)", "batch.step(np.zeros((3000, 3)))"),
    "rollout": ("batch = slow(1)", "batch.rollout(bb.Lqr(), 10**8, record=())"),
    "rollout of long steps": ("batch = slow(3000)", "batch.rollout(bb.Lqr(), 10, record=())"),
    "rollout of short steps": (
        "batch = bb.Batch(1, 'balance', model='contact'); batch.reset()",
        "batch.rollout(bb.Lqr(), 10**10, record=())",
    ),
    "picture": (
        "camera = bb.Renderer(width=8192, height=8192, samples=4); state = bb.State.at_rest(bb.Params.paper())",
        "camera.render(state)",
    ),
    "depth": (
        "camera = bb.Renderer(width=64, height=64); state = bb.State.at_rest(bb.Params.paper())",
        "while True: camera.depth(state)",
    ),
    "pictures": (
        "camera = bb.Renderer(width=512, height=512, samples=4, num_threads=1); "
        "states = np.tile(bb.State.at_rest(bb.Params.paper()).to_array(), (2000, 1))",
        "camera.render_batch(states)",
    ),
    "evaluation": ("", "bb.evaluate('lqr', episodes=1000, model='rigid')"),
}

PROGRAM = """
import numpy as np
import ballbot_rs as bb

def slow(n, num_threads=1):
    batch = bb.Batch(n, "balance", model="spatial", sim_dt=1e-6, control_dt=0.01, num_threads=num_threads)
    batch.reset()
    return batch

{setup}
print("ready", flush=True)
try:
    {call}
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGINT to send")
@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_ends_a_long_call(name):
    setup, call = CALLS[name]
    program = textwrap.dedent(PROGRAM).format(setup=setup, call=call)
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert process.stdout.readline() == "ready\n"
        # It is in the call, and not before it.
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=0.5)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=300)
    finally:
        process.kill()
    assert out == "interrupted\n"
    assert process.returncode == 0


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGINT to raise")
def test_a_batch_whose_step_was_interrupted_must_be_reset():
    import threading

    import numpy as np

    import ballbot_rs as bb

    batch = bb.Batch(3000, "balance", model="spatial", sim_dt=1e-6, control_dt=0.01, num_threads=1)
    batch.reset()
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        threading.Timer(0.3, signal.raise_signal, [signal.SIGINT]).start()
        batch.step(np.zeros((3000, 3)))
    with pytest.raises(ValueError, match="the last step was interrupted: reset all environments"):
        batch.step(np.zeros((3000, 3)))
    assert batch.reset().shape == (3000, 16)
