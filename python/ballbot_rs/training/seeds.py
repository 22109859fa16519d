"""Seeds of environments: each run has its own range, evaluations use its end, `compare` stays below all of them."""

from typing import Final

SEEDS_PER_RUN: Final = 10_000_000
EVALUATION_SEEDS: Final = 9_000_000
#: Number of nominal robots with which the best policy is tested.
JUDGED: Final = 100


def first_seed(seed: int) -> int:
    """The first seed of a run's environments."""
    return SEEDS_PER_RUN * (seed + 1)
