"""Setup of a session's robots: the options of the environments that simulate them."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from ballbot_rs._core import Batch, Params, Terrain
from ballbot_rs.envs._batch_env import new_batch, option_names
from ballbot_rs.envs.registration import DEFAULT_TASK
from ballbot_rs.viewer.changes import NEUTRAL, Motors, Sensors, changed_motors, changed_params, changed_sensors

Events = Sequence[Mapping[str, Any]] | str | None

#: Parameters that two robots must have in common for a state to be valid for both.
SHAPE = (
    "ball_radius",
    "wheel_radius",
    "wheel_zenith",
    "wheel_azimuths",
    "wheel_zenith_offsets",
    "body_com_height",
    "body_com_offset",
)

#: Options of an environment that a setup determines.
DECIDED = (
    "params",
    "model",
    "control_dt",
    "sim_dt",
    "max_wheel_torque",
    "max_episode_steps",
    "fall_tilt",
    "actuators",
    "events",
    "sensors",
    "observation",
    "terrain",
)


@dataclasses.dataclass(frozen=True)
class Setup:
    """A kind of robot, the model that simulates it, its changes and its events."""

    #: Name of the robot.
    name: str
    #: The robot without changes and events, for which controllers are made.
    nominal: Params
    model: str
    sim_dt: float
    #: Largest torque of a controller, N·m.
    max_torque: float
    #: As the options of an environment.
    motors: Motors = None
    events: Events = None
    #: Seed of robot 0; robot i has `seed + i`.
    seed: int = 0
    #: As in `changes.CHANGES`.
    changes: Mapping[str, float] = dataclasses.field(default_factory=lambda: NEUTRAL)
    #: Sensors whose readings give the estimated states for controllers; None: controllers take the true states.
    sensors: Sensors = None
    #: Model steps in a control step of the environment: from one sensor reading, or one action of a task other than
    #: balance, to the next.
    substeps: int = 1
    #: Name of the task.
    task: str = DEFAULT_TASK
    #: Its own options, and the observation of a policy; options that this setup determines are omitted.
    task_options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    #: The ground; None is level.
    terrain: Terrain | None = None

    @functools.cached_property
    def params(self) -> Params:
        """The changed robot, the nominal robot of the events. Raises ValueError for invalid parameters."""
        return changed_params(self.nominal, self.changes)

    @property
    def changed_sensors(self) -> Sensors:
        """The sensors with changed errors."""
        return changed_sensors(self.sensors, self.changes)

    def batch(self, index: int) -> Batch:
        """The environment of robot `index`: an episode ends only on the floor.

        The estimator is for the nominal robot, since a robot does not measure its changes.

        Raises:
            ValueError: invalid robot, motors, sensors or events.
        """
        estimates = self.sensors is not None
        decided = {
            "params": self.nominal if estimates else self.params,
            "model": self.model,
            "control_dt": self.substeps * self.sim_dt,
            "sim_dt": self.sim_dt,
            "max_wheel_torque": self.max_torque,
            "max_episode_steps": None,
            "actuators": changed_motors(self.motors, self.changes),
            "events": self.events,
            "sensors": self.changed_sensors,
            "observation": "sensors" if estimates else "ground_truth",
            "terrain": self.terrain,
        }
        if "fall_tilt" in option_names(self.task):
            decided["fall_tilt"] = math.pi
        options = {**self.task_options, **decided}
        seed = (self.seed + index) % 2**64
        batch = new_batch(1, task=self.task, autoreset="disabled", num_threads=1, seed=seed, options=options)
        if estimates and self.params != self.nominal:
            batch.set_params(0, self.params)
        return batch

    def differs_in_numbers_alone(self, other: "Setup") -> bool:
        """Whether `set_params` can change a moving robot to the other setup."""
        motors = [changed_motors(setup.motors, setup.changes) for setup in (self, other)]
        return (
            dataclasses.replace(self, changes=other.changes, seed=other.seed) == other
            and motors[0] == motors[1]
            and self.changed_sensors == other.changed_sensors
            and all(getattr(self.params, name) == getattr(other.params, name) for name in SHAPE)
        )
