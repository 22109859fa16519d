import json
import signal
import subprocess
import time

import pytest

from tests.cli.test_interrupts import ENDINGS
from tests.link.test_log import read
from tests.support.commands import command, run, start
from tests.support.links import is_alive, peer_command
from tests.support.waiting import wait_until

LAWS = "tests/support/links.py"


def peer(*arguments):
    return "exec:" + " ".join(command("link", "stdio:", "--peer", *arguments))


@pytest.mark.slow("starts four processes, which import the package")
def test_command_runs_a_peer_of_ours(tmp_path):
    log = tmp_path / "exchange.mcap"
    options = ("--robot", "kugle", "--seconds", "1", "--tilt", "0.02", "0", "--log", log)
    done = run("link", peer("lqr", "--robot", "kugle"), *options)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("upright for 1.00 s\n100 of 100 steps answered in time\n")
    assert "round trip: median" in done.stdout
    assert f"wrote {log}" in done.stdout
    topics, _ = read(log)
    # The sensors of kugle are the sensors of the robot: their readings are noisy.
    assert topics["/link/readings"][0]["gyro"] != [0.0, 0.0, 0.0]
    done = run("link", peer(f"{LAWS}:Damping"), "--seconds", "0.1", "--json")
    report = json.loads(done.stdout)
    assert (report["answered"], report["statuses"], report["fell_at"]) == (10, {"running": 10}, None)


@pytest.mark.slow("starts a process, which imports the package")
@pytest.mark.parametrize(("number", "code", "line"), ENDINGS)
def test_signal_ends_soon_without_a_child_and_with_the_log(tmp_path, number, code, line):
    log, pids = tmp_path / "exchange.mcap", tmp_path / "pids"
    script = tmp_path / "start.sh"
    sleeper = tmp_path / "sleeper"
    start_both = f"sleep 333 &\necho $! > {sleeper}\necho $$ > {pids}\nexec {peer_command(tmp_path)} stdio:\n"
    script.write_text(start_both, encoding="utf-8")
    options = ("--real-time", "--seconds", "600", "--tilt", "0", "0", "--sensors", "exact", "--log", log)
    process = start("link", f"exec:sh {script}", *options, "--give-up", "600")
    wait_until(lambda: pids.exists() and pids.read_text())
    time.sleep(1.0)
    began = time.monotonic()
    process.send_signal(number)
    _, errors = process.communicate(timeout=10)
    assert process.returncode == code, errors
    assert "steps answered in time" in errors
    assert "round trip: median" in errors
    assert errors.endswith(line)
    assert time.monotonic() - began < 5.0
    wait_until(lambda: not is_alive(int(pids.read_text())) and not is_alive(int(sleeper.read_text())))
    assert not list(tmp_path.glob(".*partial*"))
    topics, _ = read(log)
    assert len(topics["/link/torques"]) > 1


@pytest.mark.slow("starts a process, which imports the package")
def test_ctrl_c_of_any_command_leaves_no_child(tmp_path):
    """A child that ignores the end of its input is ended, too."""
    pids = tmp_path / "pids"
    script = tmp_path / "start.sh"
    script.write_text(f"echo $$ > {pids}\nexec sleep 600\n", encoding="utf-8")
    process = start("record", "--controller", f"exec:sh {script}", "-o", tmp_path / "video.mp4")
    wait_until(lambda: pids.exists() and pids.read_text())
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10)
    assert process.returncode == 130
    wait_until(lambda: not is_alive(int(pids.read_text())))


@pytest.mark.slow("starts a process, which imports the package")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("exec:false",), "ballbot: link failed: ClosedError: its process ended with code 1"),
        (("exec:no-such-program",), "ballbot: no-such-program: No such file or directory"),
        (("udp://127.0.0.1:0",), "is not udp://HOST:PORT"),
        (("udp://127.0.0.1:9", "--peer", "lqr", "--set", "reward.alive=1"), "a peer does not depend on"),
        (("udp://127.0.0.1:9", "--drop", "2"), "argument --drop"),
        (("stdio:", "--peer", "nonsense"), "no policy at nonsense"),
    ],
)
def test_errors_name_what_is_wrong(arguments, message):
    done = run("link", *arguments, stdin=subprocess.DEVNULL)
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow("starts a process, which imports the package")
def test_faults_on_the_command_line_are_counted():
    done = run("link", peer(f"{LAWS}:Damping"), "--seconds", "0.2", "--drop", "0.3", "--timeout", "0.05", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["repeated"] > 0
