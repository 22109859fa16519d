"""Options that the same search with the same budget found for every law of the core, and their cost."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from ballbot_rs import _toml
from ballbot_rs._core import CONTROLLERS
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.tune import DEFAULT, mean_ratio, tune, with_options

#: Evaluations of each law, including the first with the default options.
BUDGET: Final = 2000
SEED: Final = 0
#: The law whose default options have the cost 1.
BASELINE: Final = "lqr"
PATH: Final = Path(__file__).with_name("tuned.toml")

_HEAD = f"""\
# Options that `bb.tune` found for the paper's robot: {BUDGET} evaluations of its default scenarios a law, seed {SEED}.
# Written by `python -m validation.controllers.tune_all`. The cost of `{BASELINE}` with its default options is 1.
"""


class TunedLaw(NamedTuple):
    """The result of the search for a law."""

    cost: float
    options: Mapping[str, float]


@cache
def tuned() -> Mapping[str, TunedLaw]:
    """The contents of the file, by law."""
    tables: Mapping[str, Any] = _toml.loads(PATH.read_text(encoding="utf-8")) if PATH.exists() else {}
    return {name: TunedLaw(table["cost"], table["options"]) for name, table in tables.items()}


@cache
def _baseline() -> Mapping[str, float]:
    """Scores that count as 1."""
    outcomes = run_scenarios(with_options(BASELINE, {}), DEFAULT, seed=SEED)
    return {outcome.scenario.id: outcome.score for outcome in outcomes}


def cost(law: str, options: Mapping[str, float]) -> float:
    """The cost that the search minimizes."""
    return mean_ratio(run_scenarios(with_options(law, options), DEFAULT, seed=SEED), _baseline())


def write(found: Mapping[str, TunedLaw]) -> None:
    """Writes the file, the laws in the order of the core."""
    parts = [_HEAD]
    for name in CONTROLLERS:
        if name in found:
            options = "".join(f"{option} = {value!r}\n" for option, value in found[name].options.items())
            parts.append(f"[{name}]\ncost = {found[name].cost!r}\n[{name}.options]\n{options}")
    PATH.write_text("\n".join(parts), encoding="utf-8")


def search(law: str, num_threads: int | None = 1) -> TunedLaw:
    """Searches the options of a law with the budget."""
    found = tune(law, DEFAULT, BUDGET, baseline=BASELINE, seed=SEED, num_threads=num_threads)
    return TunedLaw(found.cost, found.options)
