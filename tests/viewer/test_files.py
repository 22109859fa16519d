"""Files that a URDF names: devices, pipes and files of any size are rejected at once."""

import os
import re
import threading

import pytest

pytest.importorskip("viser", reason="the page is not tested: install 'ballbot-rs[view]'")

from ballbot_rs import Params
from ballbot_rs._reading import read_regular
from ballbot_rs.viewer.scene import urdf
from tests.support.paths import ASSETS

unix = pytest.mark.skipif(os.name != "posix", reason="devices and pipes as files are specific to Unix")


def within(seconds, function):
    """The exception of a function, which must come in time."""
    found = []

    def run():
        try:
            function()
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    assert found, "no error in time"
    return found[0]


def with_mesh(tmp_path, mesh):
    bot = tmp_path / "bot.urdf"
    text = (ASSETS / "bot.urdf").read_text()
    assert "meshes/body_plates.stl" in text
    bot.write_text(
        text.replace('"meshes/', f'"{ASSETS}/meshes/').replace(f"{ASSETS}/meshes/body_plates.stl", str(mesh))
    )
    return lambda: urdf.from_urdf(Params.paper(), bot, ASSETS / "ball.urdf")


@unix
@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_a_mesh_that_is_not_a_regular_file_is_rejected(tmp_path, kind):
    path = {"device": "/dev/zero", "pipe": tmp_path / "pipe.stl", "folder": tmp_path}[kind]
    if kind == "pipe":
        os.mkfifo(path)
    error = within(5.0, with_mesh(tmp_path, path))
    assert isinstance(error, ValueError | IsADirectoryError)
    assert str(path) in str(error)


@unix
def test_a_urdf_that_is_a_pipe_or_a_device_is_rejected(tmp_path):
    pipe = tmp_path / "bot.urdf"
    os.mkfifo(pipe)
    for path in (pipe, ASSETS.parent.__class__("/dev/zero")):
        error = within(5.0, lambda path=path: urdf.from_urdf(Params.paper(), path, ASSETS / "ball.urdf"))
        assert str(error) == f"{path} is not a regular file"


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (b"", "no triangles|not a readable mesh"),
        (b"solid nothing\nendsolid\n", "no triangles|not a readable mesh"),
        (80 * b" " + (2**32 - 1).to_bytes(4, "little") + 100 * b"\0", "no triangles|not a readable mesh"),
        (b"\xff" * 200, "not a readable mesh|not finite|no triangles"),
    ],
)
def test_a_mesh_that_is_malformed_is_rejected(tmp_path, contents, message):
    path = tmp_path / "mesh.stl"
    path.write_bytes(contents)
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}.*({message})"):
        with_mesh(tmp_path, path)()


def test_the_limits_of_size_hold(tmp_path, monkeypatch):
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ValueError, match=f"{path} has more than 1000 bytes, the limit"):
        read_regular(path, 1000)
    path.write_bytes(b"12345")
    assert read_regular(path, 5) == b"12345"
    monkeypatch.setattr(urdf, "MAX_TRIANGLES", 3)
    with pytest.raises(ValueError, match=r"\.stl has \d+ triangles, limit 3"):
        urdf.from_urdf(Params.paper(), ASSETS / "bot.urdf", ASSETS / "ball.urdf")


def test_a_mesh_opens_no_other_file(tmp_path):
    """An OBJ names a file of materials, here a pipe that would be waited for."""
    mesh = tmp_path / "mesh.obj"
    mesh.write_text("mtllib pipe.mtl\nusemtl x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    if os.name == "posix":
        os.mkfifo(tmp_path / "pipe.mtl")
    done = threading.Event()
    load = with_mesh(tmp_path, mesh)
    threading.Thread(target=lambda: (load(), done.set()), daemon=True).start()
    assert done.wait(10.0)
