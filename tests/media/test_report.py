"""The report: a single file with all content, nothing fetched."""

import base64
import datetime
import json
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import pytest

import ballbot_rs as bb
from ballbot_rs._machine import processor
from ballbot_rs.cli import main
from ballbot_rs.media.report import origin, page, report
from ballbot_rs.training import origin as run_origin
from tests.support.paths import ROOT


class Page(HTMLParser):
    """What a browser would load, and what a reader would see."""

    def __init__(self, text):
        super().__init__()
        self.sources, self.links, self.headings, self.text, self.tags = [], [], [], "", set()
        self._heading, self.marks = False, 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.marks += tag == "i"
        self._heading = tag == "h2"
        self.sources += [value for name, value in attributes if name in ("src", "srcset", "data", "poster")]
        self.links += [value for name, value in attributes if name in ("href", "action", "background")]

    def handle_data(self, data):
        self.text += data
        if self._heading and data.strip():
            self.headings.append(data)


@pytest.fixture(scope="module")
def run_with_report(tiny_run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reported") / "run"
    shutil.copytree(tiny_run, folder)
    assert main(["report", str(folder), "--episodes", "2", "--video-seconds", "0.4", "--quiet"]) == 0
    return folder


@pytest.fixture(scope="module")
def shown(run_with_report):
    return Page((run_with_report / "report.html").read_text(encoding="utf-8"))


@pytest.mark.slow("a browser")
def test_nothing_is_fetched(run_with_report, shown):
    assert shown.links == []
    assert len(shown.sources) == 4
    assert all(source.startswith("data:") for source in shown.sources)
    assert not shown.tags & {"link", "object", "embed", "base", "form"}
    text = (run_with_report / "report.html").read_text(encoding="utf-8")
    # The player of the replay is viser's; the policy of the page holds for it, too.
    assert "default-src 'unsafe-inline' 'unsafe-eval' data: blob:" in text
    own = re.sub('srcdoc="[^"]*"', "", text)
    assert "://" not in own
    assert "url(" not in own
    assert "@import" not in own
    assert str(run_with_report) not in text


def test_everything_is_there(shown):
    assert shown.headings == [
        "The policy at work",
        "Comparison with the classical controllers",
        "Learning curve",
        "After a push",
        "Recovery",
        "Robot",
        "Configuration",
        "Versions",
    ]
    for expected in ("LQR", "PID", "seed 5", "total_timesteps = 768", "stable_baselines3", "2 episodes each"):
        assert expected in shown.text


def test_it_states_where_the_run_comes_from(shown, run_with_report):
    record = json.loads((run_with_report / "run.json").read_text(encoding="utf-8"))
    for part in ("started", "finished", "machine", "command"):
        assert record[part]
        assert record[part] in shown.text
    started, finished = (datetime.datetime.fromisoformat(record[part]) for part in ("started", "finished"))
    assert datetime.timedelta(0) <= finished - started < datetime.timedelta(hours=1)
    assert processor() in record["machine"]
    assert f"{record['timesteps']} steps in " in shown.text
    assert "--seed 5" in shown.text
    if (ROOT / ".git").exists():
        head = subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
        assert head.stdout.startswith(record["commit"].partition(",")[0])
        assert record["commit"] in shown.text
    assert "Robot paper." in shown.text
    assert "body_com_height" in shown.text


def test_a_record_of_an_earlier_version_has_a_report():
    found = dict(origin.rows({"seed": 3, "versions": {}}, Path("runs/mine"), "balance"))
    assert sorted(found) == ["as ONNX", "to repeat it"]
    assert found["to repeat it"] == "ballbot train balance --config config.toml --seed 3"


def test_a_changed_robot_is_named_by_its_changes():
    changed = bb.Params.preset("kugle").replace(body_mass=9.5, max_wheel_torque=1.0)
    text = origin.robot(changed, {"sensors": "kugle"})[0]
    assert "Robot kugle with body_mass = 9.5, max_wheel_torque = 1. Sensors: kugle." in text


def test_the_command_of_a_run_can_be_given_to_a_shell(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["/opt/bin/ballbot", "train", "balance", "--run", "my run"])
    assert run_origin.command() == "ballbot train balance --run 'my run'"
    monkeypatch.setattr(sys, "argv", [str(run_origin.PACKAGE / "cli" / "__main__.py"), "info"])
    assert run_origin.command() == "ballbot info"
    # Outside a clone there is no commit.
    assert run_origin.commit(tmp_path / "lib" / "python" / "ballbot_rs") is None


def test_figures_and_video_are_whole(shown, tmp_path):
    video, *figures = [source.partition(";base64,") for source in shown.sources]
    for kind, _, content in figures:
        assert kind == "data:image/svg+xml"
        root = ET.fromstring(base64.b64decode(content))
        linked = [value for node in root.iter() for name, value in node.attrib.items() if name.endswith("href")]
        assert all(value.startswith(("#", "data:")) for value in linked)
    assert video[0] == "data:video/mp4"
    (tmp_path / "v.mp4").write_bytes(base64.b64decode(video[2]))
    from moviepy import VideoFileClip

    with VideoFileClip(str(tmp_path / "v.mp4")) as clip:
        # 0.4 s at 25 frames a second, less what is missing when this hardly trained policy falls before.
        assert 7 <= len(list(clip.iter_frames())) <= 10


def test_the_replay_is_above_the_curves_of_all_controllers(shown):
    assert "iframe" in shown.tags
    # The policy and two laws, five axes each.
    assert shown.marks == 15


def test_a_report_without_viser_has_curves_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "ballbot_rs.viewer.replay.recorder", None)
    figure, note = report._push([bb.simulate("lqr", seconds=0.1)])
    assert figure.startswith("<img")
    assert "A replay needs the extra view." in note


def test_names_do_not_become_markup():
    assert "<b>" not in page.code("<b>") + page.note("<b>") + page.table([["<b>"], ["<b>"]]) + page.page("<b>", [])


@pytest.mark.slow("a training")
def test_a_training_ends_with_its_report(capsys, tmp_path, tiny_config):
    folder = tmp_path / "run"
    arguments = ["train", "balance", "--config", str(tiny_config), "--run", str(folder), "--quiet", "--episodes", "1"]
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith(f"report: {folder / 'report.html'}\n")
    text = Page((folder / "report.html").read_text(encoding="utf-8")).text
    assert "1 episodes each" in text
    assert main([*arguments, "--overwrite", "--no-report", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"] is None
    assert not (folder / "report.html").exists()


@pytest.mark.slow("a training")
@pytest.mark.parametrize("missing", ["matplotlib", "moviepy"])
def test_training_continues_without_optional_packages(missing, run_with_report):
    code = f"""
import sys
from pathlib import Path
sys.modules[{missing!r}] = None
from ballbot_rs.cli.commands.report import after_training
print(after_training(Path(sys.argv[1]), [], True))
"""
    command = [sys.executable, "-c", code, str(run_with_report)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout == "None\n"
    assert done.stderr.startswith("no report: ")
    assert f"needs {missing}: install it with `pip install -e '.[" in done.stderr
    assert done.stderr.count("\n") == 1


def test_paths_that_are_not_runs_are_rejected(tmp_path, capsys):
    assert main(["report", str(tmp_path)]) == 1
    assert "holds no training run" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
