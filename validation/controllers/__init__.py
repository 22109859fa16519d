"""Controllers side by side."""

from validation.controllers import choice, limits, matrix, presets, tunings
from validation.topic import Topic

TOPICS = [Topic.of(choice), Topic.of(limits), Topic.of(matrix), Topic.of(tunings), Topic.of(presets)]
