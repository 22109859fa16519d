"""Checks of arguments; each error names the argument, its value and the limit."""

import difflib
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ballbot_rs._core import Params, Terrain

#: Similarity from which on two names are close: 'delay' is not meant to be 'model'.
_ALIKE: Final = 0.65


def check_count(name: str, value: int) -> int:
    """The value as an int.

    Raises:
        TypeError: it is not a whole number.
        ValueError: it is below 1.
    """
    count = _whole(name, value)
    if count < 1:
        raise ValueError(f"{name} = {value}, it must be at least 1")
    return count


def check_seed(seed: int) -> int:
    """The seed as an int.

    Raises:
        TypeError: it is not a whole number.
        ValueError: it is not in [0, 2**64).
    """
    seed = _whole("seed", seed)
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed = {seed} is out of range: it must be from 0 to 2**64 - 1")
    return seed


def seed_at(seed: int, index: int) -> int:
    """The seed of the environment with this index: consecutive, with 0 after 2**64 - 1."""
    return (seed + index) % 2**64


def check_real(name: str, value: float) -> float:
    """The value as a float.

    Raises:
        TypeError: it is not a real number.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise TypeError(f"{name} = {value!r} is not a number")
    try:
        return float(value)
    except OverflowError:
        return math.copysign(math.inf, value > 0 or -1)


def check_bounded(name: str, value: float, low: float, high: float) -> float:
    """The value as a float. Raises ValueError unless it is a number within the bounds."""
    try:
        number = check_real(name, value)
    except TypeError as error:
        raise ValueError(str(error)) from error
    if not low <= number <= high:
        raise ValueError(f"{name} = {value} is out of range: expected {low:g} to {high:g}")
    return number


def real_array(what: str, value: npt.ArrayLike, desired: str, kinds: str = "biuf") -> npt.NDArray[Any]:
    """An array-like as an array of the type that NumPy gives it, as the core takes arrays.

    Args:
        what: begins the message, as "the law gave".
        value: the array-like.
        desired: ends the message.
        kinds: the accepted kinds of NumPy types.

    Raises:
        TypeError: text, times, objects or complex numbers, and masked arrays.
    """
    parts = value if isinstance(value, (list, tuple)) else (value,)
    if any(isinstance(part, np.ma.MaskedArray) for part in parts):
        raise TypeError(f"{what} a masked array: expected {desired}, fill it first")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{what} {value!r}: expected {desired}") from error
    if array.dtype.kind not in kinds:
        given = f"an array of dtype {array.dtype}" if array.ndim else repr(value)
        raise TypeError(f"{what} {given}: expected {desired}")
    return array


def _whole(name: str, value: int) -> int:
    if isinstance(value, bool):
        raise TypeError(f"{name} = {value!r} is not a whole number")
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name} = {value!r} is not a whole number") from None


def check_reset_options(options: Mapping[str, Any] | None, known: tuple[str, ...]) -> dict[str, Any]:
    """Reset options as a dict; a ValueError names an unknown option, a TypeError reports that they are not a dict."""
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(f"options is of type {type(options).__name__}, expected a dict")
    options = dict(options or {})
    for name in options:
        if name not in known:
            raise ValueError(f"unknown reset option '{name}': expected one of {', '.join(known)}")
    return options


def check_named(who: str, unnamed: Sequence[object]) -> None:
    """Checks that there was no positional argument after the first.

    Raises:
        TypeError: there was; the message gives the keyword to use.
    """
    if unnamed:
        name = "task=" if isinstance(unnamed[0], str) else "num_envs="
        raise TypeError(
            f"{who} takes one positional argument, but {unnamed[0]!r} follows it: write {name}{unnamed[0]!r}"
        )


def check_still_floor(params: "Params", what: str) -> None:
    """Checks that a floor is at rest with the same friction everywhere, as `what` requires.

    Raises:
        ValueError: naming the parameter.
    """
    if not params.has_perturbed_floor:
        return
    names = ("floor_tilt_amplitude", "floor_acceleration", "floor_friction_gradient", "floor_patch_size")
    name = next(name for name in names if np.any(getattr(params, name)))
    found = np.asarray(getattr(params, name)).tolist()
    raise ValueError(f"{what}: {name} = {found} must be 0, as in robot.on_still_floor()")


def check_no_payload(params: "Params", what: str) -> None:
    """Checks that no payload moves on the body, as `what` requires.

    Raises:
        ValueError: naming the parameter.
    """
    if params.has_payload:
        raise ValueError(f"{what}: payload_mass = {params.payload_mass} must be 0, as in robot.with_payloads_fixed()")


def check_no_obstacles(terrain: "Terrain | None", what: str) -> None:
    """Checks that a terrain has no obstacles, as `what` requires.

    Raises:
        ValueError: naming their number.
    """
    if terrain is not None and terrain.obstacles:
        raise ValueError(f"{what}: the terrain has {len(terrain.obstacles)} obstacles, it must have none")


def check_options(who: str, given: Iterable[str], known: Sequence[str]) -> None:
    """Checks the names of options.

    Raises:
        TypeError: an option is unknown; the message names the closest known option, else all.
    """
    for name in given:
        if name not in known:
            close = did_you_mean(name, known) or f": expected one of {', '.join(known)}"
            raise TypeError(f"{who} got an unexpected keyword argument '{name}'{close}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`: did you mean 'x'?` for the closest of the known names, or an empty text."""
    found = closest(name, known)
    return "" if found is None else f": did you mean '{found}'?"


def closest(name: str, known: Iterable[str]) -> str | None:
    """The closest of the known names, in any case of letters, if one is close."""
    by_lower = {one.lower(): one for one in known}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=_ALIKE)
    return by_lower[found[0]] if found else None
