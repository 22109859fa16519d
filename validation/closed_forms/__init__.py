"""This simulator compared with what is known of the motion independently: closed forms, conservation laws, theory.

Four sections have no closed form: the energy ledger is a balance, convergence compares with a finer step, derivatives
with differences, and determinism with another run.
"""

from validation.closed_forms import (
    convergence,
    derivatives,
    determinism,
    energy_ledger,
    flight,
    friction_limit,
    growth,
    holdable_tilt,
    incline,
    momentum_kept,
    regulator_cost,
    sliding_ball,
    tumbling,
    uneven_ground,
)
from validation.topic import Topic

TOPICS = [
    Topic.of(module)
    for module in (
        growth,
        sliding_ball,
        uneven_ground,
        incline,
        holdable_tilt,
        friction_limit,
        flight,
        tumbling,
        momentum_kept,
        energy_ledger,
        regulator_cost,
        convergence,
        derivatives,
        determinism,
    )
]
