"""`--controller-option NAME=VALUE`: weights, gains and limits of the controllers of the package."""

from collections.abc import Sequence
from typing import Any, Final

from ballbot_rs._checks import did_you_mean
from ballbot_rs._core import CONTROLLERS
from ballbot_rs._errors import InvalidInputError
from ballbot_rs.cli.options import settings
from ballbot_rs.control.catalog import COMMON
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.scenarios.tune import with_options

FLAG: Final = "--controller-option"


def add_to(command: Any, whose: str = "that controller") -> None:
    """Adds `--controller-option`."""
    command.add_argument(
        FLAG,
        action="append",
        default=[],
        metavar="[CONTROLLER.]NAME=VALUE",
        help=f"an option of {whose} in SI units and rad, as position=0.1, max_torque=0.5, traction=false, or "
        "lqi.integral=0.2 for one of several controllers; repeat for more (docs/controllers.md)",
    )


def _read(names: Sequence[str], given: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The options of each controller, by its name."""
    known = {name: _options_of(name) for name in names if name in CONTROLLERS}
    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    for option, value in settings.assignments(given, FLAG).items():
        head, dot, part = option.rpartition(".")
        if dot and head not in names:
            raise InvalidInputError(f"{FLAG} {option}={value}: {head} is not one of the controllers {', '.join(names)}")
        name = part if dot else option
        owners = [one for one in ([head] if dot else known) if name in known.get(one, ())]
        if not owners:
            have = [one for one in ([head] if dot else names) if one in known]
            if not have:
                raise InvalidInputError(
                    f"{FLAG} {option}={value}: {', '.join([head] if dot else names)} has none: options exist for the "
                    f"controllers of the package, {', '.join(CONTROLLERS)}"
                )
            all_names = dict.fromkeys(one for controller in have for one in known[controller])
            close = did_you_mean(name, all_names) or f": expected one of {', '.join(all_names)}"
            raise InvalidInputError(f"{FLAG} {option}={value}: {', '.join(have)} has no option '{name}'{close}")
        for owner in owners:
            found[owner][name] = value
    return found


def of(names: Sequence[str], given: Sequence[str]) -> dict[str, ResolvedController]:
    """The controllers that have options on the command line, by name.

    Raises:
        ValueError: another form, an option that none of the controllers has, or one of a policy or a law in Python.
    """
    return {
        name: with_options(name, options, f"{name} ({', '.join(f'{key}={value}' for key, value in options.items())})")
        for name, options in _read(names, given).items()
        if options
    }


def _options_of(name: str) -> tuple[str, ...]:
    return (*(option["name"] for option in CONTROLLERS[name]["options"]), *COMMON)
