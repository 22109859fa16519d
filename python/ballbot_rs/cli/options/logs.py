"""Arguments of the commands that read a log of a robot and simulate it."""

import argparse
from pathlib import Path
from typing import Any, Final

from ballbot_rs._core import ACTUATORS, MODELS, ROBOTS
from ballbot_rs.cli.options.numbers import meters, seconds, whole
from ballbot_rs.identification.windows import WINDOW_LIMITS

#: Models that can begin in any state of a log.
_MODELS: Final = tuple(name for name in MODELS if name != "planar")


def add_log(command: Any, robot: str, motors: str) -> None:
    """Adds the log, its column map, the robot and its motors.

    Args:
        command: the parser to add them to.
        robot: begins the explanation of the robot.
        motors: begins the explanation of the motors.
    """
    what = "a log, .csv, .npz or .mcap; docs/identify.md has its columns"
    command.add_argument("log", type=Path, metavar="LOG", help=what)
    command.add_argument(
        "--columns",
        type=Path,
        metavar="MAP.toml",
        help="names, units, signs and times of the log's columns (default: as docs/identify.md has them)",
    )
    command.add_argument(
        "--robot",
        default="paper",
        metavar="NAME|FILE.toml",
        help=f"{robot}{', '.join(ROBOTS)}, or a file (default paper)",
    )
    command.add_argument(
        "--actuators",
        metavar="NAME|FILE",
        help=f"{motors}{', '.join(ACTUATORS)}, or a file (default: the robot file's own, else ideal)",
    )


def add_simulation(command: Any) -> None:
    """Adds the model, its time step, the windows, the place of the IMU and the threads."""
    command.add_argument("--model", default="contact", help=f"{', '.join(_MODELS)} (default contact)")
    command.add_argument(
        "--sim-dt", type=seconds(0.0, 0.05, above=True), default=0.002, help="time step of the model, s (default 0.002)"
    )
    command.add_argument(
        "--window",
        type=seconds(*WINDOW_LIMITS),
        default=0.5,
        help="length of the spans that are simulated, s (default 0.5)",
    )
    command.add_argument(
        "--imu-position",
        type=meters(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        default=(0.0, 0.0, 0.0),
        help="position of the accelerometer in the body frame, m (default 0 0 0)",
    )
    command.add_argument("--threads", type=whole(1, 256), help="threads of the simulations (default: all cores)")


def simulation(arguments: argparse.Namespace) -> dict[str, Any]:
    """What `add_simulation` added, as arguments of `identify` and `replay`."""
    return {
        "model": arguments.model,
        "sim_dt": arguments.sim_dt,
        "window": arguments.window,
        "imu_position": arguments.imu_position,
        "num_threads": arguments.threads,
    }
