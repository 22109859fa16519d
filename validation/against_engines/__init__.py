"""The same robot in Pinocchio, MuJoCo and PyBullet: as they read it, as they move it, and who is right.

If an engine is missing, the output lists what was not run, and why; with `--allow-missing` this is not a failure.
"""

from validation.against_engines import free_flight, headings, jacobians, recovery, schedule, urdf, waves
from validation.topic import Topic

TOPICS = [Topic.of(module) for module in (urdf, free_flight, recovery, schedule, headings, waves, jacobians)]
