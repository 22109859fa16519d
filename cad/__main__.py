"""Builds and checks the robot; writes `assets/meshes/`, the visuals of `bot.urdf` and the record of its masses."""

import json
import math
import sys
from pathlib import Path

import cadquery as cq

from cad import checks, stl, urdf
from cad.keeper import floor_tilt
from cad.omniwheel import gap_drop
from cad.parameters import TABLE_II
from cad.part import Mass, Part
from cad.robot import RobotSolids, robot

HERE = Path(__file__).parent
ASSETS = HERE.parent / "assets"
STEP = HERE.parent / "target" / "cad" / "ballbot.step"
LIMIT = 0.02
_UNITS = {"M_b": "kg", "l": "m", "wheel mass": "kg", "M_k": "kg"}
_BEGIN, _END = "<!-- begin: written by `make cad` -->\n", "<!-- end -->\n"


def main() -> int:
    """Builds, checks and writes. Returns 1, without writing, for a failed check or a difference from Table II."""
    made = robot()
    found = made.properties()
    table = _table(found)
    print(table)
    wrong = list(checks.complaints(made))
    wrong += [f"{name} is off by more than {LIMIT:.0%}" for name in found if abs(_error(name, found)) > LIMIT]
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 1
    sizes = _write_meshes(made)
    urdf.write_visuals(ASSETS / "bot.urdf")
    _write_record(made, found)
    _write_readme(made, table)
    STEP.parent.mkdir(parents=True, exist_ok=True)
    _assembly(made).export(str(STEP))
    print(f"{sum(sizes.values())} triangles in {ASSETS / 'meshes'}: {sizes}\n{STEP}")
    return 0


def _error(name: str, found: dict[str, float]) -> float:
    return found[name] / TABLE_II[name] - 1.0


def _table(found: dict[str, float]) -> str:
    rows = ["| | unit | Table II | solids | difference |", "|---|---|---|---|---|"]
    for name, expected in TABLE_II.items():
        label = name if " " in name else f"${name}$"
        unit = _UNITS.get(name, "kg·m²")
        percent = round(100.0 * _error(name, found), 1) + 0.0
        rows.append(f"| {label} | {unit} | {expected:.4g} | {found[name]:.4g} | {percent:+.1f} % |")
    return "\n".join(rows) + "\n"


def _by_mesh(parts: list[Part]) -> dict[str, list[Part]]:
    groups: dict[str, list[Part]] = {}
    for part in parts:
        groups.setdefault(part.mesh, []).append(part)
    return groups


def _write_meshes(made: RobotSolids) -> dict[str, int]:
    folder = ASSETS / "meshes"
    folder.mkdir(exist_ok=True)
    groups = _by_mesh(made.body + made.wheel)
    return {
        mesh: stl.write(folder / f"{mesh}.stl", groups[mesh], look.tolerance, look.angle)
        for mesh, look in urdf.LOOKS.items()
    }


def _write_record(made: RobotSolids, found: dict[str, float]) -> None:
    def numbers(mass: Mass) -> dict[str, object]:
        rounded = [[round(x, 9) + 0.0 for x in row] for row in mass.inertia.tolist()]
        return {
            "mass": round(mass.mass, 6),
            "center_of_mass": [round(x, 6) + 0.0 for x in mass.center.tolist()],
            "inertia": rounded,
        }

    record = {
        "table_ii": {name: float(f"{value:.6g}") for name, value in found.items()},
        "links": {name: numbers(mass) for name, mass in made.links().items()},
        "meshes": {
            mesh: {
                "material": parts[0].material.name,
                "density": parts[0].material.density,
                "volume": float(f"{sum(part.solid.Volume() for part in parts) * 1e-9:.6g}"),
            }
            for mesh, parts in _by_mesh(made.body + made.wheel).items()
        },
    }
    (HERE / "mass_properties.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def _write_readme(made: RobotSolids, table: str) -> None:
    path = HERE / "README.md"
    before, _, rest = path.read_text(encoding="utf-8").partition(_BEGIN)
    _, _, after = rest.partition(_END)
    facts = (
        f"Nothing but the wheels is nearer to the ball than {checks.clearance(made.body):.1f} mm. At a gap between two "
        f"rollers the ball comes {gap_drop():.2f} mm closer to the axle. The ring meets the floor at a tilt of "
        f"{math.degrees(floor_tilt()):.1f} deg.\n"
    )
    path.write_text(f"{before}{_BEGIN}{table}\n{facts}{_END}{after}", encoding="utf-8")


def _assembly(made: RobotSolids) -> cq.Assembly:
    assembly = cq.Assembly(name="ballbot")
    links = {"body": made.body, "ball": made.ball}
    links |= {f"wheel_{i}": parts for i, parts in enumerate(made.wheels())}
    for link, parts in links.items():
        group = cq.Assembly(name=link)
        for i, part in enumerate(parts):
            group.add(part.solid, name=f"{link} {part.name} {i}")
        assembly.add(group)
    return assembly


if __name__ == "__main__":
    sys.exit(main())
