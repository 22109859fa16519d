"""The paper's experiments, repeated: printed versus found, and why they differ."""

from validation.page import Chapter
from validation.paper_replication import (
    balancing,
    contact_parameters,
    environment,
    inclines,
    nonholonomic,
    physical_properties,
    sampling,
    simulation,
    step_response,
    tilt_limit,
    torque_map,
    training,
    wheel_inertia,
    wheel_torques,
)
from validation.topic import Topic

_CHAPTERS = {
    "Section II: modeling": (physical_properties, wheel_inertia, torque_map, nonholonomic),
    "Section III-A: the mathematical model": (step_response, balancing, tilt_limit),
    "Section III-B: the simulated robot": (contact_parameters, sampling, simulation, inclines, wheel_torques),
    "Section IV: the environment": (environment, training),
}

CHAPTERS = [Chapter(title, "", [Topic.of(module) for module in modules]) for title, modules in _CHAPTERS.items()]

#: Takes half a minute: not for the tests.
SLOW = "training"
