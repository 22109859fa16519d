"""The policy for any robot, trained with each of five seeds.

`python -m validation.policies.any_seeds` prints a table; a training takes 18 minutes of a core, and two run at once.
All seeds have the same robots in their training: they differ in the first weights, the noise, the starts and the
evolution.
"""

import sys
from typing import Final

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs.training.export import export
from validation.policies.any_robot import COMMANDS, RECIPE, conditions, driven, largest, of_policy
from validation.policies.training import train_all

Rows = npt.NDArray[np.float64]

SEEDS: Final = range(5)


def row(policy: str, limits: Rows) -> list[str]:
    """What a policy reaches, its fractions of a law's largest tilts and pushes (%), and its velocity error (cm/s)."""
    presets = bb.Params.preset_names()
    in_contact = [one for one in conditions() if one.engine is None and "model" not in one.options]
    family, *others = [of_policy(one, policy) for one in in_contact]
    nominal, wide = (others[i : i + len(presets)] for i in (0, len(presets)))
    fractions = (hardest(policy) / limits).T
    errors = [max(driven(policy, robot, options)[0] for options in COMMANDS.values()) for robot in presets]
    cells = [[family.upright], *([share.in_place for share in one] for one in ([family], nominal, wide)), *fractions]
    shown = [", ".join(f"{100.0 * share:.4g}" for share in cell) for cell in cells]
    return [*shown, ", ".join(f"{100.0 * error:.3g}" for error in errors)]


def hardest(controller: str) -> Rows:
    """The largest tilt and push of each preset, shape (presets, 2)."""
    return np.array([largest(controller, robot) for robot in bb.Params.preset_names()])


def main() -> int:
    """Prints the rows."""
    recipes = [RECIPE._replace(seed=seed) for seed in SEEDS]
    train_all(recipes)
    robots = ", ".join(bb.Params.preset_names())
    measures = f"family: upright | in place | in place: {robots} | `wide` | tilt, of `lqr` | push, of `lqr`"
    print(f"| seed | {measures} | velocity error, cm/s |")
    print("|--:|--:|--:|---|---|---|---|---|")
    limits = hardest("lqr")
    for recipe in recipes:
        path = recipe.folder / "policy.onnx"
        export(recipe.folder, path, recipe.task)
        print(f"| {recipe.seed} | {' | '.join(row(str(path), limits))} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
