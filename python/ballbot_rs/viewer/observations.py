"""What controllers take, as the option `observation` of an environment."""

from ballbot_rs._core import OBSERVATIONS

#: Sensors where none are named, by what controllers take at first: those of environments, and published ones to choose.
DEFAULT_SENSORS = {"sensors": "exact", "ground_truth": "kugle"}


def check_observation(observation: str) -> None:
    """Raises ValueError for a name that is none of `OBSERVATIONS`."""
    if observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation '{observation}': expected one of {', '.join(OBSERVATIONS)}")
