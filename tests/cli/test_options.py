"""Every option of every command changes what the command prints or writes, or is rejected by name."""

import argparse
import functools
import io
import itertools
import json
import re
import shutil
from pathlib import Path

import pytest

import ballbot_rs as bb
from ballbot_rs.cli import main, parser
from ballbot_rs.link.link import Link
from tests.support.keywords import Refused, Same, With, changes, fingerprint
from tests.support.paths import ASSETS
from tests.support.tiny_config import TINY_CONFIG

SCENARIOS = """
[[scenario]]
id = "tilted"
title = ""
seconds = 0.3
tilt = {tilt}
score = "rms_tilt"

[[scenario]]
id = "random"
title = ""
seconds = 0.3
tilt = {tilt}
events = "mild"
seeds = 2
score = "rms_tilt"
"""
BALANCE, VELOCITY = (str(ASSETS / "policies" / f"{task}.onnx") for task in ("balance", "velocity"))
URDF = "{bot} {ball}"
SENSORS = {"--set": ["observation=sensors", "max_episode_steps=20"]}
#: Options that many commands have.
ROBOT = {"--model": "rigid", "--robot": "kugle", "--actuators": "{actuators}"}
SCENE = {"--tilt": "0.1 0.0", "--yaw": "0.3", "--push": "0.1 0 0", "--push-at": With("0.1", **{"--push": "0.1 0 0"})}
#: A map of the columns of a log, with rates that are 5 % higher.
COLUMNS = """
[columns]
time = "time"
torques = ["torque_0", "torque_1", "torque_2"]
wheel_angles = ["wheel_angle_0", "wheel_angle_1", "wheel_angle_2"]
gyro = ["gyro_x", "gyro_y", "gyro_z"]
[scale]
gyro = 1.05
"""
SHOWN = {"--quiet": "", "--json": ""}
#: Motions of `plot`, `record` and `view`: 0.2 s of one robot.
MOTION = {
    "task": "goal",
    "--controller": "lqi",
    "--controller-option": "position=0.1",
    **ROBOT,
    **SCENE,
    "--set": "control_dt=0.02",
    "--sensors": With("kugle", **{"--set": "observation=sensors"}),
    "--events": "mild",
    "--seed": With("1", **{"--events": "mild"}),
    "--seconds": "0.1",
}

#: The rest needs a sweep.
SWEEP = {
    "--sweep": "body_mass=2.0,2.5",
    "--checkpoint": With("a.json", **{"--sweep": "body_mass=2.0"}),
    "--value": With("success_rate", **{"--sweep": "body_mass=2.0", "--json": None}),
    "--output": With("a.csv", **{"--sweep": "body_mass=2.0"}),
}

