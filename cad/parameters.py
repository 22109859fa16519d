"""Dimensions of the robot, mm and degrees. Heights are above the ball center, along the mast."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Ball:
    """Two hemispheres glued together, under a cast skin."""

    radius: float = 112.0
    skin: float = 3.0
    shell: float = 5.0


@dataclass(frozen=True)
class Wheel:
    """One row of barrel rollers, whose outlines are arcs of the wheel's circle."""

    radius: float = 50.0
    #: Zenith angle of the wheel center at the ball center, from the mast.
    zenith: float = 45.0
    azimuths: tuple[float, ...] = (0.0, 120.0, 240.0)
    rollers: int = 10
    #: Distance of the roller axles from the wheel center.
    roller_axle: float = 43.5
    #: Half of the arc of the wheel circle that is covered by a roller.
    roller_arc: float = 13.8
    pin_radius: float = 1.25
    pin_seat: float = 1.6
    #: Clearance around a roller.
    clearance: float = 0.4
    rim_radius: float = 46.5
    rim_inner_radius: float = 30.0
    rim_width: float = 10.5
    web_width: float = 2.5
    web_holes: int = 5
    web_hole_radius: float = 5.8
    web_hole_circle: float = 21.5
    hub_radius: float = 9.5
    #: Ends of the hub along the axle, motor side first.
    hub: tuple[float, float] = (-12.0, 10.0)
    shaft_radius: float = 3.0


@dataclass(frozen=True)
class Drive:
    """A gearmotor coaxial with its wheel, in a clamp. Distances along the axle are from the plane of the wheel."""

    face: float = 15.0
    gearbox_length: float = 26.0
    gearbox_radius: float = 16.0
    motor_length: float = 30.0
    motor_radius: float = 15.0
    encoder_length: float = 5.0
    encoder_radius: float = 11.0
    shaft_end: float = 9.0
    #: Ends of the clamp on the gearbox.
    clamp: tuple[float, float] = (26.0, 38.0)
    clamp_radius: float = 18.5
    post_thickness: float = 5.0
    post_width: float = 15.0


@dataclass(frozen=True)
class Keeper:
    """Three claws and a ring below the equator of the ball, which hold the ball when the robot is lifted."""

    azimuths: tuple[float, ...] = (60.0, 180.0, 300.0)
    #: Distance of the inner face of the claws from the ball center.
    claw_radius: float = 115.0
    claw_thickness: float = 3.5
    claw_width: float = 10.0
    #: Start angle of the arc, from the mast.
    claw_begin: float = 52.0
    ring_inner_radius: float = 87.5
    ring_thickness: float = 6.4
    ring_top: float = -74.0
    ring_height: float = 14.0


@dataclass(frozen=True)
class Body:
    """Plates, pillars and mast."""

    base_radius: float = 116.0
    base_bottom: float = 198.5
    base_thickness: float = 3.0
    base_hole_circle: float = 84.0
    deck_radius: float = 100.0
    deck_bottom: float = 304.0
    deck_thickness: float = 2.5
    pillar_radius: float = 5.0
    pillar_bore: float = 4.0
    socket_radius: float = 30.0
    socket_bottom: float = 126.0
    mast_radius: float = 15.0
    mast_wall: float = 1.5
    head_bottom: float = 549.0
    head_radius: float = 80.0
    head_thickness: float = 3.5
    #: Cap on the end of the mast.
    cap_radius: float = 32.0
    cap_height: float = 40.0
    cap_chamfer: float = 8.0
    cap_wall: float = 3.7


BALL: Final = Ball()
WHEEL: Final = Wheel()
DRIVE: Final = Drive()
KEEPER: Final = Keeper()
BODY: Final = Body()

#: Table II of the paper, SI. The mass of a wheel is not in the table; it is the mass of a disc, 2 J_w / r_w².
TABLE_II: Final = {
    "M_b": 2.228,
    "l": 0.142,
    "J_b": 0.0583,
    "J_z": 0.0137,
    "wheel mass": 0.1192,
    "J_w": 0.000149,
    "M_k": 1.437,
    "J_k": 0.0112,
}
