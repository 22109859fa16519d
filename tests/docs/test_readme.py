"""The Python of README and docs/ runs unchanged, trainings included; the parser accepts their command lines."""

import re
import shlex
from pathlib import Path

import pytest

import ballbot_rs as bb
from ballbot_rs.cli import parser
from tests.support.paths import ROOT


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL)


BLOCKS = blocks("README.md")
PAGES = sorted(page.relative_to(ROOT).as_posix() for page in (ROOT / "docs").rglob("*.md"))
TRAINING = next(block for block in BLOCKS if "PPO(" in block)

COMMANDS = [
    (page.relative_to(ROOT).as_posix(), line)
    for page in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for line in (text.removesuffix(" &") for text in block.replace("\\\n", " ").splitlines())
    if line.startswith("ballbot ")
]


@pytest.mark.parametrize(("page", "line"), COMMANDS)
def test_the_parser_accepts_the_command_line(page: str, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        parsed = parser().parse_args(shlex.split(line, comments=True)[1:])
    except SystemExit:
        pytest.fail(f"{page}: {line}: {capsys.readouterr().err}")
    assert callable(parsed.carry_out)


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the clone's files, into which a block may write."""
    for name in ("assets", "crates", "docs", "firmware"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(code: str) -> None:
    exec(compile(code, "README.md", "exec"), {})


def test_first_block_balances_the_robot(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    run(BLOCKS[0])
    printed = capsys.readouterr().out
    tilt = float(re.search(r"tilt ([0-9.]+) rad", printed).group(1))
    assert tilt < 0.005, printed


@pytest.mark.slow("runs all programs of the pages")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)])
def test_the_blocks_of_a_page_run_one_after_another(page: str, clone: Path) -> None:  # noqa: ARG001
    namespace: dict[str, object] = {}
    for block in blocks(page):
        exec(compile(block, page, "exec"), namespace)


def test_the_controller_block_runs_on_the_command_line(clone: Path) -> None:
    (block,) = blocks("docs/command_line.md")
    (clone / "mine.py").write_text(block, encoding="utf-8")
    result = bb.evaluate("mine.py:Damped", episodes=1)
    assert result.control_dt == 0.004
    assert result.torque_rms > 0.0


@pytest.mark.slow("a training")
def test_training_block_learns_to_balance(clone: Path) -> None:
    run(TRAINING)
    result = bb.evaluate(str(clone / "balance.zip"), episodes=100, model="contact")
    assert result.success_rate >= 0.95, result


def test_the_citation_has_the_version_of_the_package() -> None:
    bibtex = re.search(r"version = \{(.*?)\}", (ROOT / "README.md").read_text(encoding="utf-8"))
    cff = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert bibtex is not None
    assert cff is not None
    assert bibtex[1] == cff[1] == bb.__version__


def test_the_animation_matches_its_command() -> None:
    """Duration, rate and size of the README's command, and small enough for a page."""
    from PIL import Image

    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    (line,) = re.findall(r"`(ballbot record [^`]*-o docs/push\.webp)`", text)
    requested = parser().parse_args(shlex.split(line)[1:])
    with Image.open(ROOT / requested.output) as animation:
        assert list(animation.size) == requested.size
        durations = []
        for i in range(animation.n_frames):
            animation.seek(i)
            animation.load()
            durations.append(animation.info["duration"])
    # Equal frames are merged.
    assert sum(durations) == 1000 * requested.seconds
    assert min(durations) == 1000 / requested.frame_rate
    assert (ROOT / requested.output).stat().st_size <= 1_500_000
