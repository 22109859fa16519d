"""The same robot in other engines."""

from verification.topic import Topic

TOPICS: list[Topic] = []
