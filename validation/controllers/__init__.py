"""Controllers side by side."""

from validation.controllers import limits
from validation.topic import Topic

TOPICS = [Topic.of(limits)]
