"""Robots as URDFs: what the package and MuJoCo read of them."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import robot_geometry
from ballbot_rs.envs.family import sample_robots
from tests.support.paths import ROBOTS

PAPER = bb.Params.paper()
SKEWED = PAPER.replace(
    body_com_offset=(0.012, -0.007),
    body_products_of_inertia=(0.002, -0.003, 0.001),
    wheel_azimuths=(0.3, 2.5, 4.3),
    wheel_zenith_offsets=(0.04, -0.03, -0.01),
    wheel_viscous_friction=0.004,
    wheel_coulomb_friction=0.02,
)
#: A twentieth of the paper's robot.
TINY = PAPER.replace(
    **{name: getattr(PAPER, name) * 0.05 for name in ("ball_radius", "wheel_radius", "body_com_height")},
    **{name: getattr(PAPER, name) * 0.05**3 for name in ("ball_mass", "body_mass", "wheel_mass")},
    **{name: getattr(PAPER, name) * 0.05**5 for name in ("ball_inertia", "wheel_inertia")},
    body_inertia=np.array(PAPER.body_inertia) * 0.05**5,
    body_products_of_inertia=(3e-12, 0.0, 0.0),
)
MADE = {name: bb.Params.preset(name) for name in bb.Params.preset_names()} | {"skewed": SKEWED, "tiny": TINY}
#: What a URDF cannot hold.
LOST = {"gravity", "floor_tilt", "ball_viscous_friction", "friction_critical_velocity"}
LOST |= {f"{part}_{kind}_friction" for part in ("wheel", "floor") for kind in ("static", "dynamic")}
LOST |= {"floor_rolling_friction", "floor_spinning_friction", "floor_friction_gradient"}
LOST |= {f"floor_patch_{name}" for name in ("size", "friction", "seed")}
LOST |= {f"floor_tilt_{name}" for name in ("amplitude", "period", "phases")}
LOST |= {f"floor_acceleration{name}" for name in ("", "_period", "_phase", "_rise")}
LOST |= {f"roller_{name}" for name in ("friction", "friction_slope", "ripple", "count", "phases")}


def held(params):
    """Parameters that a URDF holds, as arrays; azimuths as directions."""
    values = {name: np.array(value) for name, value in params.to_dict().items() if name not in LOST}
    azimuths = values.pop("wheel_azimuths")
    return values | {"directions": np.stack([np.cos(azimuths), np.sin(azimuths)])}


def check_read_back(params, folder):
    bot = bb.write_urdf(params, folder / "bot.urdf", part="bot")
    ball = bb.write_urdf(params, folder / "ball.urdf", part="ball")
    found = held(bb.Params.from_urdf(bot, ball))
    for name, value in held(params).items():
        np.testing.assert_allclose(found[name], value, rtol=1e-10, atol=1e-10 * np.abs(value).max(), err_msg=name)


@pytest.mark.parametrize("name", MADE)
def test_the_package_reads_what_it_wrote(name, tmp_path):
    check_read_back(MADE[name], tmp_path)


def test_the_package_reads_every_size_of_robot(tmp_path):
    for params in sample_robots(60, seed=3):
        check_read_back(params, tmp_path)


def inertia_of(model, name):
    """Inertia of a body about its center of mass in its own axes, (3, 3), kg·m²."""
    mujoco = pytest.importorskip("mujoco")
    body, turn = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    axes = turn.reshape(3, 3)
    return axes @ np.diag(body.inertia) @ axes.T


@pytest.mark.parametrize("name", MADE)
def test_mujoco_reads_the_same_masses_axles_and_joints(name, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    params = MADE[name]
    model = mujoco.MjModel.from_xml_path(str(bb.write_urdf(params, tmp_path / "robot.urdf")))
    assert model.body_mass.sum() == pytest.approx(params.body_mass + params.ball_mass)
    ball = model.body("ball")
    assert ball.mass[0] == pytest.approx(params.ball_mass)
    np.testing.assert_allclose(inertia_of(model, "ball"), params.ball_inertia * np.eye(3), rtol=1e-9, atol=1e-20)
    # Body and wheels about their common center of mass, without the spin of the wheels.
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    com = data.subtree_com[model.body("base_link").id] - data.xpos[model.body("base_link").id]
    np.testing.assert_allclose(com, params.body_com, atol=1e-9)
    total = np.zeros((3, 3))
    axles = robot_geometry(params).axles
    for link in ("base_link", "wheel_0", "wheel_1", "wheel_2"):
        index = model.body(link).id
        turn = data.xmat[index].reshape(3, 3)
        arm = data.xipos[index] - data.xpos[model.body("base_link").id] - com
        total += turn @ inertia_of(model, link) @ turn.T
        total += model.body(link).mass[0] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    for i in range(3):
        joint = model.joint(f"wheel_joint_{i}")
        np.testing.assert_allclose(data.xaxis[joint.id], axles[i], atol=1e-9)
        assert model.dof_damping[joint.dofadr[0]] == pytest.approx(params.wheel_viscous_friction)
        assert model.dof_frictionloss[joint.dofadr[0]] == pytest.approx(params.wheel_coulomb_friction)
        total -= params.wheel_inertia * np.outer(axles[i], axles[i])
    xy, xz, yz = params.body_products_of_inertia
    products = np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    np.testing.assert_allclose(total, np.diag(params.body_inertia) + products, atol=1e-9 * total.max())
    assert [joint.type[0] for joint in map(model.joint, ("base_link_joint", "ball_joint"))] == [0, 0]


def test_mujoco_rejects_a_body_whose_heavy_wheels_break_the_triangle_inequality(tmp_path):
    mujoco = pytest.importorskip("mujoco")

    def breaks(params):
        least, middle, largest = np.linalg.eigvalsh(robot_geometry(params).body.inertia)
        return largest > (least + middle) * (1.0 + 1e-6)

    params = next(filter(breaks, sample_robots(60)))
    check_read_back(params, tmp_path)
    with pytest.raises(ValueError, match=r"A \+ B >= C"):
        mujoco.MjModel.from_xml_path(str(bb.write_urdf(params, tmp_path / "robot.urdf")))


def test_links_and_joints_have_their_names(tmp_path):
    root = ET.parse(bb.write_urdf(str(ROBOTS / "kugle.toml"), tmp_path / "new" / "kugle.urdf")).getroot()
    wheels = [f"wheel_{i}" for i in range(3)]
    assert [link.get("name") for link in root.iter("link")] == ["odom", "base_link", *wheels, "ball"]
    edges = {joint.get("name"): (joint.find("parent").get("link"), joint.find("child").get("link")) for joint in
             root.iter("joint")}  # fmt: skip
    assert edges == {
        "base_link_joint": ("odom", "base_link"),
        "ball_joint": ("odom", "ball"),
        **{f"wheel_joint_{i}": ("base_link", f"wheel_{i}") for i in range(3)},
    }


def test_robots_that_cannot_be_written_are_rejected(tmp_path):
    with pytest.raises(bb.InvalidInputError, match=r"robot\.stl: .* not '\.stl'"):
        bb.write_urdf(PAPER, tmp_path / "robot.stl")
    with pytest.raises(bb.InvalidInputError, match=r"part = 'legs' .* robot, bot, ball"):
        bb.write_urdf(PAPER, tmp_path / "robot.urdf", part="legs")
    with pytest.raises(ValueError, match="unknown robot preset 'nobody'"):
        bb.write_urdf("nobody", tmp_path / "robot.urdf")
    with pytest.raises(bb.InvalidInputError, match=r"least moment of inertia would be -0\.\d+ .* reduce wheel_mass"):
        bb.write_urdf(PAPER.replace(wheel_mass=0.7), tmp_path / "robot.urdf")
    assert not list(tmp_path.iterdir())
    (tmp_path / "folder.urdf").mkdir()
    with pytest.raises(OSError, match=r"not a regular file: .*folder\.urdf"):
        bb.write_urdf(PAPER, tmp_path / "folder.urdf")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OSError, match=r"not written: .*robot\.urdf"):
        bb.write_urdf(PAPER, tmp_path / "file" / "robot.urdf")
