"""The policy for any robot, trained with each of five seeds.

`python -m validation.policies.any_seeds` prints a table, in two hours of two cores. All seeds have the same robots in
their training: they differ in the first weights, the noise, the starts and the evolution.
"""

import sys
from collections.abc import Sequence
from typing import Final

import numpy as np

import ballbot_rs as bb
from ballbot_rs.training.export import export
from validation.policies.any_robot import RECIPE, SCENARIOS, conditions, of_policy
from validation.policies.training import train_all

SEEDS: Final = range(5)


def row(policy: str, largest: Sequence[float]) -> list[str]:
    """What a policy reaches, and its fractions of the laws' largest tilts and pushes on the presets."""
    presets = bb.Params.preset_names()
    in_contact = [one for one in conditions() if one.engine is None and "model" not in one.options]
    family, *others = [of_policy(one, policy) for one in in_contact]
    nominal, wide = (others[i : i + len(presets)] for i in (0, len(presets)))
    limits = np.divide(hardest(policy), largest).reshape(len(SCENARIOS), -1)
    cells = [[family.upright], *([share.in_place for share in one] for one in ([family], nominal, wide)), *limits]
    return [", ".join(f"{100.0 * share:.4g}" for share in cell) for cell in cells]


def hardest(controller: str) -> list[float]:
    """The largest tilts of each preset in the worst of 24 directions, then the largest pushes."""
    robots = bb.Params.preset_names()
    return [bb.run_scenarios(controller, one, robot=robot)[0].score for one in SCENARIOS for robot in robots]


def main() -> int:
    """Prints the rows."""
    recipes = [RECIPE._replace(seed=seed) for seed in SEEDS]
    train_all(recipes)
    robots = ", ".join(bb.Params.preset_names())
    print(f"| seed | family: upright | in place | in place: {robots} | `wide` | tilt, of `lqr` | push, of `lqr` |")
    print("|--:|--:|--:|---|---|---|---|")
    largest = hardest("lqr")
    for recipe in recipes:
        path = recipe.folder / "policy.onnx"
        export(recipe.folder, path, recipe.task)
        print(f"| {recipe.seed} | {' | '.join(row(str(path), largest))} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
