"""Terrains as files."""

import math
import os
import zlib

import numpy as np
import pytest

import ballbot_rs as bb

pytest.importorskip("PIL")


def hills(x, y):
    """Heights, m."""
    return 0.05 * np.sin(3.0 * x) * np.cos(2.0 * y) + 0.01 * x


@pytest.fixture
def terrain():
    """Twice as long along x as along y."""
    return bb.Terrain.from_function(hills, (4.0, 2.0), 0.02)


def test_a_picture_is_read_as_it_was_written(terrain, tmp_path):
    path = bb.write_terrain(terrain, tmp_path / "hills.png")
    again = bb.read_terrain(path)
    assert again.size == pytest.approx(terrain.size)
    x, y = np.meshgrid(np.linspace(-1.9, 1.9, 40), np.linspace(-0.9, 0.9, 20))
    # Of 65535 steps over 0.16 m.
    np.testing.assert_allclose(again.height(x, y), terrain.height(x, y), atol=3e-6)
    higher = bb.read_terrain(path, height=0.01, cell=0.05)
    assert higher.size == pytest.approx((10.0, 5.0))


def test_a_third_party_image_needs_its_scale(tmp_path):
    from PIL import Image

    gray = (128 + 100 * np.sin(np.linspace(0, 3, 60))[:, None] * np.ones(80)).astype(np.uint8)
    Image.fromarray(gray).save(tmp_path / "gray.png")
    with pytest.raises(ValueError, match="needs cell and height"):
        bb.read_terrain(tmp_path / "gray.png")
    read = bb.read_terrain(tmp_path / "gray.png", cell=0.1, height=0.2)
    # The first row is at the largest y.
    assert read.height(0.0, 2.9) == pytest.approx(0.2 * gray[0, 0] / 255, abs=2e-3)
    Image.fromarray(np.zeros((8, 8, 3), dtype=np.uint8)).save(tmp_path / "color.png")
    with pytest.raises(ValueError, match="one gray value"):
        bb.read_terrain(tmp_path / "color.png", cell=0.1, height=0.2)


#: Texts `ballbot` of an image that do not give its scale.
TEXTS = [
    "",
    "[]",
    "5",
    "null",
    "{}",
    "[" * 100_000,
    '{"cell": 0.1}',
    '{"cell": "a", "height": 1, "lowest": 0}',
    "{" * 9,
]


@pytest.mark.parametrize("text", TEXTS, ids=lambda text: text[:20])
def test_a_text_that_is_not_the_scale_is_rejected_where_it_is_needed(tmp_path, text):
    from PIL import Image, PngImagePlugin

    facts = PngImagePlugin.PngInfo()
    facts.add_text("ballbot", text)
    path = tmp_path / "odd.png"
    Image.fromarray(np.zeros((8, 8), dtype=np.uint8)).save(path, pnginfo=facts)
    for given in ({}, {"cell": 0.1}, {"height": 0.1}):
        with pytest.raises(bb.InvalidInputError, match=r"odd\.png: the text 'ballbot' .* give cell and height, m"):
            bb.read_terrain(path, **given)
    assert bb.read_terrain(path, cell=0.1, height=0.1).slope == 0.0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(bb.InvalidInputError, match=r"pipe\.png is not a regular file"):
        bb.read_terrain(tmp_path / "pipe.png", 0.1, 0.1)


def huge(path, columns, rows):
    """A PNG whose header promises a picture, without its pixels."""
    fields = columns.to_bytes(4, "big") + rows.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])

    def chunk(name, content):
        return len(content).to_bytes(4, "big") + name + content + zlib.crc32(name + content).to_bytes(4, "big")

    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", fields) + chunk(b"IDAT", zlib.compress(b"")))


@pytest.mark.parametrize("size", [(2049, 2048), (9000, 9000), (13_000, 13_000), (30_000, 30_000), (2**31 - 1, 1)])
@pytest.mark.filterwarnings("ignore:Image size")
def test_an_image_that_is_too_large_is_rejected_by_its_header(tmp_path, size):
    huge(tmp_path / "huge.png", *size)
    with pytest.raises(bb.InvalidInputError, match=r"huge\.png: the picture .* at most 4194304"):
        bb.read_terrain(tmp_path / "huge.png", 0.1, 0.1)


def test_files_that_are_not_images_are_rejected_by_name(tmp_path):
    path = tmp_path / "no.png"
    huge(path, 8, 8)
    without_pixels = path.read_bytes()
    for content in (b"", b"no picture", without_pixels, without_pixels[:30]):
        path.write_bytes(content)
        with pytest.raises(bb.InvalidInputError, match=r"no\.png: not a picture that Pillow reads"):
            bb.read_terrain(path, 0.1, 0.1)
    with pytest.raises(FileNotFoundError):
        bb.read_terrain(tmp_path / "none.png")
    Image = pytest.importorskip("PIL.Image")
    Image.fromarray(np.eye(8, dtype=np.uint8) * 255).save(path)
    for arguments, message in [
        ((0.01, 1.0), "slope of .* smooth or lower its heights, or take a larger cell"),
        ((0.1, math.inf), "height = inf"),
        ((-1.0, 0.1), "cell = -1"),
    ]:
        with pytest.raises(bb.InvalidInputError, match=rf"no\.png: .*{message}"):
            bb.read_terrain(path, *arguments)


def test_mujoco_reads_the_height_field(terrain, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path = bb.write_terrain(terrain, tmp_path / "hills.xml", cell=0.05)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for x, y in [(0.3, -0.4), (-1.7, 0.8), (1.2, 0.1)]:
        geom = np.zeros(1, dtype=np.int32)
        down = mujoco.mj_ray(model, data, [x, y, 2.0], [0.0, 0.0, -1.0], None, 1, -1, geom)
        # Facets of 5 cm are off by the curvature times the square of their edge over eight.
        assert 2.0 - down == pytest.approx(terrain.height(x, y), abs=4e-4)


def test_triangles_are_on_the_surface_and_face_up(terrain, tmp_path):
    path = bb.write_terrain(terrain, tmp_path / "hills.stl", cell=0.1)
    content = path.read_bytes()
    count = int(np.frombuffer(content[80:84], dtype="<u4")[0])
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.frombuffer(content[84:], dtype=kind)
    assert len(facets) == count == 2 * 40 * 20
    corners = facets["corners"].reshape(-1, 3).astype(float)
    np.testing.assert_allclose(corners[:, 2], terrain.height(corners[:, 0], corners[:, 1]), atol=1e-6)
    assert (facets["normal"][:, 2] > 0.8).all()


def test_terrains_that_cannot_be_written_are_rejected(terrain, tmp_path):
    with pytest.raises(ValueError, match=r"written as \.xml, \.png, \.stl"):
        bb.write_terrain(terrain, tmp_path / "hills.obj")
    with pytest.raises(ValueError, match="no edges"):
        bb.write_terrain(bb.Terrain.plane(0.1), tmp_path / "plane.stl")
    with pytest.raises(ValueError, match="cell"):
        bb.write_terrain(terrain, tmp_path / "hills.stl", cell=-1.0)
    assert not list(tmp_path.iterdir())
