"""The meshes next to the URDFs: closed, with the size, mass and inertia of the record and of Table II."""

import json
import math
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from ballbot_rs import Params, Renderer, State
from cad import materials
from cad.materials import PETG, RUBBER
from cad.parameters import BALL, BODY, KEEPER, TABLE_II, WHEEL
from tests.support.paths import ASSETS, ROOT

RECORD = json.loads((ROOT / "cad" / "mass_properties.json").read_text(encoding="utf-8"))
BOT = ASSETS / "bot.urdf"
MESHES = sorted((ASSETS / "meshes").glob("*.stl"))
#: What a solid may lose to the flat triangles: the rollers are the smallest round things, cut most coarsely.
VOLUME = 0.03
ROLLERS = 0.08


def read_stl(path):
    """Corners, (n, 3, 3), m."""
    content = path.read_bytes()
    rows = np.frombuffer(content[84:], dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    assert len(rows) == int.from_bytes(content[80:84], "little")
    return rows["corners"].astype(float)


def moments(triangles):
    """Volume, center and second moments about the origin: sums over tetrahedra from the origin."""
    volumes = np.linalg.det(triangles) / 6.0
    volume = volumes.sum()
    total = triangles.sum(axis=1)
    center = volumes @ total / (4.0 * volume)
    second = np.einsum("n,ni,nj->ij", volumes, total, total) + np.einsum("n,nki,nkj->ij", volumes, triangles, triangles)
    return volume, center, second / 20.0


def weighed(link):
    """Mass, center of mass and inertia about it of a link's meshes with the densities of the record."""
    found = [
        (RECORD["meshes"][path.stem]["density"], *moments(read_stl(path)))
        for path in MESHES
        if path.stem.startswith(link)
    ]
    mass = sum(density * volume for density, volume, _, _ in found)
    center = sum(density * volume * at for density, volume, at, _ in found) / mass
    second = sum(density * moment for density, _, _, moment in found) - mass * np.outer(center, center)
    return mass, center, np.trace(second) * np.eye(3) - second


def test_the_record_names_the_meshes_that_are_there():
    on_disk = {path.stem for path in MESHES}
    shown = {Path(mesh.get("filename")).stem for mesh in ET.parse(BOT).iter("mesh")}
    assert on_disk == shown == set(RECORD["meshes"])
    densities = {m.name: m.density for m in vars(materials).values() if isinstance(m, materials.Material)}
    assert all(mesh["density"] == densities[mesh["material"]] for mesh in RECORD["meshes"].values())


@pytest.mark.parametrize("name", TABLE_II)
def test_recorded_masses_match_table_ii(name):
    assert RECORD["table_ii"][name] == pytest.approx(TABLE_II[name], rel=0.02)


def test_the_table_matches_the_preset(paper):
    expected = {
        "M_b": paper.body_mass,
        "l": paper.body_com_height,
        "J_b": paper.body_inertia[0],
        "J_z": paper.body_inertia[2],
        "wheel mass": paper.wheel_mass,
        "J_w": paper.wheel_inertia,
        "M_k": paper.ball_mass,
        "J_k": paper.ball_inertia,
    }
    assert expected == TABLE_II
    assert 1e3 * paper.ball_radius == BALL.radius
    assert 1e3 * paper.wheel_radius == WHEEL.radius
    assert math.radians(WHEEL.zenith) == pytest.approx(paper.wheel_zenith)


def test_recorded_links_add_up_to_the_recorded_table():
    body, wheel, ball = (RECORD["links"][link] for link in ("body", "wheel", "ball"))
    table = RECORD["table_ii"]
    masses, reach = [body["mass"], *[wheel["mass"]] * 3], 0.162 / math.sqrt(2.0)
    assert sum(masses) == pytest.approx(table["M_b"], rel=1e-5)
    assert np.abs(body["center_of_mass"][:2]).max() < 1e-5
    # The wheel's own center of mass is on its axle, which points down and outwards.
    along = wheel["center_of_mass"][2] / math.sqrt(2.0)
    outwards, upwards = reach + along, reach - along
    height = np.average([body["center_of_mass"][2], *[upwards] * 3], weights=masses)
    assert height == pytest.approx(table["l"], rel=1e-4)
    across, spin = wheel["inertia"][0][0], wheel["inertia"][2][2]
    assert spin == pytest.approx(table["J_w"], rel=1e-5)
    yaw = body["inertia"][2][2] + 3.0 * (wheel["mass"] * outwards**2 + 0.5 * across)
    assert yaw == pytest.approx(table["J_z"], rel=1e-4)
    # Each axle is at 45 deg to the vertical; over three of them x and y share what is left.
    tilt = body["inertia"][0][0] + body["mass"] * (body["center_of_mass"][2] - height) ** 2
    tilt += 3.0 * wheel["mass"] * (0.5 * outwards**2 + (upwards - height) ** 2) + 3.0 * 0.75 * across
    assert tilt == pytest.approx(table["J_b"], rel=1e-4)
    assert ball["mass"] == pytest.approx(table["M_k"], rel=1e-5)
    assert ball["inertia"][0][0] == pytest.approx(table["J_k"], rel=1e-5)


def test_the_recorded_ball_is_a_shell_in_a_skin():
    """No mesh shows it: hollow spheres by their formula."""
    middle = BALL.radius - BALL.skin
    layers = [(RUBBER, BALL.radius, middle), (PETG, middle, middle - BALL.shell)]
    mass = sum(4.0 / 3.0 * math.pi * m.density * (a**3 - b**3) * 1e-9 for m, a, b in layers)
    inertia = sum(8.0 / 15.0 * math.pi * m.density * (a**5 - b**5) * 1e-15 for m, a, b in layers)
    assert mass == pytest.approx(RECORD["table_ii"]["M_k"], rel=1e-4)
    assert inertia == pytest.approx(RECORD["table_ii"]["J_k"], rel=1e-4)


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.stem)
def test_meshes_are_closed_and_fill_the_recorded_volume(path):
    triangles = read_stl(path)
    assert (np.linalg.norm(np.cross(*np.moveaxis(np.diff(triangles, axis=1), 1, 0)), axis=1) > 0.0).all()
    _, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3).astype(np.int64)
    edges = np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]])
    there, counts = np.unique(edges @ [10**6, 1], return_counts=True)
    back, counts_back = np.unique(edges[:, ::-1] @ [10**6, 1], return_counts=True)
    # Each edge is walked as often in one direction as in the other.
    np.testing.assert_array_equal(there, back)
    np.testing.assert_array_equal(counts, counts_back)
    volume, _, _ = moments(triangles)
    limit = ROLLERS if path.stem == "wheel_rollers" else VOLUME
    assert volume == pytest.approx(RECORD["meshes"][path.stem]["volume"], rel=limit)