#: Commands: arguments, and other values of those and of the rest. Positional arguments have no dashes, a flag is "",
#: a list repeats its option; a name in braces is of a file that the fixture `files` makes.
CASES: dict[str, list[tuple[dict, dict]]] = {
    "evaluate": [
        (
            {"--episodes": "2", "--set": "max_episode_steps=20"},
            {
                "task": "velocity",
                "--controller": "lqi",
                "--controller-option": "position=0.1",
                **ROBOT,
                **SHOWN,
                "--set": "max_episode_steps=10",
                "--sensors": With("kugle", **SENSORS),
                "--events": "mild",
                "--engine": "mujoco",
                "--seed": "1",
                "--episodes": "3",
                **SWEEP,
            },
        )
    ],
    "compare": [
        (
            {"scenario": "tilted", "--file": "{scenarios}", "--json": ""},
            {
                "scenario": "random",
                "--controller": "lqi",
                "--controller-option": "position=0.1",
                "--file": "{others}",
                "--robot": "kugle",
                "--set": "robot.body_mass=3.0",
                "--model": "rigid",
                "--actuators": With("{actuators}", **{"--robot": "kugle"}),
                "--sensors": "kugle",
                "--events": "hard",
                "--seed": With("1", scenario="random"),
                "--list": "",
                "--json": None,
                "--quiet": With("", **{"--json": None}),
                **SWEEP,
            },
        )
    ],
    "report": [
        (
            {"run": "{run}", "--output": "a.html", "--episodes": "0", "--video-seconds": "0"},
            {"run": "{other_run}", "--output": "b.html", "--episodes": "1", "--video-seconds": "0.1", **SHOWN},
        )
    ],
    "export": [
        (
            {"--controller": "lqr", "--output": "a.h"},
            {
                "policy": Refused(BALANCE),
                "--controller": "pid",
                "--controller-option": "position=9",
                "--robot": "kugle",
                "--set": "control_dt=0.02",
                "--model": Refused("rigid"),
                "--actuators": Refused("kugle"),
                "--sensors": Refused("kugle"),
                "--estimator": Refused(""),
                "--link": Refused(""),
                "--supervisor": Refused(""),
                "--limit": Refused("ramp_time=0.3"),
                "--task": Refused("velocity"),
                "--output": "b.h",
                "--json": "",
            },
        ),
        ({"policy": BALANCE, "--output": "a.h"}, {"policy": VELOCITY, "--task": Refused("velocity")}),
        (
            {"--estimator": "", "--sensors": "kugle", "--output": "a.h"},
            {"--sensors": "{sensors}", "--robot": "kugle", "--set": "control_dt=0.02"},
        ),
        ({"--link": "", "--output": "a.h"}, {"--output": "b.h", "--robot": Refused("kugle"), "--json": ""}),
        (
            {"--supervisor": "", "--output": "a.h"},
            {"--limit": "ramp_time=0.3", "--robot": "kugle", "--actuators": "kugle", "--set": "control_dt=0.02"},
        ),
    ],
    "identify": [
        (
            {"log": "{log}", "--fields": "body_mass", "--sim-dt": "0.005"},
            {
                "log": "{other_log}",
                "--columns": "{columns}",
                "--robot": "{robot}",
                "--actuators": "{actuators}",
                "--fields": "body_com_height",
                "--model": "spatial",
                "--sim-dt": "0.01",
                "--window": "0.4",
                "--imu-position": "0 0 0.01",
                "--threads": Same("2"),
                "--output": "a.toml",
                **SHOWN,
            },
        )
    ],
    "replay": [
        (
            {"log": "{log}", "--output": "a.svg"},
            {
                "log": "{other_log}",
                "--columns": "{columns}",
                "--robot": "{robot}",
                "--set": "robot.body_mass=2.5",
                "--actuators": "{actuators}",
                "--model": "spatial",
                "--sim-dt": "0.01",
                "--window": "0.4",
                "--imu-position": "0 0 0.01",
                "--threads": Same("2"),
                "--begin": "1",
                "--seconds": "1",
                "--output": "b.svg",
                # A second of video takes seconds.
                "--video": With("b.webp", **{"--seconds": "0.1"}),
                **SHOWN,
            },
        )
    ],
    "record-log": [
        (
            {"--seconds": "0.3"},
            {
                **ROBOT,
                **SHOWN,
                "--seconds": "0.2",
                "--excitation": "0.5",
                "--exact": "",
                "--pose": "",
                "--seed": "1",
                "--output": "a.npz",
            },
        )
    ],
    "plot": [
        (
            {"--seconds": "0.2", "--push-at": "0.0", "--figure": "trajectories", "--data": "csv"},
            {
                **MOTION,
                "--json": "",
                "--quiet": With("", **{"--figure": "recovery_map"}),
                "--output": "a",
                "--figure": "phase_portrait",
                "--format": "pdf",
                "--width": "89",
                "--data": "npz",
            },
        )
    ],
    "record": [
        (
            {
                "--seconds": "0.2",
                "--push-at": "0.0",
                "--output": "a.webp",
                "--size": "160 120",
                "--no-caption": "",
                "--schematic": "",
            },
            {
                **MOTION,
                **SHOWN,
                "--urdf": URDF,
                "--output": "b.webp",
                "--still": "0.1",
                "--no-video": With("", **{"--still": "0.1"}),
                "--forces": "",
                "--no-caption": None,
                "--schematic": None,
                "--size": "80 60",
                "--samples": "2",
                "--frame-rate": "25",
                "--camera": "0.5 0.3",
                "--distance": "2.0",
            },
        )
    ],
    "simulate": [
        (
            {"--seconds": "0.2", "--push-at": "0.0"},
            {
                **MOTION,
                "--json": "",
                "--urdf": URDF,
                "--position": "0.1 0",
                "--reference": "position=[0.1,0]",
                "--output": "a.npz",
            },
        )
    ],
    "view": [
        (
            {"--seconds": "0.01"},
            {
                **{name: value for name, value in MOTION.items() if name not in SCENE},
                "--set": "robot.body_mass=3.0",
                "--urdf": URDF,
                "--batch": "2",
                "--port": "8081",
                "--no-open": "",
                "--seconds": "0.2",
            },
        )
    ],
    "link": [
        (
            {"address": "udp://h:1", "--seconds": "0.1", "--push": "0.1 0 0", "--push-at": "0.0"},
            {
                "address": "udp://h:2",
                "task": "terrain",
                **ROBOT,
                **SCENE,
                "--push": "0.2 0 0",
                "--push-at": "0.05",
                "--set": "control_dt=0.02",
                "--sensors": "kugle",
                "--events": "mild",
                "--seed": "1",
                "--real-time": "",
                "--timeout": "0.2",
                "--retries": "1",
                "--on-timeout": "zero",
                "--hold": "1",
                "--give-up": "1",
                "--connect": "1",
                **dict.fromkeys(("--drop", "--corrupt", "--duplicate", "--delay", "--delay-time"), "0.1"),
                "--log": "a.mcap",
                "--seconds": "0.2",
                "--json": "",
            },
        ),
        (
            {"address": "stdio:", "--peer": "lqr"},
            {
                "address": "udp://h:1",
                "--peer": "lqi",
                "--controller-option": "position=0.1",
                "--idle": "1",
                "--robot": "kugle",
                "--sensors": "{sensors}",
                "--set": "control_dt=0.02",
                "--model": Refused("rigid"),
                "--events": Refused("mild"),
            },
        ),
    ],
    "train": [
        (
            {"--config": "{config}", "--run": "a", "--episodes": "1", "--no-report": ""},
            {
                **ROBOT,
                **SHOWN,
                "task": Refused("velocity"),
                "--set": "algorithm_arguments.n_epochs=2",
                "--sensors": With("kugle", **{"--set": "observation=sensors"}),
                "--events": "mild",
                "--seed": "1",
                "--config": "{other_config}",
                "--run": "b",
                "--resume": Refused("{run}"),
                "--overwrite": With("", **{"--run": "{old}"}),
                "--timesteps": "256",
                "--episodes": "2",
                "--workers": Refused("2"),
                "--ray-address": Refused("localhost:1"),
                "--no-report": None,
            },
        ),
        ({"--config": "{velocity}", "--run": "a", "--episodes": "0", "--no-report": ""}, {"task": "velocity"}),
    ],
    "tune": [
        (
            {"--config": "{config}", "--study": "a"},
            {
                **ROBOT,
                **SHOWN,
                "task": Refused("velocity"),
                "--set": "algorithm_arguments.n_epochs=2",
                "--sensors": "kugle",
                "--events": "mild",
                "--seed": "1",
                "--config": "{other_config}",
                "--timesteps": "512",
                "--trials": "2",
                "--jobs": "2",
                "--study": "b",
                "--search": "algorithm_arguments.gamma=0.9:0.99",
            },
        )
    ],
    "list": [({}, {"kind": "robots", "--json": ""})],
    "info": [({}, {"--json": ""})],
}
#: What needs a cluster, which tests/distributed has, and a page until Ctrl-C, which tests/identification has.
ELSEWHERE = {"plot": {"--overlay"}, "train": {"--on", "--algorithm"}, "replay": {"--page", "--port", "--no-open"}}
#: How an error names an argument that has no dashes or is the value itself.
NAMED = {
    "policy": "RUN",
    "task": "is of ballbot/Balance-v0, but the task is velocity",
    "--task": "elocity",
    "--robot": "not depend on task, robot",
    "--model": "not depend on model",
    "--events": "not depend on events",
    "--sensors": "not depend on sensors",
    "--actuators": "not depend on actuators",
}


