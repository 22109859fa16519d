"""This simulator against closed forms: one file a closed form, the analytic solution beside the engine's."""

from verification.closed_forms import flight, friction_limit, growth, holdable_tilt, incline, sliding_ball, tumbling, regulator_cost, energy_ledger
from verification.topic import Topic

TOPICS = [
    Topic.of(module) for module in (growth, sliding_ball, incline, friction_limit, holdable_tilt, flight, tumbling, regulator_cost, energy_ledger)
]
