"""The states that a policy visits during its fit to a teacher, and the teacher's actions there."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from ballbot_rs.training.config import Teacher
from ballbot_rs.training.teacher_errors import Labels

#: In the first rounds the law drives some robots: a new policy visits little except falls.
LAW_ROUNDS = 3

Floats = npt.NDArray[np.float32]

#: Gives the policy's actions, shape (n, 3), from observations and whether episodes begin with them, shape (n,).
Act = Callable[[Floats, npt.NDArray[np.bool_]], Floats]


@dataclasses.dataclass(frozen=True)
class Round:
    """Consecutive steps of all robots; the first two axes are steps and robots."""

    observations: Floats
    #: The law's actions.
    labels: Floats
    #: Factors of the errors.
    factors: Floats
    #: Whether an episode begins with the step.
    starts: npt.NDArray[np.bool_]


def rounds(
    environment: VecEnv, act: Act, label: Callable[[], Labels], teacher: Teacher, rng: np.random.Generator
) -> Iterator[Round]:
    """The rounds of a fit, which may change the policy after each.

    Args:
        environment: the robots.
        act: of the policy.
        label: gives the law's actions in the present states, and the factors of their errors.
        teacher: the settings.
        rng: for the choice of robots that the law drives, and for the noise.
    """
    n = environment.num_envs
    # Noise on half of the robots shows the law's corrections off its own paths.
    spread = np.where(np.arange(n) % 2 == 1, teacher.noise, 0.0)[:, None]
    for done in range(teacher.rounds):
        if done == 0 or not teacher.continues:
            observations, begins = environment.reset(), np.ones(n, dtype=bool)
        assert isinstance(observations, np.ndarray)
        share = max(1.0 - done / LAW_ROUNDS, 0.0)
        found = Round(
            np.empty((teacher.steps, *observations.shape), dtype=np.float32),
            np.empty((teacher.steps, n, 3), dtype=np.float32),
            np.empty((teacher.steps, n), dtype=np.float32),
            np.empty((teacher.steps, n), dtype=bool),
        )
        for step in range(teacher.steps):
            found.observations[step], found.starts[step] = observations, begins
            found.labels[step], found.factors[step] = label()
            own = act(observations, begins)
            driven = np.where(rng.random((n, 1)) < share, found.labels[step], own)
            noisy = driven + spread * rng.standard_normal((n, 3))
            observations, _, dones, _ = environment.step(np.clip(noisy, -1.0, 1.0).astype(np.float32))
            assert isinstance(observations, np.ndarray)
            begins = dones.astype(bool)
        yield found
