"""What is generated from the core's tables is not stale."""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT


@pytest.mark.slow("generates all files")
def test_generated_files_match_the_core():
    done = subprocess.run(
        [sys.executable, "tools/generate.py", "--check"], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
