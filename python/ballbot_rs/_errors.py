"""Exceptions of the package; all derive from `BallbotError` and from the built-in that Python users expect."""


class BallbotError(Exception):
    """Base of every exception that this package defines."""

    __module__ = "ballbot_rs"


class InvalidInputError(BallbotError, ValueError):
    """A value is out of range, inconsistent or unknown; the message has the value and the limit."""

    __module__ = "ballbot_rs"


class DivergedError(BallbotError, ArithmeticError):
    """The state left the bounds of the simulation."""

    __module__ = "ballbot_rs"


class UrdfError(BallbotError, ValueError):
    """A URDF is malformed, or does not describe a ballbot."""

    __module__ = "ballbot_rs"


class ControllerError(BallbotError, RuntimeError):
    """A controller in Python failed; its exception is the cause."""

    __module__ = "ballbot_rs"
