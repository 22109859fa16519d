"""The `ballbot` command: what it prints, what it writes and how it fails."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from stable_baselines3 import PPO

from ballbot_rs import Params, __version__, _toml
from ballbot_rs.cli import COMMANDS as MODULES
from tests.support.in_process import parse_json, run
from tests.support.paths import ASSETS


def test_version(capsys):
    assert run(capsys, "--version") == (0, f"ballbot {__version__}\n", "")


def test_the_package_is_the_command():
    command = [sys.executable, "-m", "ballbot_rs", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == f"ballbot {__version__}\n"


COMMANDS = {module.__name__.rpartition(".")[2].replace("_", "-") for module in MODULES} - {"list-names"} | {"list"}
HELP = [["--help"], *([name, "--help"] for name in sorted(COMMANDS))]


@pytest.mark.parametrize("arguments", HELP)
def test_help(capsys, arguments):
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    assert "usage: ballbot" in out


@pytest.mark.parametrize("task", ["ballbot/Velocity-v0", "ballbot_rs:ballbot/Velocity-v0"])
def test_an_id_is_a_task_with_and_without_the_package_before_it(capsys, task):
    arguments = ("--controller", "lqr", "--episodes", "2", "--json", "--set", "max_episode_steps=5")
    named, by_id = run(capsys, "evaluate", "velocity", *arguments), run(capsys, "evaluate", task, *arguments)
    assert named[0] == by_id[0] == 0
    assert parse_json(named[1]) == parse_json(by_id[1])


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["evaluate", "ballbot_rs:ballbot/Walk-v0"],
        ["evaluate", "walk", "--controller", "lqr"],
        ["evaluate", "balance", "--controller", "lqr", "--episodes", "many"],
        ["train", "balance", "--bogus"],
        ["train", "walk"],
        ["plot", "lqr"],
    ],
)
def test_a_wrong_command_line_exits_with_2(capsys, arguments):
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert "usage: ballbot" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "balance", "--set", "total_timesteps=0"], "total_timesteps = 0 is out of range"),
        (["train", "balance", "--set", "policy.net_arch=[100000, 100000]"], "10001600000 weights, more than 10000000"),
        (["train", "balance", "--set", "policy.net_arch=[-5]"], "a width of -5 is out of range"),
        (["evaluate", "--episodes", "1", "--set", "max_episode_steps=1000000000000"], "more than 100000000"),
        (["train", "balance", "--config", "nowhere.toml"], "nowhere.toml"),
        (["train", "balance", "--resume", "nowhere"], "nowhere holds no training run"),
        (["train", "balance", "--resume", "nowhere", "--seed", "5"], "--seed cannot be combined with it"),
        (["train", "balance", "--resume", "nowhere", "--seed", "0"], "--seed cannot be combined with it"),
        (["train", "balance", "--resume", "nowhere", "--overwrite"], "--overwrite cannot be combined with it"),
        (
            ["evaluate", "balance", "--controller", "lqrr"],
            "no policy at lqrr: expected lqr, pid, lqi, lqr_pi, mpc, cascade_pid, hierarchical_sliding_mode, "
            "pd_inverse_dynamics, sliding_mode, fuzzy_mamdani, takagi_sugeno, admittance, mppi, nmpc, zero or "
            "the path of",
        ),
        (["evaluate", "balance", "--controller", "lqr", "--model", "flat"], "unknown model 'flat': expected one of"),
        (["view", "--model", "flat"], "unknown model 'flat': expected one of planar, spatial"),
        (["view", "--robot", "r2d2"], "r2d2"),
        (["view", "--controller", "run.zip"], "no policy at run.zip"),
        (["view", "--robot", "kugel"], "did you mean 'kugle'?"),
        (["evaluate", "--robot", "nowhere.toml"], "nowhere.toml"),
        (["evaluate", "--set", "control_dt"], "--set control_dt: expected NAME=VALUE"),
        (["train", "--set", "algorithm_argument.gamma=1"], "did you mean 'algorithm_arguments'?"),
        (["train", "--set", "env.model=rigid"], "omit the prefix env."),
        (["train", "--set", "max_wheel_torqe=1"], "did you mean 'max_wheel_torque'?"),
        (["train", "--set", "teacher.control=lqr"], "unknown key 'control'"),
        (["train", "--set", "evaluation.episode=3"], "did you mean 'episodes'?"),
        (["train", "--resume", "nowhere", "--model", "rigid"], "it takes no other values"),
        (["view", "--controller", "run.onnx"], "no policy at run.onnx"),
        (["view", "--urdf", "bot.urdf", "ball.urdf"], "bot.urdf"),
        (["view", "--urdf", "bot.urdf", "ball.urdf", "--robot", "kugle"], "--urdf and --robot are mutually exclusive"),
        (["view", "--events", "soft"], "unknown set of events 'soft': expected one of mild, hard"),
        (["view", "--events", "trained"], "events = 'trained': the controllers have no policy"),
        (["view", "--actuators", "nobody"], "unknown actuators 'nobody': expected one of ideal, kugle"),
        (["evaluate", "--actuators", "kuggle"], "ideal, kugle, FILE.toml, or FILE.urdf: did you mean 'kugle'?"),
        (["evaluate", "--model", "rigidd"], "did you mean 'rigid'?"),
        (["evaluate", "--events", "milde"], "did you mean 'mild'?"),
        (
            ["evaluate", "--set", "max_torque=1"],
            "--set max_torque: unknown option 'max_torque': did you mean 'max_wh",
        ),
        (["evaluate", "--set", "control_dt=5ms"], "values are in SI units and rad, without the unit: control_dt=0.005"),
        (["simulate", "--reference", "yaw=90deg"], "without the unit: yaw=1.5708"),
        (["evaluate", "--controller-option", "tilt=2deg"], "--controller-option tilt=2deg: values are in SI units"),
        (["evaluate", "--set", "zzz=1"], "unknown option 'zzz': expected one of robot, model"),
        (["view", "--set", "actuators.delay=0.003"], "actuators.delay / sim_dt = 1.5 is out of range"),
        (["evaluate", "--set", "params.body_mass=2"], "unknown option 'params': it is now robot="),
        (["evaluate", "--set", "body_mass=2"], "unknown option 'body_mass': did you mean 'robot.body_mass'?"),
        (["evaluate", "--set", "robot.body_mass"], "--set robot.body_mass: expected NAME=VALUE"),
        (["evaluate", "--set", "robot.body_mas=2"], "did you mean 'body_mass'?"),
        (["evaluate", "--set", "actuators.dela=1"], "did you mean 'delay'?"),
        (["evaluate", "--set", "terrain=noise", "--set", "terrain.slop=0.1"], "did you mean 'slope'?"),
        (["evaluate", "--set", "reward.positon=1"], "did you mean 'position'?"),
        (["evaluate", "--set", "setpoint.x=1"], "'setpoint' has no parts: expected one of robot.NAME, actuators.NAME"),
        (["evaluate", "--model", "rigid", "--set", "model=spatial"], "model is also given by a separate argument"),
        (["compare", "--set", "body_mass=2"], "expected robot.NAME=VALUE: did you mean 'robot.body_mass'?"),
        (["compare", "--sweep", "body_mas=2,3"], "unknown option 'body_mas': did you mean 'body_mass'?"),
        (["compare", "--sweep", "body_mass"], "--sweep body_mass: expected NAME=V1,V2,..."),
        (["compare", "--checkpoint", "a.json"], "--checkpoint needs a sweep: add --sweep NAME=V1,V2,..."),
        (
            ["evaluate", "--sweep", "body_mass=2", "--value", "tilt"],
            "tilt: unknown column: did you mean 'tilt_rms'?",
        ),
        (["evaluate", "--sweep", "body_mass=2", "-o", "a.txt"], "a.txt: the name must end in .csv for numbers"),
        (["evaluate", "--sweep", "body_mass=2", "--sweep", "body_mass=3"], "body_mass is swept twice"),
        (["compare", "S3-slwo"], "S22-6s: did you mean 'S3-slow'?"),
        (["record", "--robot", "paper", "--set", "robot.body_mass=-1"], "body_mass = -1 is out of range"),
        (["plot", "--robot", "paper", "--set", "robot.mass=2"], "unknown parameter 'mass': expected one of ball_mass"),
    ],
)
def test_an_error_exits_with_1_and_one_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *arguments)
    assert code == 1
    assert out == ""
    assert err.startswith("ballbot: ")
    assert message in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [], "a rejected command left files behind"


def test_an_unknown_configuration_key_exits_with_1(capsys, tmp_path, tiny_config):
    tiny_config.write_text("total_timestep = 5", encoding="utf-8")
    code, _, err = run(capsys, "train", "balance", "--config", tiny_config, "--run", tmp_path / "run")
    assert code == 1
    assert "tiny.toml: unknown key 'total_timestep': expected one of env_id" in err
    assert not (tmp_path / "run").exists()


def test_evaluate_prints_a_table(capsys):
    controllers = ["--controller", "lqr", "--controller", "zero"]
    code, out, err = run(capsys, "evaluate", "balance", *controllers, "--episodes", 3, "--model", "spatial")
    assert (code, err) == (0, "")
    header, units, rule, *rows = out.split("\n\n")[0].splitlines()
    assert "success" in header
    assert units.split() == ["Hz", "s", "deg", "m", "N·m"]
    assert set(rule) == {"-", " "}
    assert [row.split()[0] for row in rows] == ["lqr", "zero"]
    assert "100 %" in rows[0]
    assert "never" in rows[1]


def test_evaluate_prints_json(capsys, tiny_run):
    names = ["pid", "lqr", "zero", str(tiny_run)]
    controllers = [argument for name in names for argument in ("--controller", name)]
    code, out, err = run(capsys, "evaluate", "balance", *controllers, "--episodes", 2, "--seed", 7, "--json")
    assert (code, err) == (0, "")
    report = parse_json(out)
    assert report["env_id"] == "ballbot/Balance-v0"
    assert report["seed"] == 7
    assert report["ballbot_rs"] == __version__
    assert [result["controller"] for result in report["results"]] == names
    assert [result["model"] for result in report["results"]] == ["spatial"] * 4
    assert all(result["episodes"] == 2 for result in report["results"])
    assert report["results"][2]["settling_time"] is None
    assert report["results"][1]["survival_rate"] == 1.0


def test_train_with_the_default_configuration(capsys, tmp_path):
    folder = tmp_path / "run"
    code, out, err = run(
        capsys,
        "train", "balance", "--timesteps", 8192 * 2, "--run", folder, "--quiet", "--json", "--episodes", 2, "--seed", 3,
        "--no-report",
    )  # fmt: skip
    # So few steps are not enough.
    assert (code, err.count("\n")) == (1, 1)
    assert err.startswith("ballbot: the training has failed: after 16384 steps the best policy succeeds in ")
    report = parse_json(out)
    # Too short for intermediate evaluations: the evaluation at the end decides.
    assert Path(report["policy"]) == folder / "best_model.zip"
    assert report["seconds"] > 0
    assert [result["controller"] for result in report["results"]] == [report["policy"], "lqr", "pid"]
    assert PPO.load(report["policy"]).num_timesteps == 8192 * 2
    assert "total_timesteps = 16384" in (folder / "config.toml").read_text(encoding="utf-8")
    assert json.loads((folder / "run.json").read_text())["seed"] == 3


def test_train_resume_and_overwrite(capsys, tmp_path, tiny_config):
    folder = tmp_path / "run"
    train = ["train", "balance", "--config", tiny_config, "--run", folder, "--quiet", "--episodes", 0, "--no-report"]
    code, out, err = run(capsys, *train)
    assert (code, err) == (0, "")
    assert f"best policy: {folder / 'best_model.zip'}" in out
    code, _, err = run(capsys, *train)
    assert code == 1
    assert all(option in err for option in ("holds an earlier run", "--resume", "--overwrite", "--run"))
    assert "saved" not in err, "a rejected run has saved nothing"
    assert err.count("\n") == 1
    longer = (folder / "config.toml").read_text(encoding="utf-8").replace("768", "1024")
    (folder / "config.toml").write_text(longer, encoding="utf-8")
    assert run(capsys, "train", "balance", "--resume", folder, "--quiet", "--episodes", 0, "--no-report")[0] == 0
    assert PPO.load(folder / "final_model.zip").num_timesteps == 1024
    kept = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    rejected = {
        ("velocity", "--resume", folder): f"{folder} is a run of balance, not of velocity",
        ("--resume", folder, "--timesteps", 700): "timesteps = 700: the run has already done 1024 steps",
    }
    for arguments, output in rejected.items():
        code, _, err = run(capsys, "train", *arguments, "--quiet")
        assert (code, output in err) == (1, True), err
        assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == kept
    assert run(capsys, *train, "--overwrite")[0] == 0
    assert PPO.load(folder / "final_model.zip").num_timesteps == 768


def test_a_run_of_another_task_is_resumed_without_its_name(capsys, tmp_path, tiny_config):
    config = tiny_config.read_text(encoding="utf-8").replace("Balance", "Velocity")
    tiny_config.write_text(config, encoding="utf-8")
    shown = ("--quiet", "--episodes", 0, "--no-report")
    code, _, err = run(capsys, "train", "velocity", "--config", tiny_config, "--run", tmp_path / "run", *shown)
    assert code == 0, err
    code, _, err = run(capsys, "train", "--resume", tmp_path / "run", "--timesteps", 1024, *shown)
    assert code == 0, err


def test_train_compares_on_the_environment_that_was_trained_on(capsys, tmp_path, tiny_config):
    shown = ("--json", "--episodes", 2, "--no-report")
    code, out, _ = run(capsys, "train", "balance", "--config", tiny_config, "--run", tmp_path / "run", *shown)
    assert code == 0
    report = parse_json(out)
    assert [result["model"] for result in report["results"]] == ["spatial"] * 3
    code, out, _ = run(capsys, "train", "balance", "--resume", tmp_path / "run", *shown)
    assert [result["model"] for result in parse_json(out)["results"]] == ["spatial"] * 3


def test_an_interrupt_exits_with_130(capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ballbot_rs.cli.commands.evaluate.compare", interrupt)
    code, _, err = run(capsys, "evaluate", "balance", "--controller", "lqr")
    assert (code, err) == (130, "interrupted\n")


def test_the_installed_command():
    script = shutil.which("ballbot", path=str(Path(sys.executable).parent))
    assert script is not None, "the package's console script is not installed"
    command = [script, "evaluate", "balance", "--controller", "lqr", "--episodes", "1", "--model", "planar", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert parse_json(done.stdout)["results"][0]["success_rate"] == 1.0
    failed = subprocess.run([script, "evaluate", "balance", "--controller", "x"], capture_output=True, timeout=300)
    assert failed.returncode == 1
    assert b"Traceback" not in failed.stderr


def test_without_a_command_the_help_is_printed(capsys):
    code, out, err = run(capsys)
    assert (code, err) == (0, "")
    assert "usage: ballbot" in out
    assert "evaluate" in out


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["recrod"], "did you mean 'record'?"),
        (["evaluate", "--import", "x.py"], "it goes before the command, ballbot --import MODULE evaluate ..."),
        (["record", "--controler", "lqr"], "unknown option --controler: did you mean '--controller'?"),
        (["evaluate", "balance", "goal"], "ballbot evaluate: unexpected argument: goal"),
        (["evaluate", "balanse"], ": did you mean 'balance'?"),
        (["plot", "pid"], "a controller is named by --controller pid"),
        (["plot", "--figure", "trajectory"], "did you mean 'trajectories'?"),
        (["list", "polices"], "did you mean 'policies'?"),
    ],
)
def test_a_misspelt_word_suggests_the_closest_word(capsys, arguments, hint):
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert hint in err
    if len(arguments) > 1:
        assert f"usage: ballbot {arguments[0]}" in err


SHARED = ("--controller", "--model", "--robot", "--set", "--actuators")


def test_shared_options_are_the_same_and_in_the_same_order_everywhere(capsys):
    shown = {}
    for command in ("evaluate", "plot", "record", "view"):
        _, out, _ = run(capsys, command, "--help")
        positions = [out.index(f"  {flag} ") for flag in SHARED]
        assert positions == sorted(positions), command
        assert out.index("TASK") < positions[0]
        start = out.index("  --model")
        shown[command] = out[start : out.index("  --actuators")]
    assert len(set(shown.values())) == 1
    for command in ("record", "plot", "report", "export"):
        assert "-o " in run(capsys, command, "--help")[1]


def test_evaluate_accepts_a_robot_by_name_or_file(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(_toml.dumps(Params.preset("kugle").to_dict()), encoding="utf-8")
    results = []
    for robot in ("kugle", file):
        arguments = ("--robot", robot, "--model", "spatial", "--episodes", 2, "--json")
        code, out, err = run(capsys, "evaluate", *arguments)
        assert (code, err) == (0, "")
        results.append(parse_json(out)["results"])
    assert results[0] == results[1]
    _, out, _ = run(capsys, "evaluate", "--model", "spatial", "--episodes", 2, "--json")
    assert results[0] != parse_json(out)["results"]


def test_a_parameter_of_the_command_line_equals_a_parameter_of_a_file(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    changed = Params.preset("kugle").replace(body_mass=12.0, body_com_offset=(0.01, -0.002))
    file.write_text(_toml.dumps(changed.to_dict()), encoding="utf-8")
    results = []
    for robot in (
        ("--robot", file),
        ("--robot", "kugle", "--set", "robot.body_mass=12", "--set", "robot.body_com_offset=[0.01, -0.002]"),
        ("--robot", file, "--set", "robot.body_mass=12.0"),
        ("--set", "robot=kugle", "--set", "robot.body_mass=12", "--set", "robot.body_com_offset=[0.01, -0.002]"),
        ("--robot", "kugle"),
    ):
        code, out, err = run(capsys, "evaluate", *robot, "--model", "spatial", "--episodes", 2, "--json")
        assert (code, err) == (0, "")
        results.append(parse_json(out)["results"])
    assert results[0] == results[1] == results[2] == results[3] != results[4]


@pytest.mark.parametrize(
    "arguments", [["list"], ["info"], ["compare", "--list"], *([name, "--help"] for name in sorted(COMMANDS))]
)
def test_what_is_printed_fits_100_columns(capsys, monkeypatch, arguments):
    monkeypatch.setenv("COLUMNS", "100")
    code, out, _ = run(capsys, *arguments)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 100


def test_view_randomizes_robots_and_has_motors(capsys, monkeypatch, tmp_path):
    pytest.importorskip("viser")
    from ballbot_rs.viewer.session import opening

    (tmp_path / "events.toml").write_text('[[events]]\nterm = "body_mass"\nrange = [2.5, 2.6]\n')
    (tmp_path / "motors.toml").write_text("[actuators]\ndelay = 0.004\n")
    sessions = []

    def session(*arguments, **options):
        sessions.append(Session(*arguments, **options))
        return sessions[-1]

    Session = opening.Session
    monkeypatch.setattr(opening, "Session", session)
    given = ["--events", tmp_path / "events.toml", "--actuators", tmp_path / "motors.toml", "--batch", 2]
    for seed in (3, 3, 4):
        page = ["--seconds", 0.1, "--no-open", "--port", 18765]
        code, _, err = run(capsys, "view", *given, "--seed", seed, *page)
        assert (code, err) == (0, "")
    drawn = [[one.robots[robot].params.body_mass for robot in range(2)] for one in sessions]
    assert drawn[0] == drawn[1]
    assert drawn[0][1] == drawn[2][0]
    assert all(2.5 <= mass <= 2.6 for masses in drawn for mass in masses)
    assert sessions[0].robots[1].motors == {"delay": 0.004}


def test_the_table_fits_100_columns(capsys, tiny_run):
    names = ["--controller", tiny_run, "--controller", "lqr"]
    code, out, _ = run(capsys, "evaluate", *names, "--episodes", 1)
    assert code == 0
    assert max(map(len, out.splitlines())) <= 100


def test_the_table_ends_with_all_conditions_that_are_not_default(capsys):
    options = ["--events", "mild", "--set", "reset_tilt=0.02", "--set", "actuators.delay=0.01"]
    code, out, _ = run(capsys, "evaluate", "--episodes", 2, "--set", "robot.body_mass=2", *options)
    assert code == 0
    text = " ".join(out.split())
    robot = "robot paper with body_mass = 2"
    assert (
        f"2 episodes each, model contact, {robot}, actuators delay = 0.01, events mild, reset_tilt = 0.02. Success"
        in text
    )
    assert "over the last 2 s tilt within 1 deg and ball within 0.1 m of the setpoint." in text
    assert "pid" not in text
    code, out, _ = run(capsys, "evaluate", "--episodes", 1, "--controller", "pid", "--set", "success_radius=0.2")
    text = " ".join(out.split())
    assert "1 episodes each, model contact, success_radius = 0.2. Success" in text
    assert "ball within 0.2 m" in text
    assert "pid controls only the tilt: the ball drifts away" in text


def test_plot_randomizes_robots_with_events(capsys, tmp_path):
    drawn = ("plot", "--events", "hard", "--seed", 3, "--seconds", 0.1, "--json", "-o", tmp_path)
    code, out, _ = run(capsys, *drawn)
    assert code == 0
    assert {Path(file).stem for file in parse_json(out)["files"]} == {"trajectories", "phase_portrait"}
    code, _, err = run(capsys, *drawn, "--figure", "recovery_map")
    assert code == 1
    assert "a recovery map is for one robot" in err


def test_the_rate_of_the_pid_does_not_depend_on_what_it_is_compared_with(capsys, tiny_run):
    def rates(*arguments):
        code, out, _ = run(capsys, "evaluate", "--episodes", 1, "--json", *arguments)
        assert code == 0
        return [result["control_dt"] for result in parse_json(out)["results"]]

    both = ("--controller", tiny_run, "--controller", "pid")
    assert rates("--controller", "pid") == [0.002]
    assert rates(*both) == [0.01, 0.002]
    assert rates(*both, "--set", "control_dt=0.004") == [0.004, 0.004]


def test_completion_without_shtab_names_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, _, err = run(capsys, "--print-completion", "bash")
    assert code == 1
    assert "needs shtab: install it with `pip install" in err


def test_view_accepts_a_training_run(capsys, tiny_run):
    pytest.importorskip("viser")
    arguments = ["--batch", 1, "--seconds", 0.5, "--no-open", "--port", 18760]
    code, out, err = run(capsys, "view", "--controller", tiny_run, *arguments)
    assert (code, err) == (0, "")
    assert f"1 robot paper, spatial, {tiny_run}" in out


@pytest.mark.parametrize(("name", "content"), [("x.dae", "<junk"), ("x.qqq", "hi"), ("x.obj", None)])
def test_view_names_a_urdf_whose_mesh_cannot_be_read(capsys, tmp_path, assets, name, content):
    pytest.importorskip("viser")
    shutil.copytree(assets / "meshes", tmp_path / "meshes")
    text = (assets / "bot.urdf").read_text(encoding="utf-8")
    assert "meshes/body_ring.stl" in text
    (tmp_path / "bot.urdf").write_text(text.replace("meshes/body_ring.stl", f"meshes/{name}"), encoding="utf-8")
    if content is not None:
        (tmp_path / "meshes" / name).write_text(content, encoding="utf-8")
    urdfs = [tmp_path / "bot.urdf", assets / "ball.urdf"]
    code, out, err = run(capsys, "view", "--urdf", *urdfs, "--no-open", "--seconds", 0.1, "--port", 18780)
    assert (code, out) == (1, "")
    missing = "ballbot: meshes/x.obj: No such file"
    assert err.startswith(missing if content is None else f"ballbot: {urdfs[0]} and {urdfs[1]} cannot be shown: ")
    assert err.count("\n") == 1


def test_a_policy_in_place_of_the_task_is_compared_with_controllers(capsys):
    policy = str(ASSETS / "policies" / "balance.onnx")
    code, out, _ = run(capsys, "evaluate", policy, "--controller", "lqr", "--episodes", "2", "--json")
    assert code == 0
    assert [result["controller"] for result in json.loads(out)["results"]] == [policy, "lqr"]