class Terminal(io.StringIO):
    """Standard error without a terminal."""

    def isatty(self):
        return True


class Page:
    """What a page shows after some steps, in place of a server."""

    def __init__(self, session, port, urdfs):
        for _ in range(20):
            session.step()
        self.url, self.runner, self.shown = str(port), self, [urdfs, vars(session.frame())]
        self.running, self.error = True, None

    def report(self):
        return repr(fingerprint(self.shown))

    def stop(self):
        pass


class Line(Link):
    """A link without a line, which prints its options and what it would send."""

    def __init__(self, address, **options):
        print(address, options)
        super().__init__("udp://127.0.0.1:9")
        self.address = address

    def open(self):
        return self

    def __call__(self, readings, **setpoint):
        print(readings, setpoint)
        return 0.1 * readings["gyro"]


class Peer:
    """A peer that prints its arguments."""

    def __init__(self, *arguments, **options):
        print(arguments, options)

    def serve(self):
        pass


class Clock:
    """Time that only sleeping consumes, and that is printed."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        print(self.now)


@pytest.fixture(scope="module")
def files(tmp_path_factory, tiny_run):
    """Paths by their placeholders in `CASES`."""
    folder = tmp_path_factory.mktemp("inputs")
    short = TINY_CONFIG.replace("= 768", "= 512")
    texts = {
        "scenarios.toml": SCENARIOS.format(tilt=4.0),
        "others.toml": SCENARIOS.format(tilt=3.0),
        "config.toml": short,
        "other_config.toml": short.replace("1e-3", "2e-3"),
        "velocity.toml": short.replace("Balance", "Velocity"),
        "sensors.toml": "[sensors]\ngyro_noise = 0.1\n",
        "actuators.toml": "[actuators]\ndelay = 0.002\n",
        "columns.toml": COLUMNS,
        "robot.toml": bb.Params.paper().replace(body_com_height=0.36).to_toml(),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in ("bot.urdf", "ball.urdf"):
        text = (ASSETS / name).read_text(encoding="utf-8").replace('"meshes/', f'"{ASSETS}/meshes/')
        (folder / name).write_text(text.replace('value="1.8704"', 'value="2.5"'), encoding="utf-8")
    for name, seed in (("log", 0), ("other_log", 1)):
        bb.record_log(seconds=4.0, seed=seed).write(folder / f"{name}.csv")
    other = folder / "other_run"
    shutil.copytree(tiny_run, other)
    record = json.loads((other / "run.json").read_text(encoding="utf-8"))
    (other / "run.json").write_text(json.dumps({**record, "seed": 6}), encoding="utf-8")
    return {"run": tiny_run, "other_run": other, **{path.stem: path for path in folder.iterdir() if path.is_file()}}


def untimed(text):
    """Without times, which differ from call to call: of a training, and of its bar, whose length follows its rate."""
    return re.sub(r'in \d+ s|"seconds": [\d.e-]+|━+ (?=\d+/\d+ )|\[ .* it/s \]', "", text)


@pytest.mark.parametrize("rate", ["?", "8", "42", "1,842"])
def test_the_rate_of_a_training_changes_nothing(rate):
    def line(rate):
        shown = f"512/512  [ 0:00:12 < 0:00:00 , {rate} it/s ]"
        return f" 100% {'━' * (92 - len(shown))} {shown}\n"

    assert untimed(line(rate)) == untimed(line("240")) == " 100% 512/512  \n"


@pytest.fixture
def outcome(files, tmp_path, monkeypatch, capsys):
    """A function that carries out a command in an empty folder, and returns what it prints and writes."""
    from ballbot_rs.cli.commands import link, report, tune
    from ballbot_rs.cli.options import page as served
    from ballbot_rs.media.figures import style
    from ballbot_rs.training import search
    from ballbot_rs.viewer import view as page

    calls = []

    def write(folder, progress, target=None, **arguments):
        progress("report")(1, 2)
        calls.append((folder, arguments))
        return target or folder / "report.html"

    def draw(figure, path):
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"{figure.get_size_inches()} {[axes.get_title() for axes in figure.axes]}")

    # What takes seconds is replaced by what it depends on: figures, reports, pages and trials.
    monkeypatch.setattr(report, "write", write)
    monkeypatch.setattr(style, "save", draw)
    monkeypatch.setattr(page, "View", Page)
    monkeypatch.setattr(link, "Link", Line)
    monkeypatch.setattr(link, "LinkPeer", Peer)
    monkeypatch.setattr(link, "EstimatedController", lambda found, *options: (found.name, fingerprint(options)))
    monkeypatch.setattr(served.webbrowser, "open", lambda url: print(f"opens {url}"))
    monkeypatch.setattr(tune, "_carry_out", lambda search, jobs, tell, task: print(search, jobs, tell, task))
    monkeypatch.setattr(search.Search, "finish", lambda _: [])
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    count = itertools.count()

    def carry_out(name, given):
        folder = tmp_path / str(next(count))
        folder.mkdir()
        if name == "train":
            shutil.copytree(files["run"], folder / "old")
        monkeypatch.chdir(folder)
        terminal = Terminal()
        calls.clear()
        monkeypatch.setattr(served, "time", Clock())
        monkeypatch.setattr("sys.stderr", terminal)
        try:
            code = main([name, *(word.format(old="old", **files) for word in given)])
        except SystemExit as exit_:
            code = exit_.code
        if code:
            raise ValueError(terminal.getvalue())
        text = untimed(capsys.readouterr().out)
        written = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
        names = [name for name in written if "tfevents" not in name]
        hashed = [name for name in names if Path(name).suffix not in (".zip", ".json", ".toml", ".log")]
        return [text, bool(terminal.getvalue()), calls, names, [written[name].read_bytes() for name in hashed]]

    return carry_out


def command_line(options):
    """Arguments of `CASES` as words: those without dashes first."""
    words = []
    for name, value in sorted(options.items(), key=lambda item: item[0].startswith("--")):
        for one in value if isinstance(value, list) else [] if value is None else [value]:
            words += [*([name] if name.startswith("--") else []), *one.split()]
    return tuple(words)


@pytest.mark.slow("all options of all commands")
@pytest.mark.parametrize("name", CASES)
def test_options_change_something(name, outcome):
    @functools.cache
    def cached(words):
        return fingerprint(outcome(name, words))

    first = command_line(CASES[name][0][0])
    assert cached(first) == fingerprint(outcome(name, first))
    found = []
    for base, others in CASES[name]:
        for option, value in others.items():
            found.append(changes(lambda **given: cached(command_line(given)), option, [value], base, NAMED.get(option)))
    assert not [wrong for wrong in found if wrong]


def test_every_option_is_listed():
    (commands,) = (action for action in parser()._actions if isinstance(action, argparse._SubParsersAction))
    missing = []
    for name, command in commands.choices.items():
        listed = {option for _, others in CASES[name] for option in others} | ELSEWHERE.get(name, set())
        known = {(action.option_strings or [action.dest])[-1] for action in command._actions} - {"--help"}
        missing += [(name, sorted(known ^ listed))] if known != listed else []
    assert not missing
