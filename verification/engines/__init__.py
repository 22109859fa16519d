"""The same robot in other engines."""

from verification.engines import headings, recovery, schedule, urdf
from verification.topic import Topic

TOPICS = [Topic.of(module) for module in (urdf, recovery, schedule, headings)]
