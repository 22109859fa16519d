"""The omniwheel, in the wheel frame: z is the axle, x points to the ball and through the middle of roller 0.

The rollers are in one row, so the contact with the ball is in the plane of the wheel. At the gaps between rollers the
ball is closer to the axle by `gap_drop`.
"""

import math

import cadquery as cq

from cad.materials import ALUMINIUM, RUBBER, STEEL
from cad.parameters import BALL, WHEEL
from cad.part import Part, part

_PITCH = 360.0 / WHEEL.rollers


def gap_drop() -> float:
    """Decrease of the distance of ball and axle from a roller to a gap between two rollers, mm."""
    half_gap = math.radians(_PITCH / 2.0 - WHEEL.roller_arc)
    half_chord = WHEEL.radius * math.sin(half_gap)
    below_rim = WHEEL.radius * (1.0 - math.cos(half_gap))
    return below_rim + BALL.radius - math.sqrt(BALL.radius**2 - half_chord**2)


def _outline(grown: float = 0.0) -> list[tuple[float, float]]:
    """End, middle and other end of the arc of roller 0 in the wheel's plane."""
    reach = WHEEL.radius * math.sin(math.radians(WHEEL.roller_arc)) + grown
    radius = WHEEL.radius + grown
    at_end = math.sqrt(radius**2 - reach**2)
    return [(at_end, -reach), (radius, 0.0), (at_end, reach)]


def _roller() -> cq.Workplane:
    """Roller 0: a barrel about the line x = `roller_axle` along y."""
    first, middle, last = _outline()
    profile = cq.Workplane("XY").moveTo(WHEEL.roller_axle, first[1]).lineTo(*first).threePointArc(middle, last)
    profile = profile.lineTo(WHEEL.roller_axle, last[1]).close()
    return profile.revolve(360.0, (WHEEL.roller_axle, 0.0), (WHEEL.roller_axle, 1.0))


def _slot() -> cq.Workplane:
    """Slot for roller 0 through the whole width of the rim."""
    first, middle, last = _outline(WHEEL.clearance)

    def across(point: tuple[float, float]) -> tuple[float, float]:
        return (2.0 * WHEEL.roller_axle - point[0], point[1])

    outline = cq.Workplane("XY").moveTo(*first).threePointArc(middle, last).lineTo(*across(last))
    outline = outline.threePointArc(across(middle), across(first)).close()
    return outline.extrude(WHEEL.rim_width, both=True)


def _pin() -> cq.Workplane:
    end = WHEEL.radius * math.sin(math.radians(WHEEL.roller_arc)) + WHEEL.pin_seat
    plane = cq.Plane(origin=(WHEEL.roller_axle, -end, 0.0), xDir=(1, 0, 0), normal=(0, 1, 0))
    return cq.Workplane(plane).circle(WHEEL.pin_radius).extrude(2.0 * end)


def _all_around(work: cq.Workplane) -> list[cq.Shape]:
    axis = cq.Vector(0.0, 0.0, 1.0)
    return [work.val().moved(cq.Location(cq.Vector(), axis, i * _PITCH)) for i in range(WHEEL.rollers)]


def _disc(radius: float, low: float, high: float) -> cq.Workplane:
    return cq.Workplane("XY").workplane(offset=low).circle(radius).extrude(high - low)


def _rim() -> cq.Workplane:
    half, web = WHEEL.rim_width / 2.0, WHEEL.web_width / 2.0
    rim = _disc(WHEEL.rim_radius, -half, half).cut(_disc(WHEEL.rim_inner_radius, -half, half))
    rim = rim.union(_disc(WHEEL.rim_inner_radius, -web, web)).cut(_disc(WHEEL.hub_radius, -half, half))
    holes = cq.Workplane("XY").polarArray(WHEEL.web_hole_circle, 0.0, 360.0, WHEEL.web_holes)
    rim = rim.cut(holes.circle(WHEEL.web_hole_radius).extrude(half, both=True))
    for room in _all_around(_slot()) + _all_around(_pin()):
        rim = rim.cut(cq.Workplane(room))
    return rim


def wheel() -> list[Part]:
    """Parts of a wheel."""
    barrel = _roller().cut(_pin())
    hub = _disc(WHEEL.hub_radius, *WHEEL.hub).cut(_disc(WHEEL.shaft_radius, *WHEEL.hub))
    return [
        part("rim", "wheel_rim", ALUMINIUM, _rim()),
        part("hub", "wheel_hub", ALUMINIUM, hub),
        *(Part(f"roller {i}", "wheel_rollers", RUBBER, s) for i, s in enumerate(_all_around(barrel))),
        *(Part(f"pin {i}", "wheel_pins", STEEL, s) for i, s in enumerate(_all_around(_pin()))),
    ]
