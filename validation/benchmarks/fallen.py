"""The worst case of `contact`: every robot lies on the floor while random torques thrash its wheels."""

import itertools
from typing import Any

import numpy as np

import ballbot_rs as bb
from validation.benchmarks import task
from validation.benchmarks.simulators import Running
from validation.benchmarks.timing import timed

MODEL = "contact"
#: Control steps in which all fall, and after which the robots return to their states at that time: the wheels of a
#: robot on its side spin ever faster.
SETTLING, CALLS = 300, 200
#: The fraction of the robots that must lie on the floor; now and then a robot hops.
_LYING = 0.9


class Thrashing:
    """`num_envs` robots on one thread that are stepped after they have fallen.

    A fall ends an episode whatever `fall_tilt` is, so each step begins an episode in the final state of the last
    episode. A state has no contact forces: the step solves for them again. A robot that has sunk too deep into the
    floor for the start of an episode returns to the start of its last step.
    """

    def __init__(self, num_envs: int) -> None:
        self.batch = bb.Batch(
            num_envs, autoreset="disabled", num_threads=1, seed=0, model=MODEL, fall_tilt=np.pi,
            reset_yaw=task.RESET_YAW, max_wheel_torque=task.MAX_TORQUE,
        )  # fmt: skip
        self._actions = itertools.cycle(task.make_actions(64, num_envs, task.MAX_TORQUE))
        self.batch.reset()
        self._starts = self._states()
        for _ in range(SETTLING):
            self.go_on()
            self.step()
        lying = self.lying()
        if lying < _LYING:
            raise RuntimeError(f"{lying:.0%} of the robots lie on the floor after {SETTLING} steps, not {_LYING:.0%}")
        self._settled = list(self._starts)  # of the last settling step: an episode may begin there
        self._calls = itertools.count(1)
        self._shares: list[float] = []

    def step(self) -> None:
        """The next actions for one control step."""
        self.batch.step(next(self._actions))

    def go_on(self) -> None:
        """Begins episodes at the ends of the last episodes."""
        ended = self._states()
        try:
            self.batch.reset(starts=ended)
        except ValueError:
            ended = [self._go_on_alone(i, state) for i, state in enumerate(ended)]
        self._starts = ended

    def before(self) -> None:
        """Preparation before a timed step."""
        self._shares.append(self.lying())
        if next(self._calls) % CALLS == 0:
            self._starts = list(self._settled)
            self.batch.reset(starts=self._starts)
        else:
            self.go_on()

    def lying(self) -> float:
        """Fraction of the robots whose body or wheels touched the floor in the last time step."""
        return float(np.mean(self.batch.contacts()["bot_on_floor"]))

    def found(self) -> dict[str, Any]:
        """Smallest and mean fraction of the robots that lay on the floor at the end of a step.

        Raises:
            RuntimeError: too few robots lay on the floor.
        """
        smallest, mean = min(self._shares), float(np.mean(self._shares))
        if mean < _LYING:
            raise RuntimeError(f"{mean:.0%} of the robots lay on the floor, not {_LYING:.0%}")
        return {"lying_min": smallest, "lying_mean": mean}

    def _states(self) -> list[bb.State]:
        return [bb.State.from_array(state) for state in self.batch.states()]

    def _go_on_alone(self, i: int, ended: bb.State) -> bb.State:
        """Begins an episode of robot `i` in the state `ended`, or else in its last start; returns which."""
        only = np.arange(self.batch.num_envs) == i
        for start in (ended, self._starts[i]):
            try:
                self.batch.reset(mask=only, starts=[start if one else None for one in only])
            except ValueError:
                continue
            return start
        raise RuntimeError(f"robot {i} cannot restart at its start")


def thrashing(num_envs: int) -> Running:
    """A run is one control step of all robots; beginning the episodes does not count."""
    robots = Thrashing(num_envs)
    return Running(timed(robots.step, num_envs, robots.before), lambda: None, robots.found)
