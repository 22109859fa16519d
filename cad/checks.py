"""Checks that the robot can be built and can roll. Each check yields messages for its failures."""

from collections.abc import Iterator
from itertools import combinations

import cadquery as cq

from cad.parameters import BALL, DRIVE, WHEEL
from cad.part import Part, wheel_location
from cad.robot import RobotSolids

#: Largest shared volume of two solids that only touch, mm³.
_VOLUME = 1e-2
#: Largest gap of two solids in contact, mm.
_TOUCH = 1e-4
_CENTER = cq.Vertex.makeVertex(0.0, 0.0, 0.0)


def complaints(robot: RobotSolids) -> Iterator[str]:
    """Messages of all failed checks."""
    yield from _overlaps(robot.body)
    yield from _overlaps(robot.wheel)
    yield from _overlaps(robot.ball)
    yield from _loose("body", robot.body)
    yield from _loose("wheel", robot.wheel)
    yield from _wheels_hit_the_body(robot)
    yield from _wheels_off_their_motors()
    yield from _touches_of_the_ball(robot)


def clearance(parts: list[Part]) -> float:
    """Smallest distance of the parts from the ball, mm."""
    return float(min(part.solid.distance(_CENTER) for part in parts)) - BALL.radius


def _near(a: cq.Shape, b: cq.Shape) -> bool:
    p, q = a.BoundingBox(), b.BoundingBox()
    pairs = ((p.xmin, p.xmax, q.xmin, q.xmax), (p.ymin, p.ymax, q.ymin, q.ymax), (p.zmin, p.zmax, q.zmin, q.zmax))
    return all(low - _TOUCH <= other_high and other_low - _TOUCH <= high for low, high, other_low, other_high in pairs)


def _shared(a: cq.Shape, b: cq.Shape) -> float:
    return sum(solid.Volume() for solid in a.intersect(b).Solids()) if _near(a, b) else 0.0


def _overlaps(parts: list[Part]) -> Iterator[str]:
    for a, b in combinations(parts, 2):
        if (volume := _shared(a.solid, b.solid)) > _VOLUME:
            yield f"{a.name} and {b.name} share {volume:.3f} mm³"


def _loose(link: str, parts: list[Part]) -> Iterator[str]:
    """Parts without contact: all parts of a link must be connected to the first one by contacts."""
    waiting, held = set(range(1, len(parts))), [0]
    while held:
        solid = parts[held.pop()].solid
        found = {i for i in waiting if _near(parts[i].solid, solid) and parts[i].solid.distance(solid) < _TOUCH}
        waiting -= found
        held += found
    yield from (f"{link}: nothing holds {parts[i].name}" for i in waiting)


def _wheels_hit_the_body(robot: RobotSolids) -> Iterator[str]:
    """Collisions of wheels and body in a full turn. The volume swept by a wheel is bounded by two cylinders."""
    width = WHEEL.radius - WHEEL.roller_axle
    rollers = cq.Workplane("XY").circle(WHEEL.radius).extrude(width, both=True)
    low, high = WHEEL.hub
    hub = cq.Workplane("XY").workplane(offset=low).circle(WHEEL.hub_radius).extrude(high - low)
    bore = cq.Workplane("XY").circle(WHEEL.shaft_radius).extrude(100.0, both=True)
    swept = rollers.union(hub).cut(bore).val()
    outside = [p.name for p in robot.wheel if (p.solid.cut(swept)).Volume() > _VOLUME]
    yield from (f"{name} of the wheel leaves the room that the wheel sweeps" for name in outside)
    for azimuth in WHEEL.azimuths:
        moved = swept.moved(wheel_location(azimuth))
        for part in robot.body:
            if (volume := _shared(moved, part.solid)) > _VOLUME:
                yield f"the wheel at {azimuth} deg hits {part.name}: {volume:.3f} mm³"


def _wheels_off_their_motors() -> Iterator[str]:
    low, high = WHEEL.hub
    seated = min(high, DRIVE.shaft_end) - low
    if seated < 3.0 * WHEEL.shaft_radius:
        yield f"only {seated} mm of the motor's shaft are in the hub"
    if -low >= DRIVE.face:
        yield f"the hub begins at {low} mm, in the motor, whose face is at {-DRIVE.face} mm"
    near, far = DRIVE.clamp
    if near < DRIVE.face or far > DRIVE.face + DRIVE.gearbox_length:
        yield f"the clamp, from {near} to {far} mm, is not on the gearbox"


def _touches_of_the_ball(robot: RobotSolids) -> Iterator[str]:
    """Contacts with the ball: each wheel touches it with the middle of roller 0 only, the body not at all."""
    for part in robot.body:
        if (gap := part.solid.distance(_CENTER) - BALL.radius) < 1.0:
            yield f"{part.name} is {gap:.3f} mm from the ball"
    for parts, azimuth in zip(robot.wheels(), WHEEL.azimuths, strict=True):
        touching = [p.name for p in parts if abs(p.solid.distance(_CENTER) - BALL.radius) < _TOUCH]
        if touching != ["roller 0"]:
            yield f"the wheel at {azimuth} deg touches the ball with {touching}"
            continue
        contact = next(p for p in parts if p.name == "roller 0")
        rim = wheel_location(azimuth) * cq.Location(cq.Vector(WHEEL.radius, 0.0, 0.0))
        point = cq.Vertex.makeVertex(*rim.toTuple()[0])
        if contact.solid.distance(point) > _TOUCH or abs(point.distance(_CENTER) - BALL.radius) > _TOUCH:
            yield f"the wheel at {azimuth} deg does not touch the ball where it should"
        if any(p.solid.distance(_CENTER) < BALL.radius - _TOUCH for p in parts):
            yield f"the wheel at {azimuth} deg is in the ball"
