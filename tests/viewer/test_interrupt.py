"""Calls that do not return: the page continues, and the keyboard ends the command at any time."""

import signal
import subprocess
import sys
import threading
import time
import urllib.request

import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")
pytest.importorskip("onnx", reason="policies that loop are made with onnx: install 'ballbot-rs[export]'")

import numpy as np

from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.viewer.session.foreign import Interrupted, Watchdog, is_any_left
from ballbot_rs.viewer.session.session import MAX_CALL, Session
from ballbot_rs.viewer.view import View
from tests.support.onnx_policies import SHIPPED, looping_policy
from tests.support.view import query
from tests.support.waiting import wait_until


@pytest.fixture(scope="module")
def looping(tmp_path_factory):
    return looping_policy(tmp_path_factory.mktemp("policies") / "looping.onnx")


def test_the_looping_policy_equals_the_shipped_policy_once_its_loop_ends(tmp_path):
    observations = np.random.default_rng(0).normal(size=(4, 16)).astype(np.float32)
    ends = OnnxPolicy(looping_policy(tmp_path / "ends.onnx", trips=10))
    np.testing.assert_allclose(ends.act(observations), OnnxPolicy(SHIPPED).act(observations), atol=1e-6)


def test_a_policy_that_loops_is_interrupted_from_another_thread(looping):
    policy = OnnxPolicy(looping)
    threading.Timer(0.2, policy.interrupt).start()
    with pytest.raises(Exception, match="terminate"):
        policy.act(np.zeros(16, dtype=np.float32))


def test_the_page_continues_without_a_policy_that_loops(looping):
    view = View(Session(), port=18860)
    try:
        view.runner.submit(lambda session: session.choose(controller=str(looping)))
        wait_until(lambda: view.runner._session.controller == str(looping))
        # The page is served while the policy is waited for.
        with urllib.request.urlopen(view.url, timeout=0.5 * MAX_CALL) as answer:
            assert answer.status == 200
        wait_until(lambda: query(view, lambda session: session.controller) == "zero")
        notice = query(view, lambda session: session.notices[-1])
        assert notice == f"{looping} took longer than 1 s; the motors are off"
        before = query(view, lambda session: session.time)
        wait_until(lambda: query(view, lambda session: session.time) > before + 0.2)
        # The call itself has ended, too, and others are made.
        wait_until(lambda: not is_any_left())
        view.runner.submit(lambda session: (session.choose(controller=str(SHIPPED)), session.reset()))
        wait_until(lambda: query(view, lambda s: (s.controller, s.time > 0.2)) == (str(SHIPPED), True))
    finally:
        view.stop()
    assert view.runner.error is None
    assert not view.runner.running


def test_a_policy_that_loops_is_rejected_on_another_robot(looping, monkeypatch):
    monkeypatch.setattr("ballbot_rs.viewer.session.configured.MAX_LOAD", 0.2)
    with pytest.raises(TimeoutError, match=r"took longer than 0\.2 s"):
        Session(robot="kugle", controller=str(looping))


def test_a_call_that_is_waited_for_is_canceled():
    watch, ends = Watchdog(), threading.Event()
    threading.Timer(0.1, watch.cancel).start()
    with pytest.raises(Interrupted, match="sleep was interrupted"):
        watch.call("sleep", lambda: ends.wait(30.0), 30.0)
    assert is_any_left()
    with pytest.raises(Interrupted):
        watch.call("more", lambda: 1, 1.0)
    ends.set()
    wait_until(lambda: not is_any_left())


def test_results_and_errors_of_calls_are_forwarded():
    watch, threads = Watchdog(), set()
    for i in range(100):
        assert watch.call("add", lambda i=i: (threads.add(threading.get_ident()), i + 1)[1], 5.0) == i + 1
    with pytest.raises(ZeroDivisionError):
        watch.call("divide", lambda: 1 / 0, 5.0)
    assert len(threads) == 1
    ends = threading.Event()
    with pytest.raises(TimeoutError, match=r"wait took longer than 0\.05 s"):
        watch.call("wait", lambda: ends.wait(30.0), 0.05, interrupt=ends.set)
    assert watch.call("add", lambda: 2, 5.0) == 2


@pytest.mark.slow("processes")
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc to send Ctrl-C at the right time")
@pytest.mark.parametrize("at", ["loading", "trial", "loop", "end of the loop"])
def test_the_keyboard_ends_the_command(looping, tmp_path, at):
    """That it takes less than 0.2 s is measured, not tested; a call that is waited for lasts 5 s or does not end."""
    controller, options = str(looping), []
    if at == "loading":
        slow = tmp_path / "slow.py"
        slow.write_text("import time, pathlib\npathlib.Path(__file__ + '.read').touch()\ntime.sleep(1000)\n")
        controller = f"{slow}:law"
    elif at == "trial":
        options = ["--robot", "kugle"]
    command = [sys.executable, "-m", "ballbot_rs.cli", "view", "--no-open", "--port", "18870", "--model", "contact"]
    with subprocess.Popen(
        [*command, "--controller", controller, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        if at == "loading":
            wait_until((slow.parent / "slow.py.read").exists)
        elif at == "trial":
            wait_until(lambda: "onnxruntime" in maps(process.pid))
            time.sleep(1.0)
        else:
            assert "Ctrl-C ends it" in process.stdout.readline()
            time.sleep(0.4 if at == "loop" else 2.5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=4.0)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")


def maps(pid):
    """What is loaded in a process."""
    with open(f"/proc/{pid}/maps") as file:  # noqa: PTH123
        return file.read()
