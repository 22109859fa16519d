"""The size of a policy's networks, checked before they are made: a huge one would end the process."""

from collections.abc import Mapping
from typing import Any, Final

#: Most layers and most weights of a network; usual policies have some ten thousand weights.
MAX_LAYERS: Final = 100
MAX_WEIGHTS: Final = 10_000_000


def check_net_arch(policy_arguments: Mapping[str, Any], inputs: int) -> None:
    """Checks the hidden layers of a policy of Stable-Baselines3.

    Args:
        policy_arguments: its `policy_kwargs`; without `net_arch` they are accepted.
        inputs: rows of an observation.

    Raises:
        ValueError: a width that is not a whole number of at least 1, or a network beyond the limits.
    """
    arch = policy_arguments.get("net_arch")
    if isinstance(arch, list) and len(arch) == 1 and isinstance(arch[0], Mapping):
        # The format of Stable-Baselines3 before 1.8.
        arch = arch[0]
    networks = arch if isinstance(arch, Mapping) else {"": arch}
    for name, widths in networks.items():
        if widths is not None:
            _check(f"net_arch{'.' if name else ''}{name}", widths, inputs)


def _check(name: str, widths: Any, inputs: int) -> None:
    if not isinstance(widths, (list, tuple)):
        raise ValueError(f"{name} = {widths!r} must be a list of widths")
    if len(widths) > MAX_LAYERS:
        raise ValueError(f"{name} has {len(widths)} layers, more than {MAX_LAYERS}")
    for width in widths:
        if not isinstance(width, int) or isinstance(width, bool) or width < 1:
            raise ValueError(f"{name}: a width of {width!r} is out of range: it must be a whole number of at least 1")
    weights = sum(first * second for first, second in zip((inputs, *widths), widths, strict=False))
    if weights > MAX_WEIGHTS:
        raise ValueError(f"{name} = {list(widths)} has {weights} weights, more than {MAX_WEIGHTS}")
