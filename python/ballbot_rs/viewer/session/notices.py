"""Messages of a session to its page."""

from collections import deque

#: Number of messages kept.
KEPT = 20


class Notices(deque[str]):
    """The last messages, and their total number."""

    def __init__(self) -> None:
        super().__init__(maxlen=KEPT)
        self.total = 0

    def append(self, text: str) -> None:
        """Adds a message."""
        super().append(text)
        self.total += 1
