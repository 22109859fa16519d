"""Table II: physical properties.

The paper's robot is two URDFs, [bot.urdf](../assets/bot.urdf) and [ball.urdf](../assets/ball.urdf). The paper
describes its files (Section II-B) but does not print them; ours are written so that their links add up to Table II,
which holds the robot above the ball as one body: the wheels' masses count, their inertia about their own axles is
$J_w$ of eq. (2). The tables compare what `Params.from_urdf` reads with the sum of the links, which this page computes
separately from the XML.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.mechanics import Array
from validation.topic import Comparison, Findings

_ASSETS = Path(__file__).parents[2] / "assets"

#: Table II, and derived quantities.
PRINTED = {
    "J_k": (0.0112, "kg·m²"),
    "J_w": (0.000149, "kg·m²"),
    "J_b": (0.0583, "kg·m²"),
    "J_z": (0.0137, "kg·m²"),
    "r_k": (0.112, "m"),
    "r_w": (0.05, "m"),
    "M_k": (1.437, "kg"),
    "M_b": (2.228, "kg"),
    "l": (0.142, "m"),
    "α": (45.0, "deg"),
}


def run() -> Findings:
    """Reads the URDFs twice."""
    p = bb.Params.from_urdf(_ASSETS / "bot.urdf", _ASSETS / "ball.urdf")
    read = {
        "J_k": p.ball_inertia,
        "J_w": p.wheel_inertia,
        "J_b": p.body_inertia[0],
        "J_z": p.body_inertia[2],
        "r_k": p.ball_radius,
        "r_w": p.wheel_radius,
        "M_k": p.ball_mass,
        "M_b": p.body_mass,
        "l": p.body_com_height,
        "α": math.degrees(p.wheel_zenith),
    }
    summed = sum_of_links()
    claims = [Claim(name, read[name], printed, 1e-14, unit) for name, (printed, unit) in PRINTED.items()]
    worst = max(abs(summed[name] / printed - 1.0) for name, (printed, _) in PRINTED.items())
    claims.append(Claim("largest relative error of the sums over the links", worst, 0.0, 1e-14, "", absolute=True))
    names = Comparison(
        "parameters by name",
        "Table I",
        "definitions of symbols",
        "the same symbols, in [conventions](conventions.md#parameters)",
        "not comparable: the table has no number",
    )
    drawing = Comparison(
        "CAD model",
        "Section II-B, Fig. 2",
        "a picture",
        "two URDFs, in `assets`",
        "not comparable: the publication prints neither dimensions beyond Table II nor the file",
    )
    compared = Comparison(
        "ten physical properties",
        "Table II",
        "its values",
        f"equal to {max(claim.error for claim in claims):.0e}",
        "they do not: our URDFs are written to add up to the table",
    )
    return Findings(claims, compared=(names, drawing, compared))


def sum_of_links() -> dict[str, float]:
    """Table II from the links of the URDFs, in its own words: parallel axes, wheels at their joints."""
    ball = _links("ball.urdf")["ball"]
    bot = ET.parse(_ASSETS / "bot.urdf").getroot()
    links = _links("bot.urdf")
    frames = {"body": (np.zeros(3), np.eye(3))}
    axles = {}
    for joint in bot.iter("joint"):
        origin, child, axis = joint.find("origin"), joint.find("child"), joint.find("axis")
        assert origin is not None
        assert child is not None
        assert axis is not None
        rotation = _rotation(_numbers(origin, "rpy"))
        frames[child.attrib["link"]] = (_numbers(origin, "xyz"), rotation)
        axles[child.attrib["link"]] = rotation @ _numbers(axis, "xyz")

    mass, moment = 0.0, np.zeros(3)
    for name, (position, rotation) in frames.items():
        mass += links[name][0]
        moment += links[name][0] * (position + rotation @ links[name][1])
    com = moment / mass
    inertia = np.zeros((3, 3))
    for name, (position, rotation) in frames.items():
        link_mass, link_com, link_inertia = links[name]
        arm = position + rotation @ link_com - com
        inertia += rotation @ link_inertia @ rotation.T + link_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    wheel = next(iter(axles))
    about_axle = float(axles[wheel] @ frames[wheel][1] @ links[wheel][2] @ frames[wheel][1].T @ axles[wheel])
    for axle in axles.values():
        inertia -= about_axle * np.outer(axle, axle)

    ball_radius, wheel_radius = _radius("ball.urdf", "ball"), _radius("bot.urdf", wheel)
    center = frames[wheel][0]
    return {
        "J_k": float(ball[2][0, 0]),
        "J_w": about_axle,
        "J_b": float(inertia[0, 0]),
        "J_z": float(inertia[2, 2]),
        "r_k": ball_radius,
        "r_w": wheel_radius,
        "M_k": ball[0],
        "M_b": mass,
        "l": float(com[2]),
        "α": math.degrees(math.atan2(math.hypot(center[0], center[1]), center[2])),
    }


def _numbers(element: ET.Element, name: str) -> Array:
    return np.array([float(word) for word in element.attrib.get(name, "0 0 0").split()])


def _links(file: str) -> dict[str, tuple[float, Array, Array]]:
    """Mass, CoM and inertia of each link."""
    links = {}
    for link in ET.parse(_ASSETS / file).getroot().iter("link"):
        inertial = link.find("inertial")
        assert inertial is not None
        mass, inertia, origin = inertial.find("mass"), inertial.find("inertia"), inertial.find("origin")
        assert mass is not None
        assert inertia is not None
        i = {key: float(value) for key, value in inertia.attrib.items()}
        matrix = np.array(
            [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
        )
        com = np.zeros(3) if origin is None else _numbers(origin, "xyz")
        links[link.attrib["name"]] = (float(mass.attrib["value"]), com, matrix)
    return links


def _radius(file: str, name: str) -> float:
    sphere = ET.parse(_ASSETS / file).getroot().find(f"link[@name='{name}']/collision/geometry/sphere")
    assert sphere is not None
    return float(sphere.attrib["radius"])


def _rotation(rpy: Array) -> Array:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    product: Array = about_z @ about_y @ about_x
    return product