@pytest.mark.parametrize(("link", "limit"), [("body", 0.02), ("wheel", 0.03)])
def test_meshes_have_the_recorded_masses(link, limit):
    mass, center, inertia = weighed(link)
    recorded = RECORD["links"][link]
    assert mass == pytest.approx(recorded["mass"], rel=limit)
    assert center == pytest.approx(recorded["center_of_mass"], abs=2e-3)
    largest = np.abs(recorded["inertia"]).max()
    np.testing.assert_allclose(inertia, recorded["inertia"], rtol=0.0, atol=limit * largest)


def test_meshes_have_the_sizes_of_the_parameters():
    corners = {path.stem: read_stl(path).reshape(-1, 3) * 1e3 for path in MESHES}
    rollers = corners["wheel_rollers"]
    assert np.hypot(rollers[:, 0], rollers[:, 1]).max() == pytest.approx(WHEEL.radius, abs=0.2)
    # Roller 0 ends where the ball begins.
    assert rollers[np.abs(rollers[:, 1]) < 13.0][:, 0].max() == pytest.approx(WHEEL.radius, abs=0.2)
    for name in ("wheel_rim", "wheel_hub", "wheel_pins"):
        assert np.hypot(*corners[name][:, :2].T).max() < WHEEL.radius - 3.0
    plates = corners["body_plates"]
    assert np.hypot(plates[:, 0], plates[:, 1]).max() == pytest.approx(BODY.base_radius, abs=0.2)
    assert corners["body_cap"][:, 2].max() == pytest.approx(
        BODY.head_bottom + BODY.head_thickness + BODY.cap_height, abs=1e-3
    )
    ring = corners["body_ring"]
    assert ring[:, 2].min() == pytest.approx(KEEPER.ring_top - KEEPER.ring_height, abs=1e-3)
    assert ring[:, 2].min() > -100.0, "the ring is not above the floor"


