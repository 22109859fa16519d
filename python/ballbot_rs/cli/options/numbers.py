"""Numbers of the command line: errors for values that are out of range or not numbers have the value and the limits."""

import argparse
import contextlib
import math
import re
from collections.abc import Callable, Mapping
from typing import Final

#: Largest seed of an environment, and of a training run.
MAX_SEED: Final = 2**64 - 1
MAX_RUN_SEED: Final = 2**32 - 1
#: Longest simulated time of a scenario, s.
MAX_SECONDS: Final = 3600.0
#: A full turn, rad.
MAX_TURN: Final = 2.0 * math.pi

#: Units that may follow a number: of lengths in m, of times in s, of angles in rad.
LENGTHS: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
TIMES: Final = {"s": 1.0, "ms": 0.001, "min": 60.0}
ANGLES: Final = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}


def whole(low: int, high: int) -> Callable[[str], int]:
    """An argparse type for whole numbers from `low` to `high`, also as 1e5."""

    def read(text: str) -> int:
        try:
            # A float would round large seeds.
            value = int(text) if re.fullmatch(r"\s*[-+]?[\d_]+\s*", text) else _whole(float(text))
        except (ValueError, OverflowError):
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is out of range: it must be from {low} to {high}")
        return value

    return read


def _whole(value: float) -> int:
    if not value.is_integer():
        raise ValueError
    return int(value)


def real(
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above: bool = False,
    units: Mapping[str, float] | None = None,
    unit: str = "",
) -> Callable[[str], float]:
    """An argparse type for finite numbers.

    Args:
        low: the lowest number.
        high: the highest.
        above: numbers must be above `low`.
        units: units that may follow a number, with their sizes: `LENGTHS`, `TIMES` or `ANGLES`.
        unit: one of them, of the result and of a number without a unit.
    """
    lower = "" if low == -math.inf else f"above {low:g}" if above else f"at least {low:g}"
    upper = "" if high == math.inf else f"at most {high:g}"
    limits = " and ".join(["finite", *filter(None, (lower, upper))])

    def read(text: str) -> float:
        try:
            value = _with_unit(text, units, unit) if units else float(text)
        except ValueError:
            known = f": a number, or one with {', '.join(units)}" if units else ""
            raise argparse.ArgumentTypeError(f"'{text}' is not a number{known}") from None
        if not (math.isfinite(value) and low <= value <= high and not (above and value == low)):
            raise argparse.ArgumentTypeError(f"{text} is out of range: it must be {limits}{_degrees(text, units)}")
        return value

    return read


def seconds(low: float = 0.0, high: float = MAX_SECONDS, *, above: bool = False) -> Callable[[str], float]:
    """An argparse type for times, s, also as 200ms or 2min."""
    return real(low, high, above=above, units=TIMES, unit="s")


def meters(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """An argparse type for lengths, m, also as 89mm."""
    return real(low, high, units=LENGTHS, unit="m")


def angle(limit: float) -> Callable[[str], float]:
    """An argparse type for angles up to a limit, rad, also as 5deg: beyond it degrees were meant."""
    return real(-limit, limit, units=ANGLES, unit="rad")


def in_si(text: str) -> float | None:
    """A number that is followed by the unit of a length, time or angle, in m, s or rad; None for another text."""
    for units, unit in ((LENGTHS, "m"), (TIMES, "s"), (ANGLES, "rad")):
        with contextlib.suppress(ValueError):
            return _with_unit(text, units, unit)
    return None


def _with_unit(text: str, units: Mapping[str, float], unit: str) -> float:
    found = re.fullmatch(r"(.*?[\d.])\s*([^\d\s.]+)", text.strip())
    if found is None or found[2] not in units:
        return float(text)
    # Exact where the unit is the result's own.
    return float(found[1]) * (1.0 if found[2] == unit else units[found[2]] / units[unit])


def _degrees(text: str, units: Mapping[str, float] | None) -> str:
    """For an angle without a unit: what it is in degrees, and how degrees are written."""
    if units is not ANGLES:
        return ""
    try:
        value = float(text)
    except ValueError:
        return " rad"
    return f" rad; {text} rad are {math.degrees(value):.0f} deg: for {text} degrees write {text}deg"
