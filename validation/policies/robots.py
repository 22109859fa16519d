"""Policies of each task on each robot, trained with one command."""

from collections.abc import Mapping

import ballbot_rs as bb
from ballbot_rs.training import run_folder
from validation.claim import Claim
from validation.page import table
from validation.policies.judging import CONTACT, LAWS, Cell, results
from validation.policies.training import Recipe
from validation.topic import Findings, Topic

TASKS = ("balance", "velocity", "goal", "path", "push")

#: What the success of a policy may be below the success of the best law, with the rounding of 1 - 0.97.
MARGIN = 0.03 + 1e-9

_TEXT = """
Seed 0 of `ballbot train TASK --robot ROBOT`, with no other option, and the best of `lqr`, `lqr_pi` and `cascade_pid` in
the same episodes: the success rate of the policy and of the law, and the steps and seconds of PPO after the fit,
which takes 30 to 50 s. Each training run used one of two busy cores.
"""


def recipes() -> list[Recipe]:
    """All recipes to train."""
    return [Recipe(task, robot=robot) for task in TASKS for robot in bb.Params.preset_names()]


def topic() -> Topic:
    """The topic of all tasks and robots."""
    return Topic("robots", "All tasks on all robots", _TEXT.strip(), _run)


def _run() -> Findings:
    cells = {
        (recipe, name): Cell(recipe.task, source, CONTACT._replace(options=recipe.robot_options), is_default=True)
        for recipe in recipes()
        for name, source in [("policy", str(recipe.folder)), *((law, law) for law in LAWS)]
    }
    found = dict(zip(cells, results(list(cells.values())), strict=True))
    claims, lines = [], []
    for task in TASKS:
        line = [f"[{task}](tasks/{task}.md)"]
        for robot in bb.Params.preset_names():
            recipe = Recipe(task, robot=robot)
            policy = found[recipe, "policy"].success_rate
            best = max(LAWS, key=lambda law: found[recipe, law].success_rate)
            law = found[recipe, best].success_rate
            what = f"success below the best law, {task}, {robot}"
            claims.append(Claim(what, max(law - policy, 0.0), 0.0, MARGIN, "", absolute=True))
            line.append(
                f"{100 * policy:.4g} %, `{best}` {100 * law:.4g} %, {_effort(run_folder.read_record(recipe.folder))}"
            )
        lines.append(line)
    return Findings(claims, None, table(["task", *bb.Params.preset_names()], lines))


def _effort(record: Mapping[str, object]) -> str:
    steps, seconds = record["timesteps"], record["seconds"]
    assert isinstance(steps, int)
    assert isinstance(seconds, float)
    return f"{1e-6 * steps:.2g} M, {seconds:.0f} s"
