"""The three gearmotors, and the clamps that hold them below the base plate."""

import cadquery as cq

from cad.materials import ALUMINIUM, GEARMOTOR, STEEL
from cad.parameters import BODY, DRIVE, WHEEL
from cad.part import Part, part, turned, wheel_location


def _coaxial(radius: float, near: float, far: float) -> cq.Workplane:
    """A cylinder about the axle, on the motor side; `near` and `far` are distances from the plane of the wheel, mm."""
    return cq.Workplane("XY").workplane(offset=-far).circle(radius).extrude(far - near)


def _motor() -> cq.Workplane:
    gearbox_end = DRIVE.face + DRIVE.gearbox_length
    motor_end = gearbox_end + DRIVE.motor_length
    return (
        _coaxial(DRIVE.gearbox_radius, DRIVE.face, gearbox_end)
        .union(_coaxial(DRIVE.motor_radius, gearbox_end, motor_end))
        .union(_coaxial(DRIVE.encoder_radius, motor_end, motor_end + DRIVE.encoder_length))
    )


def _clamp() -> cq.Workplane:
    """Clamp of wheel 0 in the body frame: a sleeve about the motor, and a post to the base plate."""
    location = wheel_location(0.0)
    near, far = DRIVE.clamp
    # The point of the sleeve farthest from the ball.
    middle = 0.5 * (DRIVE.gearbox_radius + DRIVE.clamp_radius)
    top = location * cq.Location(cq.Vector(-middle, 0.0, -(near + far) / 2.0))
    at = cq.Vector(top.toTuple()[0])
    height = BODY.base_bottom - at.z
    post = cq.Workplane("XY").box(DRIVE.post_thickness, DRIVE.post_width, height, centered=(True, True, False))
    sleeve = _coaxial(DRIVE.clamp_radius, near, far).val().moved(location)
    clamp = post.translate((at.x, at.y, at.z)).union(cq.Workplane(sleeve))
    return clamp.cut(cq.Workplane(_coaxial(DRIVE.gearbox_radius, 0.0, 100.0).val().moved(location)))


def drives() -> list[Part]:
    """Parts of the drives: motors, shafts and clamps."""
    motor = part("motor", "body_motors", GEARMOTOR, _motor())
    shaft = part("shaft", "body_shafts", STEEL, _coaxial(WHEEL.shaft_radius, -DRIVE.shaft_end, DRIVE.face))
    clamp = part("clamp", "body_frame", ALUMINIUM, _clamp())
    return [
        moved
        for azimuth in WHEEL.azimuths
        for moved in (
            motor.moved(wheel_location(azimuth)),
            shaft.moved(wheel_location(azimuth)),
            clamp.moved(turned(azimuth)),
        )
    ]
