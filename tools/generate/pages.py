"""`docs/tasks`: a page for each task, and their index."""

from ballbot_rs._core import SCALED_BOUND, TASKS
from generate import tables


def pages() -> dict[str, str]:
    """The text of every page by its file's name."""
    return {"README.md": _index(), **{f"{task}.md": _page(task) for task in TASKS}}


def _index() -> str:
    rows = [[f"[{task}]({task}.md)", f"`{described['id']}`", described["summary"]] for task, described in TASKS.items()]
    return f"""# Tasks

Generated from the tables of the core by `make generate`.

{tables.markdown(("task", "Gymnasium id", "what"), rows)}
"""


def _page(task: str) -> str:
    described = TASKS[task]
    name = tables.class_name(task)
    ends = [[f"`{reason}`", condition] for reason, condition in described["terminations"]]
    return f"""# {task}

{described["summary"]} Generated from the tables of the core by `make generate`.

`gymnasium.make("{described["id"]}")`, `ballbot_rs.{name}Env`, `ballbot_rs.{name}VectorEnv`,
`ballbot_rs.BallbotVecEnv(num_envs, task="{task}")` and `ballbot_rs.Batch(num_envs, "{task}")` are the same task.
An episode has {described["max_episode_steps"]} steps.
A mean return of {described["reward_threshold"]:g} counts as solved.

## Actions

Three numbers in [-1, 1], clipped, times `max_wheel_torque`: the torques of the wheel motors.

## Observations

{len(described["observation"])} float32. Each row saturates at its bound. With `scale_observations` its value at rest
upright is subtracted and the difference divided by its typical magnitude, within ±{SCALED_BOUND:g}.

{tables.markdown(("row", "what", "unit", "bound", "at rest", "typical"), tables.observation_rows(task))}

## Rewards

The sum of the terms, each times its scale. The option `reward` changes scales; those of costs are given without sign.

{tables.markdown(("term", "scale", "formula"), tables.reward_rows(task))}

## Terminations

{tables.markdown(("reason", "condition"), ends)}

Success: {described["success"]}.

## Options

{tables.markdown(("name", "unit", "default", "limit", "what"), tables.option_rows(task))}
"""