@pytest.mark.parametrize("name", [path.stem for path in MESHES if path.stem.startswith("body")])
def test_the_body_does_not_touch_the_ball(name, paper):
    triangles = read_stl(ASSETS / "meshes" / f"{name}.stl")
    weights = np.array([[a, b, 8 - a - b] for a in range(9) for b in range(9 - a)]) / 8.0
    points = np.einsum("wk,nki->nwi", weights, triangles)
    assert np.linalg.norm(points, axis=2).min() > paper.ball_radius + 2e-3


def test_the_visuals_do_not_change_the_parameters(paper):
    found = Params.from_urdf(BOT, ASSETS / "ball.urdf")
    assert found.wheel_radius == paper.wheel_radius
    assert found.body_inertia == pytest.approx(paper.body_inertia, rel=1e-12)


def test_the_renderer_shows_wheels_that_turn(paper):
    renderer = Renderer(urdf=(BOT, ASSETS / "ball.urdf"), width=96, height=96, camera={"distance": 0.8})
    upright = State.at_rest(paper)
    turned = upright.replace(wheel_angles=[math.radians(18.0)] * 3)
    changed = np.any(renderer.render(upright) != renderer.render(turned), axis=2)
    assert changed[renderer.labels(upright) > 3].mean() > 0.1


class TestOtherReaders:
    """The file, as it is, with its meshes."""

    shown = 6 + 3 * 4

    def test_pinocchio(self):
        pin = pytest.importorskip("pinocchio")
        model = pin.buildModelFromUrdf(str(BOT), pin.JointModelFreeFlyer())
        # It looks for relative paths in the folders that it is given.
        visuals = pin.buildGeomFromUrdf(model, str(BOT), pin.GeometryType.VISUAL, package_dirs=str(ASSETS))
        assert len(visuals.geometryObjects) == self.shown
        assert {Path(shape.meshPath).name for shape in visuals.geometryObjects} == {path.name for path in MESHES}

    def test_mujoco(self, tmp_path):
        mujoco = pytest.importorskip("mujoco")
        assert mujoco.MjModel.from_xml_path(str(BOT)).nmesh == 0, "it leaves out visuals by default"
        keeping = '<robot name="ballbot"><mujoco><compiler discardvisual="false"/></mujoco>'
        text = BOT.read_text(encoding="utf-8").replace('<robot name="ballbot">', keeping)
        (tmp_path / "bot.urdf").write_text(text, encoding="utf-8")
        shutil.copytree(ASSETS / "meshes", tmp_path / "meshes")
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "bot.urdf"))
        assert model.nmesh == len(MESHES)
        assert (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH).sum() == self.shown

    def test_pybullet(self):
        bullet = pytest.importorskip("pybullet")
        client = bullet.connect(bullet.DIRECT)
        try:
            bot = bullet.loadURDF(str(BOT), physicsClientId=client)
            shapes = bullet.getVisualShapeData(bot, physicsClientId=client)
            assert len(shapes) == self.shown
            assert all(shape[2] == bullet.GEOM_MESH for shape in shapes)
        finally:
            bullet.disconnect(client)
