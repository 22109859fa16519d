"""The keeper: claws from the base plate around the ball, and a steel ring below its equator, without contact."""

import math

import cadquery as cq

from cad.materials import ALUMINIUM, STEEL
from cad.parameters import BALL, BODY, KEEPER
from cad.part import Part, part, turned


def floor_tilt() -> float:
    """Tilt at which the lower outer edge of the ring touches the floor, rad."""
    outer, bottom = KEEPER.ring_inner_radius + KEEPER.ring_thickness, KEEPER.ring_top - KEEPER.ring_height
    return math.asin(BALL.radius / math.hypot(outer, bottom)) - math.atan2(-bottom, outer)


def _claw() -> cq.Workplane:
    """A claw in the xz-plane: a column below the base plate, and an arc about the ball."""
    inner, outer = KEEPER.claw_radius, KEEPER.claw_radius + KEEPER.claw_thickness
    begin = math.radians(KEEPER.claw_begin)
    end = math.pi / 2.0 + math.asin(-KEEPER.ring_top / inner)
    middle = 0.5 * (begin + end)

    def at(radius: float, angle: float) -> tuple[float, float]:
        return (radius * math.sin(angle), radius * math.cos(angle))

    arc = (
        cq.Workplane("XZ")
        .moveTo(*at(inner, begin))
        .threePointArc(at(inner, middle), at(inner, end))
        .lineTo(*at(outer, end))
        .threePointArc(at(outer, middle), at(outer, begin))
        .close()
        .extrude(KEEPER.claw_width / 2.0, both=True)
    )
    x, z = at(inner, begin)
    column = cq.Workplane("XY").box(
        KEEPER.claw_thickness, KEEPER.claw_width, BODY.base_bottom - z, centered=(False, True, False)
    )
    foot = cq.Workplane("XY").box(24.0, KEEPER.claw_width + 4.0, 4.0, centered=(True, True, False))
    claw = arc.union(column.translate((x, 0.0, z)))
    claw = claw.union(foot.translate((x + KEEPER.claw_thickness / 2.0, 0.0, BODY.base_bottom - 4.0)))
    below = cq.Workplane("XY").box(600.0, 600.0, 600.0).translate((0.0, 0.0, KEEPER.ring_top - 300.0))
    return claw.cut(below)


def keeper() -> list[Part]:
    """Parts of the keeper: three claws and the ring."""
    ring = (
        cq.Workplane("XY")
        .workplane(offset=KEEPER.ring_top - KEEPER.ring_height)
        .circle(KEEPER.ring_inner_radius + KEEPER.ring_thickness)
        .circle(KEEPER.ring_inner_radius)
        .extrude(KEEPER.ring_height)
    )
    claw = part("claw", "body_frame", ALUMINIUM, _claw())
    return [part("ring", "body_ring", STEEL, ring), *(claw.moved(turned(a)) for a in KEEPER.azimuths)]
