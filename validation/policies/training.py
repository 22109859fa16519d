"""Training runs of the configurations that come with the package."""

import json
import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from ballbot_rs import Params

ROOT = Path(__file__).parents[2]

#: Folder of runs, kept between calls.
RUNS = ROOT / "runs" / "policies"

#: Concurrent runs, each on one core: the learner is the slower part, and has one thread.
AT_ONCE = 2

#: Events of recipes, apart from the sets of the package.
EVENTS: Mapping[str, Any] = {"slippery": [{"term": "wheel_dynamic_friction", "range": [0.15, 1.0]}]}

#: What recipes with events change in the configuration of a task: random robots need larger batches than one robot.
CHANGES: Mapping[str, Mapping[str, object]] = {
    "balance": {"num_envs": 128, "algorithm_arguments.batch_size": 2048, "total_timesteps": 278_528}
}


class Recipe(NamedTuple):
    """A run: a configuration that comes with the package, with events and a seed."""

    task: str
    #: Name for `ballbot train --config`; None is the task's own.
    variant: str | None = None
    events: str | None = None
    seed: int = 0
    #: Name of a robot, or its TOML file in the repository; None is the configuration's.
    robot: str | None = None

    @property
    def name(self) -> str:
        """Name of its folder."""
        robot = None if self.robot is None else Path(self.robot).stem
        parts = (self.task, self.variant, self.events, robot, f"seed-{self.seed}")
        return "-".join(str(part) for part in parts if part)

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return RUNS / self.name

    @property
    def robot_options(self) -> dict[str, Any]:
        """The option `robot` of its environment, if it names a robot."""
        if self.robot is None:
            return {}
        is_file = self.robot.endswith(".toml")
        return {"robot": Params.from_toml(ROOT / self.robot).to_dict() if is_file else self.robot}


def train_all(recipes: Sequence[Recipe]) -> None:
    """Trains recipes that have not been trained with their present configuration."""
    pending = [recipe for recipe in recipes if not _is_done(recipe)]
    with ProcessPoolExecutor(AT_ONCE, mp_context=multiprocessing.get_context("spawn")) as pool:
        for recipe, seconds in zip(pending, pool.map(_train, pending), strict=True):
            print(f"trained {recipe.name} in {seconds:.0f} s", flush=True)


def _text(recipe: Recipe) -> str:
    from ballbot_rs.training import config

    values: dict[str, object] = {"num_threads": 1}
    if recipe.events is not None:
        values["env.events"] = EVENTS.get(recipe.events, recipe.events)
        values |= CHANGES.get(recipe.task, {})
    values |= {f"env.{name}": value for name, value in recipe.robot_options.items()}
    variant = None if recipe.variant is None else Path(recipe.variant)
    return config.with_values(config.load(recipe.task, variant, recipe.robot)[1], values)


def _is_done(recipe: Recipe) -> bool:
    from ballbot_rs.control import sb3_policy
    from ballbot_rs.envs._batch_env import new_batch, resolved_options
    from ballbot_rs.training import config, run_folder

    text = _text(recipe)
    if not (recipe.folder / run_folder.FINAL).is_file() or run_folder.read_config_text(recipe.folder) != text:
        return False
    # The defaults of the task may have changed since.
    options = config.parse(text, recipe.name).env
    now = resolved_options(new_batch(1, task=recipe.task, num_threads=1, options=options), options)
    _, kept = sb3_policy.load(recipe.folder / run_folder.FINAL, recipe.task)
    # An option that did not exist then has its default now, unless the configuration names it.
    usual = new_batch(1, task=recipe.task, num_threads=1).options
    then = {name: value for name, value in usual.items() if name not in kept["env_options"]} | kept["env_options"]
    return bool(json.dumps(then, sort_keys=True) == json.dumps(now, sort_keys=True))


def _train(recipe: Recipe) -> float:
    import time

    from ballbot_rs.training import config, train

    text, began = _text(recipe), time.perf_counter()
    train.train(
        config.parse(text, recipe.name), text, recipe.folder, seed=recipe.seed, overwrite=True, progress_bar=False
    )
    return time.perf_counter() - began
