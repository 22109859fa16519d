"""Balancing on wheels that are more slippery than the controllers assume: where learning wins."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import ballbot_rs as bb
from ballbot_rs.analysis.intervals import of_share
from validation.claim import Claim
from validation.page import table
from validation.policies.judging import EPISODES, FIRST_SEED
from validation.policies.training import EVENTS, Recipe
from validation.topic import Findings, Topic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FRICTIONS: Final = (1.0, 0.5, 0.3, 0.25, 0.2, 0.15, 0.12, 0.1)
#: Friction in training; the policies do not observe it.
TRAINED: Final = EVENTS["slippery"][0]["range"]
SEEDS: Final = (0, 1, 2)
#: Torque limits of LQR, N·m; None is its default, the friction limit of the leaning robot at μ = 1.
LIMITS: Final = (None, 0.1, 0.08)

_TEXT: Final = """
The wheels have a friction coefficient below 1, which neither the policies nor LQR are given. LQR limits its torques to
what traction allows at μ = 1, so on slippery wheels its torques cause slip. The policies were trained by PPO on robots
with random friction:

```sh
ballbot train balance --seed 0 --run runs/slippery --timesteps 278528 \\
  --set num_envs=128 --set algorithm_arguments.batch_size=2048 \\
  --set 'events=[{"term": "wheel_dynamic_friction", "range": [0.15, 1.0]}]'
ballbot evaluate runs/slippery --controller lqr --episodes 200 \\
  --set 'events=[{"term": "wheel_dynamic_friction", "range": [0.2, 0.2]}]'
```

LQR with a lower torque limit (`bb.Lqr(params, control_dt=0.01, max_torque=0.1)`) also keeps the robot upright down to
μ = 0.2. No limit that we tried works both for large tilts on dry wheels and for small tilts on the most slippery
wheels. An LQR designed for the true friction is in
[off-nominal robots](robots.md#friction-of-the-wheels-on-the-ball). Each number is the percentage of 200 episodes
without a fall; bands in the figure are the range of the seeds and, for LQR, Wilson's 95 % intervals.
"""

Rates = Mapping[str, Sequence[float]]


def recipes() -> list[Recipe]:
    """All recipes to train."""
    return [Recipe("balance", None, "slippery", seed) for seed in SEEDS]


def topic() -> Topic:
    """The topic."""
    return Topic("slippery", "Slippery wheels", _TEXT.strip(), _run)


def _run() -> Findings:
    sources: dict[str, Any] = {f"policy, seed {one.seed}": one.folder for one in recipes()}
    for limit in LIMITS:
        name = "LQR" if limit is None else f"LQR, at most {limit:g} N·m"
        sources[name] = "lqr" if limit is None else bb.Lqr(bb.Params.paper(), control_dt=0.01, max_torque=limit)
    rates = {name: [_upright(source, friction) for friction in FRICTIONS] for name, source in sources.items()}
    rows = [
        [f"{friction:g}", *(f"{100 * rates[name][i]:.4g}" for name in rates)] for i, friction in enumerate(FRICTIONS)
    ]
    at = FRICTIONS.index(0.2)
    worst = min(found[at] for name, found in rates.items() if name.startswith("policy"))
    below = [Claim("fraction that falls at μ = 0.2, worst policy", 1.0 - worst, 0.0, 0.05, absolute=True)]
    return Findings(below, partial(_draw, rates), table(["μ", *rates], rows), (7.2, 3.4))


def _upright(source: Any, friction: float) -> float:
    events = [{"term": "wheel_dynamic_friction", "range": [friction, friction]}]
    return bb.evaluate(source, episodes=EPISODES, seed=FIRST_SEED, events=events).survival_rate


def _draw(rates: Rates, fig: "Figure") -> None:
    from ballbot_rs.media.figures.panels import MARKERS, look

    axes = fig.subplots()
    axes.axvspan(*TRAINED, color="#868e96", alpha=0.12, linewidth=0, label="friction in training")
    policies = [found for name, found in rates.items() if name.startswith("policy")]
    means = [sum(values) / len(values) for values in zip(*policies, strict=True)]
    shown = {f"policies, seeds {SEEDS[0]} to {SEEDS[-1]}": means}
    shown |= {name: list(found) for name, found in rates.items() if not name.startswith("policy")}
    for number, (name, values) in enumerate(shown.items()):
        style: dict[str, Any] = {**look(number), "marker": MARKERS[number], "markersize": 6.0 - number, "label": name}
        axes.plot(FRICTIONS, [100 * value for value in values], **style)
        bounds = [of_share(value, EPISODES) for value in values]
        if number == 0:
            bounds = [(min(values), max(values)) for values in zip(*policies, strict=True)]
        low, high = ([100 * bound[i] for bound in bounds] for i in (0, 1))
        axes.fill_between(FRICTIONS, low, high, color=look(number)["color"], alpha=0.18, linewidth=0)
    axes.set(xlabel="true friction coefficient of the wheels", ylabel="episodes without a fall (%)", ylim=(-3, 103))
    axes.set(xscale="log", xlim=(0.095, 1.05))
    axes.legend(loc="lower right")
