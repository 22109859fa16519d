"""Short messages of a session to the user."""

from collections import deque

#: Number of messages kept.
KEPT = 20


class Notices(deque[str]):
    """The last messages, and their total number."""

    def __init__(self) -> None:
        super().__init__(maxlen=KEPT)
        self.said = 0

    def append(self, text: str) -> None:
        """Adds a message."""
        super().append(text)
        self.said += 1
