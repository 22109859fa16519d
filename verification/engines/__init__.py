"""The same robot in Pinocchio, MuJoCo and PyBullet: as they read it, as they move it, and who is right.

An engine that is not installed is left out, with the reason.
"""

from verification.engines import free_flight, headings, recovery, schedule, urdf
from verification.topic import Topic

TOPICS = [Topic.of(module) for module in (urdf, free_flight, recovery, schedule, headings)]
