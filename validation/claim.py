"""A claim: our number, the expected number, and the allowed difference."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """`limit` bounds the relative error, or the difference (in `unit`) if `absolute`."""

    what: str
    found: float
    expected: float
    limit: float
    unit: str = ""
    absolute: bool = False

    @property
    def error(self) -> float:
        """Difference, in `unit` if `absolute`, else relative to the expected number."""
        difference = abs(self.found - self.expected)
        return difference if self.absolute else difference / abs(self.expected)

    @property
    def holds(self) -> bool:
        """Whether the error is within the limit; a NaN is not."""
        return self.error <= self.limit

    def __str__(self) -> str:
        """For a failure's message."""
        kind = self.unit if self.absolute else "relative"
        return (
            f"{self.what}: {self.found:.9g} {self.unit}, expected {self.expected:.9g}, "
            f"error {self.error:.2e} {kind}, limit {self.limit:.1e}"
        )
