"""Exceptions of the package; all derive from `BallbotError` and from the built-in that Python users expect."""

import re

from ballbot_rs._checks import did_you_mean

_UNKNOWN_NAME = re.compile(r"unknown [^']+ '(?P<name>[^']*)': expected one of (?P<known>[^:]*)$")


class BallbotError(Exception):
    """Base of every exception that this package defines."""

    __module__ = "ballbot_rs"


class InvalidInputError(BallbotError, ValueError):
    """A value is out of range, inconsistent or not known; the message has the value and the limit."""

    __module__ = "ballbot_rs"

    def __init__(self, message: str = "", *rest: object) -> None:
        # The core lists the names that it knows; which of them is the closest is found here for all of them.
        unknown = _UNKNOWN_NAME.search(message)
        hint = "" if unknown is None else did_you_mean(unknown["name"], unknown["known"].split(", "))
        super().__init__(message + hint, *rest)


class DivergedError(BallbotError, ArithmeticError):
    """The state left the bounds of the simulation."""

    __module__ = "ballbot_rs"


class UrdfError(BallbotError, ValueError):
    """A URDF is malformed, or does not describe a ballbot."""

    __module__ = "ballbot_rs"


class ControllerError(BallbotError, RuntimeError):
    """A controller in Python failed; its own error is the cause."""

    __module__ = "ballbot_rs"
