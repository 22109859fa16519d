"""Writes the meshes as visuals into `bot.urdf`. Inertials, collisions and joints are not changed."""

import re
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Look:
    """Material of a mesh, and tolerances of its triangulation (mm and rad)."""

    color: str
    tolerance: float = 0.4
    angle: float = 0.6


#: Colors are the materials of the URDF.
LOOKS = {
    "body_plates": Look("plate", angle=1.0),
    "body_frame": Look("frame"),
    "body_motors": Look("dark"),
    "body_shafts": Look("steel", angle=0.8),
    "body_ring": Look("steel"),
    "body_cap": Look("accent"),
    "wheel_rim": Look("frame", tolerance=0.6, angle=1.0),
    "wheel_hub": Look("accent"),
    "wheel_rollers": Look("tyre"),
    "wheel_pins": Look("steel", angle=0.8),
}
_LINK = re.compile(r'(  <link name="(\w+)">\n)(.*?)(  </link>\n)', flags=re.DOTALL)
_VISUAL = re.compile(r"    <visual>.*?</visual>\n", flags=re.DOTALL)


def write_visuals(path: Path) -> None:
    """Replaces the visuals of the links of the bot."""
    text = path.read_text(encoding="utf-8")
    path.write_text(_LINK.sub(lambda m: m[1] + _with_meshes(m[2], m[3]) + m[4], text), encoding="utf-8")


def _with_meshes(link: str, content: str) -> str:
    visuals = "".join(
        "    <visual>\n"
        f'      <geometry><mesh filename="meshes/{mesh}.stl"/></geometry>\n'
        f'      <material name="{look.color}"/>\n'
        "    </visual>\n"
        for mesh, look in LOOKS.items()
        if mesh.split("_")[0] == link.split("_")[0]
    )
    rest = _VISUAL.sub("", content)
    before, tag, after = rest.partition("    <collision>\n")
    return before + visuals + tag + after
