r"""Default, published and tuned.

The same control law with different parameters is effectively a different controller. Each law is tested with its
default options; with published options, where a source gives all parameters of the law and of its robot; and with
options that a search with the same budget for all found.

**Published** loops are transferred to the paper's robot through their poles, scaled by the ratio of $\lambda$ of the
two robots. The linear regulators `lqr` and `mpc` have weights that follow from poles in closed form: with $w = s^2$ and
the [plane](laws.md#one-vertical-plane)

```math
p(s) p(-s) = w^2(w - \lambda^2)^2 + (q_y - q_{\dot y} w)(g_\theta - \ell w)^2 + q_\theta w^2 - q_{\dot\theta} w^3 ,
```

one more weight in each coefficient. OCS2's weight of the lean would be negative and is set to zero, which moves its
poles by less than 5 %. The numbers are in [`published.toml`](../validation/controllers/published.toml): the LQR and the
input-output linearization of CMU's ballbot, the weights of OCS2's NMPC, of which `mpc` implements only the regulator
part, and Kugle's calm sliding mode (its firmware forbids the aggressive tuning under a velocity loop), with the default
position loop. `pid` has the paper's gains by default.

**Tuned** options were found by `bb.tune` with 2000 evaluations per law and the same seed for all, from the default
options; `mppi` and `nmpc` are too slow for this. The cost is the mean of a push, a line, a circle and the torque of
station keeping on noisy sensors, all with a delay of 10 ms, relative to `lqr`; for `pid`, it is the mean of only the
first and the last. They are in [`tuned.toml`](../validation/controllers/tuned.toml), made by `python -m
validation.controllers.tune_all`. The search optimizes only the cost: other columns may become worse. All tunings have
the same last stage.

The figure has a row per law: the error on a fast circle, the worst-case push limit, and the torque due to noise.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from ballbot_rs._core import CONTROLLERS, Params
from ballbot_rs.media.figures.labels import short
from ballbot_rs.scenarios.matrix import cell, unit
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scenario import load
from ballbot_rs.scenarios.tune import with_options
from validation.claim import Claim
from validation.controllers import matrix, published, tuning
from validation.controllers.planners import PLANNERS
from validation.page import table
from validation.topic import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Columns of the table and their titles.
COLUMNS: Final = {
    "S1-sensors": "noise",
    "S2-rest": "tilt",
    "S3-at-once": "push",
    "S3-slow": "push in 0.1 s",
    "S4": "push of 0.5 N·s",
    "S10-3.1s": "line",
    "S13-4s": "circle in 4 s",
    "S15-6s": "lemniscate in 6 s",
    "S18-30ms": "push, delay 30 ms",
    "S18-circle": "circle in 6 s, delay 30 ms",
    "S19-0.3": "tilt, friction 0.3",
    "S20-circle": "circle in 6 s, model off",
    "S22-6s": "circle in 6 s, all at once",
}
DEFAULT, PUBLISHED, TUNED = "default", "published", "tuned"

#: Outcomes by law, tuning and scenario.
Found = Mapping[tuple[str, str, str], Outcome]


def options(law: str) -> dict[str, Mapping[str, float]]:
    """Options of a law by tuning, except the defaults."""
    found: dict[str, Mapping[str, float]] = {}
    if law in published.published():
        found[PUBLISHED] = published.options(law, Params.paper())
    if law in tuning.tuned():
        found[TUNED] = tuning.tuned()[law].options
    return found


def measured() -> dict[tuple[str, str, str], Outcome]:
    """Outcomes of the table; outcomes of the default options and of the policy come from the matrix."""
    found: dict[tuple[str, str, str], Outcome] = {}
    for law in matrix.names():
        for scenario in COLUMNS:
            one = matrix.outcome(law, scenario)
            if one is not None:
                found[law, DEFAULT, scenario] = one
        for name, chosen in options(law).items():
            for one in run_scenarios(with_options(law, chosen), list(COLUMNS)):
                if one.skipped is None:
                    found[law, name, one.scenario.id] = one
    return found


def run() -> Findings:
    """All tunings side by side."""
    found = measured()
    return Findings(claims(), lambda fig: draw(fig, found), _table(found), (9.0, 4.0))


def claims() -> list[Claim]:
    """Claims that the tuned options have the cost that the search reported."""
    return [
        Claim(f"cost of {law}, tuned", tuning.cost(law, one.options), one.cost, 1e-6, "", True)
        for law, one in tuning.tuned().items()
    ]


def _table(found: Found) -> str:
    scenarios = load()
    head = ["law", "tuning", "cost", *(f"{title} ({unit(scenarios[name])})" for name, title in COLUMNS.items())]
    rows = []
    for law in matrix.names():
        for name in (DEFAULT, *options(law)):
            cells = [cell(found.get((law, name, scenario))) for scenario in COLUMNS]
            rows.append([f"`{law}`", name, _cost(law, name), *cells])
    return table(head, rows)


def _cost(law: str, name: str) -> str:
    if law not in CONTROLLERS or law in PLANNERS:
        return "-"
    return f"{tuning.cost(law, options(law).get(name, {})):.3g}"


def draw(fig: "Figure", found: Found) -> None:
    """A row per law, a panel per quantity, a mark per tuning."""
    from matplotlib.lines import Line2D

    from ballbot_rs.media.figures.style import COLORS, INK

    needed = ("S13-4s", "S3-at-once", "S1-sensors")
    # `mppi` and `nmpc` are not pushed.
    laws = [law for law in matrix.names() if all((law, DEFAULT, scenario) in found for scenario in needed)]
    looks: dict[str, dict[str, Any]] = {
        DEFAULT: {"marker": "o", "color": COLORS[0]},
        PUBLISHED: {"marker": "x", "color": COLORS[1], "markeredgewidth": 1.6},
        TUNED: {"marker": "s", "color": COLORS[2], "markerfacecolor": "none"},
    }
    axes = fig.subplots(1, 3, sharey=True)
    for row, law in enumerate(laws):
        tunings = [name for name in looks if all((law, name, scenario) in found for scenario in needed)]
        for ax, value in zip(axes, _QUANTITIES, strict=True):
            values = [value(found, law, name) for name in tunings]
            ax.plot([min(values), max(values)], [row, row], color=INK, linewidth=0.7, alpha=0.5)
            for name, x in zip(tunings, values, strict=True):
                ax.plot(x, row, linestyle="none", markersize=6, **looks[name])
    axes[0].set_yticks(range(len(laws)), [short(law) for law in laws])
    axes[0].invert_yaxis()
    axes[0].set(xlabel="circle in 4 s, error (mm rms)", xscale="log")
    axes[1].set(xlabel="worst push (N\u00b7s)")
    axes[2].set(xlabel="torque on sensors (mN\u00b7m rms)", xlim=(0, None))
    keys = [Line2D([], [], linestyle="none", label=name, **look) for name, look in looks.items()]
    fig.legend(handles=keys, loc="outside lower center", ncols=3)


#: Tracking error (mm), push (N\u00b7s) and torque due to noise (mN\u00b7m).
_QUANTITIES: Final[tuple[Callable[[Found, str, str], float], ...]] = (
    lambda found, law, name: 1e3 * found[law, name, "S13-4s"].score,
    lambda found, law, name: found[law, name, "S3-at-once"].score,
    lambda found, law, name: 1e3 * float(found[law, name, "S1-sensors"].metrics["rms_torque"].mean()),
)
