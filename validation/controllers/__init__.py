"""Controllers side by side."""

from validation.controllers import limits, side_by_side
from validation.topic import Topic

TOPICS = [Topic.of(limits), Topic.of(side_by_side)]
