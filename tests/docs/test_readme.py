"""The README's Python runs as it stands; only the length of its training is cut."""

import re

import pytest

from tests.support.paths import ROOT

BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_readme_has_python() -> None:
    assert len(BLOCKS) >= 3


@pytest.mark.parametrize("index", range(len(BLOCKS)))
def test_block_runs(index: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    code = BLOCKS[index].replace("learn(100_000)", "learn(8192)")
    exec(compile(code, f"README.md, Python block {index}", "exec"), {})
    if index == 0:
        printed = capsys.readouterr().out
        tilt = float(re.search(r"tilt ([0-9.]+) rad", printed).group(1))
        assert tilt < 0.005, printed
