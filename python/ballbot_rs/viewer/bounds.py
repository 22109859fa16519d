"""Checks of numbers from a page."""

from ballbot_rs._checks import check_real


def check_bounded(name: str, value: float, low: float, high: float) -> float:
    """The value as a float. Raises ValueError unless it is a number within the bounds."""
    try:
        number = check_real(name, value)
    except TypeError as error:
        raise ValueError(str(error)) from error
    if not low <= number <= high:
        raise ValueError(f"{name} = {value} is out of range: expected {low:g} to {high:g}")
    return number
