"""Policies of all tasks, trained with and without random robots, under judges that are not part of the training.

Arms: *none* is the configuration of the package, *mild* and *hard* are the same with the [events](randomization.md) of
that name; balance then trains on 128 robots for 278 528 steps, in batches of 2048. LQR is the baseline: where it is
worse too, the judge is harder; where only the policy is worse, the policy has been fitted to its simulator.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import ballbot_rs as bb
from validation.claim import Claim
from validation.page import table
from validation.policies.judging import CONTACT, MUJOCO, RIGID, Cell, Judge, results
from validation.policies.tables import interval, measure
from validation.policies.training import Recipe
from validation.topic import Findings, Topic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TASKS: Final = ("balance", "velocity", "goal", "path", "push")

#: Events that a policy is trained with, by the name of the arm.
ARMS: Final[Mapping[str, str | None]] = {"none": None, "mild": "mild", "hard": "hard"}

#: The task that all arms are trained for with five seeds.
FIVE_SEEDS: Final = "balance"

#: Episodes of a cell; fewer in MuJoCo.
EPISODES: Final = 100
IN_MUJOCO: Final = 20


def _changed(term: str, op: str, by: object) -> dict[str, object]:
    """A changed robot, unknown to the controllers: laws are made for the nominal robot."""
    return {"events": [{"term": term, "mode": "reset", "op": op, "dist": "uniform", "range": by}]}


JUDGES: Final = (
    CONTACT,
    RIGID,
    MUJOCO,
    Judge("sensors", {"sensors": "kugle", "observation": "sensors"}),
    *(Judge(f"delay {ms} ms", {"actuators": {"delay": ms / 1000.0}}) for ms in (10, 20, 30)),
    Judge("body 20 % heavier", _changed("body_mass", "scale", [1.2, 1.2])),
    Judge("CoM 10 % higher", _changed("body_com_height", "scale", [1.1, 1.1])),
    Judge("CoM 5 mm off", _changed("body_com_offset", "add", [[0.005, 0.005], [0.0, 0.0]])),
    Judge("`mild`", {"events": "mild"}),
    Judge("`hard`", {"events": "hard"}),
)

#: Criterion of each task: a measure of `tables.measure`, its name on the page, unit, and the largest value with
#: which a policy counts as transferred. Set before the first run.
MEASURES: Final = {
    "balance": ("failures", "episodes without success", "", 0.02),
    "velocity": ("velocity_error", "settled error of the velocity", "m/s", 0.04),
    "goal": ("missed_goals", "goals not held", "", 0.05),
    "path": ("cross_track_error", "error across the path", "m", 0.02),
    "push": ("failures", "episodes with a fall", "", 0.1),
}

#: The judges under which the policies without random robots must transfer; the others are only measured.
CLAIMED: Final = (CONTACT, RIGID, MUJOCO)


def recipes() -> list[Recipe]:
    """All recipes to train."""
    seeds = {task: range(5 if task == FIVE_SEEDS else 1) for task in TASKS}
    return [Recipe(task, None, events, seed) for task in TASKS for events in ARMS.values() for seed in seeds[task]]


def topics() -> list[Topic]:
    """One topic per task, and one on seeds."""
    found = [Topic(task, task.capitalize(), _about(task), partial(_run, task)) for task in TASKS]
    about = (
        f"The task {FIVE_SEEDS}, seeds 0 to 4 of each arm: the mean over the seeds of the fraction of episodes without "
        "success, in percent, and the worst seed."
    )
    return [*found, Topic("seeds", "Five seeds", about, _run_seeds)]


def _about(task: str) -> str:
    _, what, unit, most = MEASURES[task]
    limit = f"{100 * most:g} %" if not unit else f"{most:g} {unit}"
    numbers = unit or "%"
    return f"Judged by: {what} ({numbers}). A policy transfers where that is at most {limit}."


def _run(task: str) -> Findings:
    name, what, unit, most = MEASURES[task]
    sources = {arm: str(Recipe(task, None, events).folder) for arm, events in ARMS.items()}
    sources["`lqr`"] = "lqr"
    cells = {
        (judge.name, arm): Cell(task, source, _short(judge)) for judge in JUDGES for arm, source in sources.items()
    }
    found = dict(zip(cells, results(list(cells.values())), strict=True))
    values = {place: measure(result, name) for place, result in found.items()}
    claims = [
        Claim(f"{what}, arm none, {judge.name}", values[judge.name, "none"], 0.0, most, unit, absolute=True)
        for judge in CLAIMED
    ]
    lines = [[judge.name, *(_text(found[judge.name, arm], name, unit) for arm in sources)] for judge in JUDGES]
    text = f"{table(['judge', *sources], lines)}\n\n{_verdict(values, most)}"
    return Findings(claims, partial(_draw, task, list(sources), values), text)


def _short(judge: Judge) -> Judge:
    """A judge with fewer episodes."""
    return judge._replace(episodes=EPISODES if judge.engine is None else IN_MUJOCO)


def _text(result: bb.Result, name: str, unit: str) -> str:
    """Measure with its interval, in percent or in its unit, and the fraction of falls if there are any."""
    scale = 1.0 if unit else 100.0
    value, (low, high) = scale * measure(result, name), (scale * bound for bound in interval(result, name))
    text = "none" if math.isnan(value) else f"{value:.3g} ({low:.3g} … {high:.3g})"
    fallen = 1.0 - result.survival_rate
    return text if fallen == 0.0 or name == "failures" else f"{text}, falls {100.0 * fallen:.3g} %"


def _verdict(values: Mapping[tuple[str, str], float], most: float) -> str:
    """Number of judges under which each arm transfers."""
    counts = [f"{arm} {sum(values[judge.name, arm] <= most for judge in JUDGES)}" for arm in (*ARMS, "`lqr`")]
    return f"Transfers under how many of {len(JUDGES)} judges: {', '.join(counts)}."


#: Labels of arms that are not policies.
_NAMES = {"`lqr`": "LQR"}


def _draw(task: str, arms: Sequence[str], values: Mapping[tuple[str, str], float], fig: "Figure") -> None:
    _, what, unit, most = MEASURES[task]
    scale, label = (1.0, f"{what} ({unit})") if unit else (100.0, f"{what} (%)")
    axes = fig.subplots()
    for k, arm in enumerate(arms):
        places = [i + 0.2 * (k - 1.5) for i in range(len(JUDGES))]
        axes.bar(places, [scale * values[judge.name, arm] for judge in JUDGES], 0.18, label=_NAMES.get(arm, arm))
    axes.axhline(scale * most, color="black", linewidth=0.8, linestyle="--", label="limit")
    axes.set_xticks(range(len(JUDGES)), [judge.name.strip("`") for judge in JUDGES], rotation=30, ha="right")
    axes.set_ylabel(label)
    axes.legend(ncols=5)


def _run_seeds() -> Findings:
    name = MEASURES[FIVE_SEEDS][0]
    judges = [judge for judge in JUDGES if judge.engine is None]
    cells = {
        (judge.name, arm, seed): Cell(FIVE_SEEDS, str(Recipe(FIVE_SEEDS, None, events, seed).folder), _short(judge))
        for judge in judges
        for arm, events in ARMS.items()
        for seed in range(5)
    }
    found = {
        place: 100.0 * measure(result, name) for place, result in zip(cells, results(list(cells.values())), strict=True)
    }
    lines = []
    for judge in judges:
        line = [judge.name]
        for arm in ARMS:
            shares = [found[judge.name, arm, seed] for seed in range(5)]
            line += [f"{sum(shares) / 5:.3g}", f"{max(shares):.3g}"]
        lines.append(line)
    return Findings([], None, table(["judge", *(text for arm in ARMS for text in (arm, "worst"))], lines))
