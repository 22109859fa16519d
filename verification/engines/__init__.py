"""The same robot in other engines."""

from verification.engines import free_flight, headings, recovery, schedule, urdf
from verification.topic import Topic

TOPICS = [Topic.of(module) for module in (urdf, free_flight, recovery, schedule, headings)]
