"""The body: base plate, deck, head plate and mast."""

import math

import cadquery as cq

from cad.materials import ABS, ALUMINIUM, POLYCARBONATE
from cad.parameters import BODY, KEEPER
from cad.part import Part, part, turned


def _disc(radius: float, low: float, high: float, bore: float = 0.0) -> cq.Workplane:
    sketch = cq.Workplane("XY").workplane(offset=low).circle(radius)
    return (sketch.circle(bore) if bore else sketch).extrude(high - low)


def _pillar_circle() -> float:
    """Radius of the circle of the pillars, above the columns of the claws, mm."""
    return KEEPER.claw_radius * math.sin(math.radians(KEEPER.claw_begin)) + KEEPER.claw_thickness / 2.0


def _windows(plate: cq.Workplane, radius: float, inner: float, outer: float) -> cq.Workplane:
    """Cuts six rounded windows between the lines to wheels and pillars."""
    low, high = plate.val().BoundingBox().zmin, plate.val().BoundingBox().zmax
    for azimuth in range(30, 390, 60):
        window = (
            cq.Workplane("XY")
            .workplane(offset=low)
            .moveTo(0.5 * (inner + outer), 0.0)
            .rect(outer - inner, radius)
            .extrude(high - low)
            .edges("|Z")
            .fillet(0.25 * min(outer - inner, radius))
        )
        plate = plate.cut(cq.Workplane(window.val().moved(turned(azimuth))))
    return plate


def body() -> list[Part]:
    """Parts of the body above the drives."""
    base_top = BODY.base_bottom + BODY.base_thickness
    deck_top = BODY.deck_bottom + BODY.deck_thickness
    head_top = BODY.head_bottom + BODY.head_thickness
    base = _windows(_disc(BODY.base_radius, BODY.base_bottom, base_top), 50.0, 68.0, 106.0)
    deck = _windows(_disc(BODY.deck_radius, BODY.deck_bottom, deck_top, BODY.mast_radius), 44.0, 42.0, 92.0)
    head = _windows(_disc(BODY.head_radius, BODY.head_bottom, head_top), 22.0, 42.0, 70.0)
    # The lower end of the mast is on the base plate, above the socket; its seat is not modeled.
    socket = _disc(BODY.socket_radius, BODY.socket_bottom, BODY.base_bottom)
    mast = _disc(BODY.mast_radius, base_top, BODY.head_bottom, BODY.mast_radius - BODY.mast_wall)
    cap = _disc(BODY.cap_radius, head_top, head_top + BODY.cap_height).edges(">Z").chamfer(BODY.cap_chamfer)
    hollow = _disc(BODY.cap_radius - BODY.cap_wall, head_top, head_top + BODY.cap_height - BODY.cap_wall)
    hollow = hollow.edges(">Z").chamfer(BODY.cap_chamfer)
    pillar = _disc(BODY.pillar_radius, base_top, BODY.deck_bottom, BODY.pillar_bore)
    pillar = part("pillar", "body_frame", ALUMINIUM, pillar.translate((_pillar_circle(), 0.0, 0.0)))
    return [
        part("base plate", "body_plates", POLYCARBONATE, base),
        part("deck", "body_plates", POLYCARBONATE, deck),
        part("head plate", "body_plates", POLYCARBONATE, head),
        part("socket", "body_frame", ALUMINIUM, socket),
        part("mast", "body_frame", ALUMINIUM, mast),
        part("cap", "body_cap", ABS, cap.cut(hollow)),
        *(pillar.moved(turned(azimuth)) for azimuth in KEEPER.azimuths),
    ]
