"""The payloads of a robot."""

from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from ballbot_rs._core import Params

#: What the names of the parameters of the first and the second payload begin with.
NAMES: Final = ("payload", "second_payload")

Three = tuple[float, float, float]


class Payload(NamedTuple):
    """A payload: mass (kg), place (body frame, m), springs (N/m), dampers (N/(m/s)) and motion of an arm (m)."""

    name: str
    mass: float
    position: Three
    stiffness: Three
    damping: Three
    amplitude: Three


def payloads_of(params: "Params") -> list[Payload]:
    """The payloads that move on the body: none, one or two."""
    found = [Payload(name, *(getattr(params, f"{name}_{what}") for what in Payload._fields[1:])) for name in NAMES]
    return [payload for payload in found if payload.mass > 0.0]
