"""Terrains as files."""

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


def test_a_picture_of_others_needs_its_scale(tmp_path):
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


def test_what_cannot_be_written_is_refused(terrain, tmp_path):
    with pytest.raises(ValueError, match=r"written as \.xml, \.png, \.stl"):
        bb.write_terrain(terrain, tmp_path / "hills.obj")
    with pytest.raises(ValueError, match="no edges"):
        bb.write_terrain(bb.Terrain.plane(0.1), tmp_path / "plane.stl")
    with pytest.raises(ValueError, match="cell"):
        bb.write_terrain(terrain, tmp_path / "hills.stl", cell=-1.0)
    assert not list(tmp_path.iterdir())
