"""Numbers of the command line: errors for values that are out of range or not numbers have the value and the limits."""

import argparse
import math
from collections.abc import Callable
from typing import Final

#: Largest seed of an environment, and of a training run.
MAX_SEED: Final = 2**64 - 1
MAX_RUN_SEED: Final = 2**32 - 1
#: Longest simulated time of a scenario, s.
MAX_SECONDS: Final = 3600.0


def whole(low: int, high: int) -> Callable[[str], int]:
    """An argparse type for whole numbers from `low` to `high`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is out of range: it must be from {low} to {high}")
        return value

    return read


def real(low: float = -math.inf, high: float = math.inf, *, above: bool = False) -> Callable[[str], float]:
    """An argparse type for finite numbers from `low` to `high`, without `low` itself if they must be above it."""
    lower = "" if low == -math.inf else f"above {low:g}" if above else f"at least {low:g}"
    upper = "" if high == math.inf else f"at most {high:g}"
    limits = " and ".join(["finite", *filter(None, (lower, upper))])

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
        if not (math.isfinite(value) and low <= value <= high and not (above and value == low)):
            raise argparse.ArgumentTypeError(f"{text} is out of range: it must be {limits}")
        return value

    return read
