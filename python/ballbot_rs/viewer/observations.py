"""Inputs of controllers, as the option `observation` of an environment."""

from ballbot_rs._core import OBSERVATIONS

#: Default sensors by the initial input of controllers: default sensors of environments, and published sensors.
DEFAULT_SENSORS = {"sensors": "exact", "ground_truth": "kugle"}


def check_observation(observation: str) -> None:
    """Raises ValueError for a name that is not in `OBSERVATIONS`."""
    if observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation '{observation}': expected one of {', '.join(OBSERVATIONS)}")
