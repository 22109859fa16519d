"""This simulator against closed forms: one file a closed form, the analytic solution beside the engine's."""

from verification.closed_forms import growth
from verification.topic import Topic

TOPICS = [Topic.of(module) for module in (growth,)]
