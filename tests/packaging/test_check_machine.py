"""What the build needs and the machine lacks is named before anything is downloaded or compiled."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.support.paths import ROOT

pytestmark = pytest.mark.skipif(
    shutil.which("cargo") is None or not sys.platform.startswith("linux"), reason="needs cargo and /proc/meminfo"
)


def check(**needs: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHON": sys.executable, **needs}
    command = ["sh", "tools/check_machine.sh"]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_a_machine_with_everything_passes() -> None:
    done = check(COMPILE_MEMORY="0", DISK="0")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize(
    ("need", "words"), [("COMPILE_MEMORY", "1000000 GB of memory"), ("DISK", "1000000 GB of free disk space")]
)
def test_too_little_is_named_with_need_and_found(need: str, words: str) -> None:
    done = check(**{"COMPILE_MEMORY": "0", "DISK": "0", need: "1000000"})
    assert done.returncode == 1
    assert done.stderr.startswith(f"missing: {words}")
    assert "(found " in done.stderr
    assert done.stderr.count("missing") == 1
