"""What a session tells a user in passing."""

from collections import deque

#: How many are kept.
KEPT = 20


class Notices(deque[str]):
    """The last ones, and how many there were."""

    def __init__(self) -> None:
        super().__init__(maxlen=KEPT)
        self.said = 0

    def append(self, text: str) -> None:
        """Adds one."""
        super().append(text)
        self.said += 1
