"""Automatic tuning: optimizes the options of a controller on scenarios, with the same budget for all controllers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ballbot_rs import _short
from ballbot_rs._checks import check_count, check_seed
from ballbot_rs._core import CONTROLLERS
from ballbot_rs._extras import require
from ballbot_rs._keywords import named
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.catalog import make_controller
from ballbot_rs.control.resolve import ResolvedController
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.run import outcome_on, run_scenarios
from ballbot_rs.scenarios.scenario import Scenario, load, select
from ballbot_rs.scenarios.stage import Stage

#: Initial standard deviation of the logarithm of each option.
_SPREAD: Final = 0.3

#: Largest cost of a scenario: a controller falls, or cannot be made.
_WORST: Final = 10.0

#: Options that are only searched if named: no default scenario turns the robot, options of the adaptation have no
#: effect by default, and the others trade computing time for accuracy.
_LEFT_ALONE: Final = (
    "yaw",
    "yaw_rate",
    "yaw_bandwidth",
    "yaw_damping",
    "yaw_surface",
    "yaw_switching",
    "yaw_layer",
    "leakage",
    "max_switching",
    "horizon",
    "iterations",
    "samples",
    "step",
)

#: Default tuning scenarios: a push, a fast move, a circle, and the cost of noise, with a delay of 10 ms.
DEFAULT: Final = (
    # A three-wheeled robot is symmetric under a third of a turn and mirroring: these are 0, 30 and 60 deg.
    Scenario(
        "push",
        "Push at once",
        seconds=4.0,
        push=(1.2, 2.5, 0.1),
        directions=4,
        actuators={"delay": 0.01},
        score="map",
    ),
    Scenario(
        "line",
        "1 m in 3.1 s",
        seconds=5.0,
        reference={"kind": "line", "goal": [1.0, 0.0], "seconds": 3.1},
        actuators={"delay": 0.01},
        score="rms_error",
    ),
    Scenario(
        "circle",
        "Circle of 0.5 m in 6 s",
        seconds=10.0,
        measure_from=7.0,
        reference={"kind": "circle", "radius": 0.5, "period": 6.0},
        actuators={"delay": 0.01},
        score="rms_error",
    ),
    # Without it the largest gains would be the best.
    Scenario(
        "noise",
        "Station keeping on sensors",
        seconds=4.0,
        sensors="kugle",
        actuators={"delay": 0.01},
        seeds=8,
        score="rms_torque",
    ),
)


@dataclasses.dataclass(frozen=True, repr=False)
class Tuned:
    """Options of a controller found by a search.

    ```python
    lean = bb.Scenario("lean", "Release at 5 deg", seconds=1.0, tilt=5.0, score="rms_tilt")
    found = bb.tune("lqr", lean, budget=6, options=["position"])
    print(bb.compare(["lqr", found.source()], episodes=5))
    ```
    """

    controller: str
    #: Best options by name.
    options: Mapping[str, float]
    #: Mean over the scenarios of the ratio of the score to the baseline's; less is better.
    cost: float
    #: Best cost after each evaluation.
    history: Sequence[float]

    def __repr__(self) -> str:
        options = ", ".join(f"{name}={_short.number(value)}" for name, value in self.options.items())
        return f"<Tuned {self.controller}: cost {self.cost:.4g} after {len(self.history)} evaluations, {options}>"

    def source(self) -> ResolvedController:
        """The tuned controller, in the form that `compare`, `run_scenarios` and others take."""
        return with_options(self.controller, self.options, f"{self.controller} (tuned)")


def with_options(name: str, options: Mapping[str, float], title: str | None = None) -> ResolvedController:
    """A controller of the core with options, for any robot."""
    return ResolvedController(
        title or name,
        make_law=lambda params, control_dt: make_controller(name, params, control_dt, **options),
        control_dt=CONTROLLERS[name]["control_dt"],
        law_options=options,
    )


@named
def tune(
    controller: str,
    scenarios: str | Scenario | Sequence[str | Scenario] = (),
    budget: int = 2000,
    *,
    options: Sequence[str] | None = None,
    baseline: str | None = None,
    robot: Robot | None = None,
    model: str = "contact",
    seed: int = 0,
    num_threads: int | None = None,
    progress: Progress = no_progress,
) -> Tuned:
    """Optimizes the logarithms of a controller's options by CMA-ES, starting from the defaults.

    ```python
    lean = bb.Scenario("lean", "Release at 5 deg", seconds=1.0, tilt=5.0, score="rms_tilt")
    found = bb.tune("lqr", lean, budget=6, options=["position", "torque"], robot="kugle")
    print(found.options, bb.evaluate(found.source(), robot="kugle", episodes=5).success_rate)
    ```

    The cost of a scenario is the ratio of its score to the baseline's, inverted if higher is better.

    Args:
        controller: the name of a controller of the core.
        scenarios: ids or `Scenario`s, one or more, equally weighted; empty means a push, a line, a circle and noise.
        budget: number of evaluations.
        options: names of the options to search; None searches all whose default is above zero, except options
            for the heading, for trading off accuracy and speed, and without effect by default.
        baseline: the controller of the core whose scores with default options count as 1; None is the controller
            itself. With the same baseline the costs of several controllers can be compared.
        robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
        model: of the robot.
        seed: of the search and of everything random in the scenarios.
        num_threads: threads that step the robots; None uses all cores.
        progress: called with the number of evaluations done and their total.

    Raises:
        ValueError: an unknown name, no option to search, or a controller that fails the scenarios by default.
        ModuleNotFoundError: `cmaes` is missing; the message states what to install.
    """
    with require("tune", "tune"):
        import cmaes
    for name in (controller, controller if baseline is None else baseline):
        if name not in CONTROLLERS:
            raise ValueError(f"tune takes a controller of the core, one of {', '.join(CONTROLLERS)}, not '{name}'")
    budget, seed = check_count("budget", budget), check_seed(seed)
    params = params_of(robot)
    known: dict[str, float] = {
        option["name"]: option["default"] * (params.scale(option["unit"]) if option["scaled"] else 1.0)
        for option in CONTROLLERS[controller]["options"]
        if isinstance(option["default"], float) and option["default"] > 0.0
    }
    names = [name for name in known if name not in _LEFT_ALONE] if options is None else list(options)
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(f"{controller} has no option {unknown} to search: expected some of {', '.join(known)}")
    chosen = [scenarios] if isinstance(scenarios, (str, Scenario)) else list(scenarios) or list(DEFAULT)
    known_scenarios = load()
    stages = [
        Stage(with_options(controller, {}), one, params, model=model, seed=seed, num_threads=num_threads)
        for requested in chosen
        for one in ([requested] if isinstance(requested, Scenario) else select([requested], known_scenarios))
    ]

    if len({one.scenario.id for one in stages}) < len(stages):
        raise ValueError(f"two of {[one.scenario.id for one in stages]} have the same id: name a scenario once")

    def outcomes(found: Mapping[str, float]) -> list[Outcome]:
        made = [outcome_on(stage, with_options(controller, found)) for stage in stages]
        return [outcome for outcome in made if outcome.skipped is None]

    def scores(of: Sequence[Outcome]) -> dict[str, float]:
        return {outcome.scenario.id: outcome.score for outcome in of}

    default = {name: known[name] for name in names}
    own = scores(outcomes(default))
    first = own
    if baseline not in (None, controller):
        assert baseline is not None
        others = run_scenarios(
            [with_options(baseline, {})], [one.scenario for one in stages], robot=params, model=model, seed=seed
        )
        first = {name: score for name, score in scores(others).items() if name in own}
    for by, of in ((controller, own), (baseline, first)):
        bad = [one for one in own if not (math.isfinite(of.get(one, math.nan)) and of[one] > 0.0)]
        if bad or not own:
            raise ValueError(f"{by} with its default options has no score in {bad or chosen} to improve on")

    def cost(found: Mapping[str, float]) -> float:
        try:
            made = outcomes(found)
        except ValueError:
            # Options out of range, or an unstable loop.
            return _WORST
        return mean_ratio(made, first)

    least = cost(default)
    best, history = default, [least]
    start = np.log([known[name] for name in names])
    # CMA-ES needs two dimensions.
    padding = max(2 - len(names), 0)
    search = cmaes.CMA(mean=np.concatenate([start, np.zeros(padding)]), sigma=_SPREAD, seed=seed % 2**32)
    while len(history) < budget:
        solutions = []
        for _ in range(search.population_size):
            place = search.ask()
            found = dict(zip(names, np.exp(np.clip(place, -40.0, 40.0)).tolist(), strict=False))
            value = cost(found) if len(history) < budget else _WORST
            solutions.append((place, value))
            if value < least:
                best, least = found, value
            history.append(least)
            progress(min(len(history), budget), budget)
        search.tell(solutions)
    return Tuned(controller, best, least, history[:budget])


def mean_ratio(outcomes: Sequence[Outcome], first: Mapping[str, float]) -> float:
    """Mean ratio of the scores to `first`, less is better; a fall counts as 10, a skipped scenario not at all."""
    run = [outcome for outcome in outcomes if outcome.skipped is None]
    return float(np.mean([_ratio(outcome, first[outcome.scenario.id]) for outcome in run]))


def _ratio(outcome: Outcome, first: float) -> float:
    score = outcome.score
    ratio = first / max(score, 1e-300) if outcome.higher_is_better else score / first
    return min(ratio, _WORST) if math.isfinite(ratio) else _WORST
