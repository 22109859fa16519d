"""What robots that are not the nominal one, and motors that are not ideal, do to controllers."""

from validation.robots import (
    com_offset,
    delay,
    friction,
    lag,
    payload,
    perturbed_floor,
    preload,
    products_of_inertia,
    ripple,
    rollers,
    rolling,
    slope,
    strength,
    torque_speed,
    uneven_wheels,
)
from validation.topic import Topic

BODY = [
    Topic.of(module)
    for module in (
        com_offset,
        products_of_inertia,
        uneven_wheels,
        friction,
        preload,
        rolling,
        rollers,
        ripple,
        slope,
        perturbed_floor,
        payload,
    )
]
MOTORS = [Topic.of(module) for module in (delay, strength, lag, torque_speed)]
