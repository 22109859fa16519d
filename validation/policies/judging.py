"""Episodes of controllers under judges, on all cores."""

import multiprocessing
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

import ballbot_rs as bb
from ballbot_rs._core import TASKS

#: First seed of the bank of starts and commands: episode i has seed 1000 + i, as in `ballbot evaluate`.
FIRST_SEED = 1000

#: Episodes of a cell; fewer in MuJoCo, which takes a hundred times as long.
EPISODES = 200
IN_MUJOCO = 50


class Judge(NamedTuple):
    """Conditions of episodes."""

    name: str
    options: Mapping[str, Any] = {}
    engine: str | None = None
    episodes: int = EPISODES


#: What policies are compared with.
LAWS = ("lqr", "lqr_pi", "cascade_pid")

CONTACT = Judge("`contact`")
RIGID = Judge("`rigid`", {"model": "rigid"})
MUJOCO = Judge("MuJoCo", engine="mujoco", episodes=IN_MUJOCO)


def episodes_of(task: str) -> dict[str, Any]:
    """Options of a task's own episodes, independent of a policy's training: starts, commands, ends, successes."""
    found = {option["name"]: option["default"] for option in TASKS[task]["options"]}
    return {**found, "max_episode_steps": TASKS[task]["max_episode_steps"]}


class Cell(NamedTuple):
    """A controller of a task under a judge."""

    task: str
    controller: str
    judge: Judge
    #: Whether the options are the defaults for the judge's robot, not for the paper's robot.
    is_default: bool = False


def results(cells: Sequence[Cell]) -> list[bb.Result]:
    """The result of each cell, in their order; the slowest begin first."""
    order = sorted(range(len(cells)), key=lambda i: cells[i].judge.engine is None)
    with ProcessPoolExecutor(os.cpu_count(), mp_context=multiprocessing.get_context("spawn")) as pool:
        found = dict(zip(order, pool.map(result, [cells[i] for i in order]), strict=True))
    return [found[i] for i in range(len(cells))]


def result(cell: Cell) -> bb.Result:
    """The result of a cell, on one core."""
    options = {} if cell.is_default else episodes_of(cell.task)
    return bb.evaluate(
        cell.controller,
        task=cell.task,
        episodes=cell.judge.episodes,
        seed=FIRST_SEED,
        num_threads=1,
        # The judge's options replace the task's.
        **{**options, **cell.judge.options},
        engine=cell.judge.engine,
    )
