"""The source distribution compiles by itself, the packaged crates are complete, the wheel works outside the clone."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tools.check_wheel import check

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
#: Of this worker: another worker may run the other tests.
BUILT = TARGET / "distribution" / os.environ.get("PYTEST_XDIST_WORKER", "alone")

pytestmark = [
    pytest.mark.slow("compiles and packages"),
    pytest.mark.skipif(
        shutil.which("cargo") is None or importlib.util.find_spec("maturin") is None, reason="needs cargo and maturin"
    ),
]


def run(*command, cwd=ROOT):
    # One target folder, so that dependencies are compiled once.
    environment = {**os.environ, "CARGO_TARGET_DIR": str(TARGET)}
    ended = subprocess.run([*map(str, command)], cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def empty_folder(name):
    folder = BUILT / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


@pytest.fixture(scope="module")
def source():
    """The source distribution, unpacked."""
    archives, folder = empty_folder("archives"), empty_folder("source")
    run(sys.executable, "-m", "maturin", "sdist", "--out", archives)
    (archive,) = archives.iterdir()
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (unpacked,) = folder.iterdir()
    return unpacked


@pytest.fixture(scope="module")
def wheel():
    """The folder in which only the wheel is installed."""
    wheels, folder = empty_folder("wheels"), empty_folder("installed")
    build = ("build", "--release", "--locked", "--offline", "--compatibility", "linux", "--out", wheels)
    run(sys.executable, "-m", "maturin", *build)
    (file,) = wheels.iterdir()
    assert "-cp310-abi3-" in file.name
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", folder, file)
    return folder


def locked(folder):
    return set(re.findall(r'name = "(.*)"\nversion = "(.*)"', (folder / "Cargo.lock").read_text()))


def files(folder, pattern="*"):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob(pattern) if path.is_file()}


def test_the_source_distribution_has_presets_meshes_and_licenses(source):
    for folder in ("crates/ballbot-base/robots", "assets/meshes"):
        assert files(source / folder) == files(ROOT / folder) != {}
    for name in ("README.md", "LICENSE-MIT", "LICENSE-APACHE", "Cargo.lock", "assets/bot.urdf", "assets/ball.urdf"):
        assert (source / name).read_bytes() == (ROOT / name).read_bytes()
    assert not files(source, "*.so")


def test_the_source_distribution_compiles_in_an_empty_folder(source):
    crates = [folder.name for folder in (source / "crates").iterdir()]
    for crate in crates:
        # A file that is older than what an earlier run has compiled counts as compiled.
        (source / "crates" / crate / "src/lib.rs").touch()
    # Cargo takes a crate at this path to be the crate of the clone, already compiled, unless the profiles differ.
    profile = [option for crate in crates for option in ("--config", f"profile.dev.package.{crate}.debug=1")]
    # Without --locked: cargo drops from the lock file what only tests and benchmarks need, and those are not shipped.
    run("cargo", "check", "--offline", "--package", "ballbot-py", *profile, cwd=source)
    assert locked(source) <= locked(ROOT)


def test_the_packaged_crates_have_their_files():
    crates = [folder for folder in (ROOT / "crates").iterdir() if folder.name != "ballbot-py"]
    for crate in crates:
        listed = run("cargo", "package", "--package", crate.name, "--list", "--offline", "--allow-dirty").split()
        data = {
            f"{path.parent.name}/{path.name}" for kind in ("robots", "events") for path in crate.glob(f"{kind}/*.toml")
        }
        assert set(listed) >= data | {"LICENSE-MIT", "LICENSE-APACHE", "src/lib.rs"}
        assert not any(name.startswith(("tests/", "benches/")) for name in listed)
    packages = [option for crate in crates for option in ("--package", crate.name)]
    run("cargo", "package", *packages, "--locked", "--offline", "--allow-dirty", "--no-verify")


def test_the_wheel_carries_its_data(wheel):
    shipped = files(wheel / "ballbot_rs" / "assets")
    expected = ["bot.urdf", "ball.urdf", "policies/balance.onnx"]
    expected += [path.relative_to(ROOT / "assets").as_posix() for path in (ROOT / "assets/meshes").iterdir()]
    assert shipped == {name: (ROOT / "assets" / name).read_bytes() for name in expected}


def test_the_wheel_runs_the_first_example_of_the_readme_outside_the_clone(wheel):
    printed = check([sys.executable], wheel)
    for words in ("bot.urdf", "preset kugle 16.154", "wheel loads"):
        assert words in printed
