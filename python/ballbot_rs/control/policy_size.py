"""The size of a policy's networks, checked before they are made: a huge one would end the process."""

from collections.abc import Mapping
from typing import Any, Final

#: Most layers and most weights of a network; usual policies have some ten thousand weights.
MAX_LAYERS: Final = 100
MAX_WEIGHTS: Final = 10_000_000

#: Most numbers in the state of a recurrent policy.
MAX_STATE: Final = 65_536

#: Units and layers of LSTM cells that sb3-contrib makes if they are not named.
UNITS: Final = 256
LSTM_LAYERS: Final = 1

#: The algorithm with recurrent policies.
RECURRENT: Final = "RecurrentPPO"


def check(policy_arguments: Mapping[str, Any], inputs: int, algorithm: str) -> None:
    """Checks a policy of Stable-Baselines3 or sb3-contrib, as `check_net_arch`, LSTM cells included.

    Args:
        policy_arguments: its `policy_kwargs`.
        inputs: rows of an observation.
        algorithm: name of the algorithm.

    Raises:
        ValueError: as `check_net_arch`, or a number of units or LSTM layers that is not a whole number of at least 1.
    """
    if algorithm == RECURRENT:
        inputs = _check_cells(policy_arguments, inputs)
    check_net_arch(policy_arguments, inputs)


def _check_cells(policy_arguments: Mapping[str, Any], inputs: int) -> int:
    """Checks LSTM cells; returns how many outputs they have."""
    units: Any
    units, layers = policy_arguments.get("lstm_hidden_size", UNITS), policy_arguments.get("n_lstm_layers", LSTM_LAYERS)
    for name, value in {"lstm_hidden_size": units, "n_lstm_layers": layers}.items():
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ValueError(f"{name} = {value!r} is out of range: it must be a whole number of at least 1")
    if layers > MAX_LAYERS:
        raise ValueError(f"n_lstm_layers = {layers} is out of range: it must be at most {MAX_LAYERS}")
    weights = 4 * units * (inputs + 2 + units) + (layers - 1) * 4 * units * (2 * units + 2)
    if weights > MAX_WEIGHTS or 2 * layers * units > MAX_STATE:
        raise ValueError(
            f"lstm_hidden_size = {units}, n_lstm_layers = {layers}: {weights} weights and a state of "
            f"{2 * layers * units} numbers, more than {MAX_WEIGHTS} or {MAX_STATE}"
        )
    return int(units)


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
