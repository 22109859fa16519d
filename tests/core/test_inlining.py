"""The operations on lanes are instructions of the extension module, not calls."""

import shutil
import subprocess

import pytest

from ballbot_rs import _core


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm, which comes with a C compiler")
def test_every_operation_on_lanes_is_inlined():
    symbols = subprocess.run(["nm", _core.__file__], capture_output=True, text=True, timeout=300, check=True).stdout
    if "vectorize_avx2" not in symbols:
        pytest.skip("the symbols are stripped, or the processor has no AVX2")
    # What a closure or an array's `map` keeps out of a vectorized function is compiled for the baseline processor:
    # each operation is then a call of one of these.
    called = [line for line in symbols.splitlines() if "__fearless_simd_kernel" in line]
    assert not called, f"{len(called)} operations are calls, such as {called[0]}"
