"""What the package carries, what it imports, and which module may import what."""

import ast
import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

import ballbot_rs
from ballbot_rs import _assets
from tests.support.paths import ASSETS, ROOT

PACKAGE = Path(ballbot_rs.__file__).parent
MODULES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))

#: Modules that may import torch and Stable-Baselines3; nothing else may, so that the core runs without them.
LEARNING = {
    "control/sb3_archive.py",
    "control/sb3_policy.py",
    "control/sb3_recurrent.py",
    "envs/_sb3_functions.py",
    "optimal/differentiable_torch.py",
    "envs/sb3.py",
    "envs/sb3_grouped.py",
    "training/callbacks.py",
    "training/checkpoint.py",
    "training/export.py",
    "training/on_ray/connector.py",
    "training/on_ray/learn.py",
    "training/on_ray/module.py",
    "training/refinement.py",
    "training/run_state.py",
    "training/scaled_rewards.py",
    "training/teacher.py",
    "training/teacher_errors.py",
    "training/teacher_rounds.py",
    "training/teacher_sequences.py",
    "training/tied.py",
    "training/train.py",
}


def run_python(code):
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300, check=True
    ).stdout


def test_importing_the_package_imports_no_learner():
    code = """
import sys, gymnasium, ballbot_rs
env = gymnasium.make("ballbot/Balance-v0")
env.reset(seed=0)
gymnasium.make_vec("ballbot/Balance-v0", 2).reset()
import ballbot_rs.analysis.episodes, ballbot_rs.cli
ballbot_rs.cli.parser()
ballbot_rs.analysis.episodes.evaluate("lqr", episodes=1, model="planar")
heavy = {"torch", "jax", "stable_baselines3", "tensorboard", "matplotlib", "viser", "trimesh"}
print(sorted({m.split(".")[0] for m in sys.modules} & heavy))
"""
    assert run_python(code).strip() == "[]"


@pytest.mark.parametrize(
    ("use", "message"),
    [
        ("ballbot_rs.BallbotVecEnv", "BallbotVecEnv needs torch: install it with `pip install -e '.[train]'`"),
        ("main(['train', 'balance'])", "training needs torch: install it with `pip install -e '.[train]'`"),
        (
            "main(['evaluate', 'balance', '--controller', 'x.zip'])",
            "a policy file needs torch: install it with `pip install -e '.[train]'`",
        ),
        (
            "ballbot_rs.DifferentiableJaxBatch",
            "DifferentiableJaxBatch needs jax: install it with `pip install -e '.[jax]'`",
        ),
        ("ballbot_rs.show", "show needs viser: install it with `pip install -e '.[view]'`"),
        ("main(['view'])", "the page needs viser: install it with `pip install -e '.[view]'`"),
    ],
)
def test_without_the_learner_the_message_names_what_to_install(use, message):
    code = f"""
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        hidden = {{"torch": "torch", "jax": "jax", "stable_baselines3": "torch", "viser": "viser"}}
        if name.split(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=hidden[name.split(".")[0]])
sys.meta_path.insert(0, Hidden())
sys.stderr = sys.stdout
import ballbot_rs
from ballbot_rs.cli import main
try:
    {use}
except ModuleNotFoundError as error:
    print(error)
"""
    assert message in run_python(code)


def test_version_matches_the_installed_package():
    assert ballbot_rs.__version__ == importlib.metadata.version("ballbot-rs")


def test_type_information_is_shipped():
    assert (PACKAGE / "py.typed").is_file()
    assert (PACKAGE / "_core.pyi").is_file()


def test_a_clone_contains_its_assets():
    assets = ASSETS
    for name in ("bot.urdf", "ball.urdf", "policies/balance.onnx"):
        assert _assets.path(name) == assets / name
    with pytest.raises(FileNotFoundError, match=r"'robot\.urdf'.*does not exist"):
        _assets.path("robot.urdf")


def test_the_stub_names_what_the_extension_has():
    tree = ast.parse((PACKAGE / "_core.pyi").read_text(encoding="utf-8"))
    stubbed = {node.name for node in tree.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    stubbed |= {node.target.id for node in tree.body if isinstance(node, ast.AnnAssign)}
    from ballbot_rs import _core

    public = {name for name in dir(_core) if not name.startswith("_")}
    assert public <= stubbed
    assert {name for name in stubbed if not name.startswith("_")} <= public


def imports_of(module):
    tree = ast.parse((PACKAGE / module).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} has a relative import"
            yield node.module


@pytest.mark.parametrize("module", MODULES)
def test_imports_go_downwards(module):
    roots = {name.split(".")[0] for name in imports_of(module)}
    if module not in LEARNING:
        assert not roots & {"torch", "stable_baselines3"}
    if module != "optimal/differentiable_jax.py":
        assert "jax" not in roots
    if not module.startswith("training/on_ray/"):
        assert "ray" not in roots
    if not module.startswith("media/figures/"):
        assert "matplotlib" not in roots
    own = {name for name in imports_of(module) if name.startswith("ballbot_rs.")}
    if not module.startswith(("cli/", "__main__")):
        assert not any(name.startswith("ballbot_rs.cli") for name in own), "only the command line depends on itself"
    if module.startswith("envs/"):
        assert all(name.startswith(("ballbot_rs._", "ballbot_rs.envs.")) for name in own), "environments are the base"
    if module.startswith("control/"):
        assert all(name.startswith(("ballbot_rs._", "ballbot_rs.envs.", "ballbot_rs.control")) for name in own)


def test_the_list_of_learning_modules_is_current():
    for module in LEARNING:
        roots = {name.split(".")[0] for name in imports_of(module)}
        assert roots & {"torch", "stable_baselines3"}, f"{module} needs no exception any more"


def test_messages_of_an_installed_package_install_from_the_index(tmp_path, monkeypatch):
    from ballbot_rs import _extras

    monkeypatch.chdir(ROOT)
    assert _extras.install_hint("view", "onnx") == "pip install -e '.[view,onnx]'"
    monkeypatch.chdir(tmp_path)
    assert _extras.install_hint("view") == f"pip install -e '{ROOT}[view]'"
    monkeypatch.setattr(_extras, "__file__", str(tmp_path / "site-packages" / "ballbot_rs" / "_extras.py"))
    message = r"a page needs no_such: install it with `pip install 'ballbot-rs\[view\]'`"
    with pytest.raises(ModuleNotFoundError, match=message), _extras.require("a page", "view"):
        import no_such.module  # noqa: F401
