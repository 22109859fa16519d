"""The policies that come with the package: their recipes, requirements and results."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import ballbot_rs as bb
from ballbot_rs.scenarios.scale import Scale
from ballbot_rs.training import config
from validation.claim import Claim
from validation.page import table
from validation.policies.judging import CONTACT, LAWS, MUJOCO, RIGID, Cell, Judge, results
from validation.policies.tables import head, interval, measure, row
from validation.policies.training import Recipe
from validation.topic import Comparison, Findings, Topic

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

#: Training seeds of each policy; the policy of the first is shipped.
SEEDS = (0, 1, 2)

#: Variants of the default policies, where these are not of the task's own configuration.
DEFAULTS = {"balance": "still", "push": "recover"}

JUDGES = (CONTACT, RIGID, MUJOCO)


class Limit(NamedTuple):
    """A requirement of a policy, set before its training: a bound of a judge's result."""

    what: str
    #: Name of a metric of the task, or "failures", the fraction of episodes without success.
    name: str
    most: float
    unit: str
    judge: Judge


class Shipped(NamedTuple):
    """A policy that comes with the package."""

    title: str
    recipe: Recipe
    #: The first decides whether the policy or a law is better.
    limits: Sequence[Limit]
    #: Scenarios with a claim on the worst direction, with the least tilt (deg) or impulse (N·s).
    least: Mapping[str, tuple[str, float, str]] = {}
    #: What it is compared with the laws under, its training's conditions first.
    judges: Sequence[Judge] = JUDGES
    #: Text of its section on the task, the robot and the judges.
    about: str = ""

    @property
    def name(self) -> str:
        """Name of its topic."""
        # The name of a task alone means the default policy.
        variant = None if self.recipe.variant == DEFAULTS.get(self.recipe.task) else self.recipe.variant
        return "-".join(filter(None, (self.recipe.task, variant)))

    @property
    def file(self) -> str:
        """Its file in assets/policies."""
        return f"{self.name}.onnx"

    def cell(self, source: str, judge: Judge) -> Cell:
        """A controller of its task on its robot under a judge."""
        robot = self.recipe.robot_options
        return Cell(self.recipe.task, source, judge._replace(options={**robot, **judge.options}), bool(robot))


_REAL = Judge(
    "sensors, 10 ms delay, `mild`",
    {"sensors": "kugle", "observation": "sensors", "actuators": {"delay": 0.01}, "events": "mild"},
)
_FIELD = Judge("`contact`, potential field", {"guide": 1})
_FAST = Judge("`contact`, all at 0.5 m/s", {"path_speed": (0.5, 0.5)})


#: The engines of the package, where others cannot simulate the task.
_OURS = (CONTACT, RIGID)


def _in_engines(what: str, name: str, most: float, unit: str, judges: Sequence[Judge] = JUDGES) -> list[Limit]:
    return [Limit(f"{what}, {judge.name}", name, most, unit, judge) for judge in judges]


#: Largest push that the paper's robot can withstand with its traction, N·s.
_CAPTURE_IMPULSE = Scale.of(bb.Params.paper()).capture_impulse

SHIPPED = (
    Shipped(
        "Balance",
        Recipe("balance", "still"),
        _in_engines("episodes without success", "failures", 0.01, ""),
    ),
    Shipped(
        "Balance, from all tilts",
        Recipe("balance", "recover"),
        _in_engines("episodes without success, starts within 5 deg", "failures", 0.01, ""),
        {
            "S2-rest": ("tilt recovered from, worst of 24 directions", 28.5, "deg"),
            "S3-at-once": ("push withstood, worst of 24 directions", 2.0, "N·s"),
        },
    ),
    Shipped(
        "Velocity",
        Recipe("velocity"),
        [
            *_in_engines("settled error of the velocity", "velocity_error", 0.02, "m/s"),
            *_in_engines("settled error of the heading's rate", "yaw_rate_error", 0.05, "rad/s"),
            Limit(f"settled error of the velocity, {_REAL.name}", "velocity_error", 0.04, "m/s", _REAL),
        ],
    ),
    Shipped(
        "Goal",
        Recipe("goal"),
        [
            *_in_engines("time to a goal relative to the fastest flat move", "time_ratio", 1.5, ""),
            *_in_engines("goals not held", "missed_goals", 0.01, ""),
        ],
    ),
    Shipped(
        "Path",
        Recipe("path"),
        [
            *_in_engines("error across the path", "cross_track_error", 0.02, "m"),
            Limit(f"error across the path, {_FAST.name}", "cross_track_error", 0.02, "m", _FAST),
        ],
    ),
    Shipped(
        "Push",
        Recipe("push", "recover"),
        [],
        {"S3-at-once": ("push withstood, worst of 24 directions", 0.8 * _CAPTURE_IMPULSE, "N·s")},
    ),
    Shipped(
        "Carry",
        Recipe("carry"),
        [
            *_in_engines("time to a goal relative to the fastest flat move", "time_ratio", 1.5, ""),
            *_in_engines("episodes without success", "failures", 0.01, ""),
            *_in_engines("episodes in which water spills", "spilled", 0.01, ""),
        ],
        about="Robots move as without the glass, in all engines: its water follows from their motion. `lqr` is faster, "
        "and its water rises higher.",
    ),
    Shipped(
        "Ride",
        Recipe("ride", robot="validation/policies/own_robots/ride.toml"),
        [
            *_in_engines("distance from where the rider begins to brake", "braking_distance", 2.0, "m", _OURS),
            *_in_engines("time until the robot has stopped", "braking_time", 3.0, "s", _OURS),
            *_in_engines("episodes without success", "failures", 0.01, "", _OURS),
        ],
        judges=_OURS,
        about="The robot is [60 kg with its rider](../validation/policies/own_robots/ride.toml): name it by `--robot` "
        "for the laws. MuJoCo is left out: other engines move no rider. Effort is relative to the largest action, "
        "which is 25 N·m under a law and 8.1 N·m under the policy: both `lqr` and the policy use 1.35 N·m (rms). "
        "`lqr_pi` stops a little sooner, over a longer way.",
    ),
    Shipped(
        "Navigate",
        Recipe("navigate"),
        [
            *_in_engines("time to a goal relative to the fastest flat move", "time_ratio", 2.0, "", _OURS),
            *_in_engines("episodes without success", "failures", 0.01, "", _OURS),
            *_in_engines("collisions in an episode", "collisions", 0.01, "", _OURS),
        ],
        judges=(*_OURS, _FIELD),
        about="Laws track the motion of the task's [guide](obstacles.md#guides), which the policy observes: a control "
        "barrier function, as in the training, except under the judge that has the potential field. The field "
        "accelerates up to 0.8 m/s², the barrier function up to 0.43 m/s²: the policy has not met more, and often "
        "falls. MuJoCo is left out: it simulates no obstacles.",
    ),
)


def recipes() -> dict[str, list[Recipe]]:
    """All recipes to train, by topic."""
    return {one.name: [one.recipe._replace(seed=seed) for seed in SEEDS] for one in SHIPPED}


def topics(folder: "Path") -> list[Topic]:
    """One topic per policy, whose file is in `folder`."""
    return [_topic(one, folder) for one in SHIPPED]


def _topic(one: Shipped, folder: "Path") -> Topic:
    variant = "" if one.recipe.variant is None else f" --config {one.recipe.variant}"
    robot = "" if one.recipe.robot is None else f" --robot {one.recipe.robot}"
    text = (
        f"`assets/policies/{one.file}`: seed 0 of `ballbot train {one.recipe.task}{variant}{robot}`. The figure shows "
        "its training and the training of two more seeds."
    )
    taught = config.parse(config.default_text(one.recipe.task, one.recipe.variant), one.file).teacher
    if taught is not None:
        laws = " or ".join(f"`{law}`" for law in taught.laws)
        text += f" At step 0 the policy is already fitted to {laws}; PPO continues from there."
    if one.about:
        text += f" {one.about}"
    return Topic(one.name, one.title, text, lambda: _run(one, str(folder / one.file)))


def _run(one: Shipped, policy: str) -> Findings:
    task, controllers = one.recipe.task, {"policy": policy, **{f"`{law}`": law for law in LAWS}}
    others = {limit.judge.name: limit.judge for limit in one.limits if limit.judge not in one.judges}
    cells = {
        (judge.name, label): one.cell(source, judge)
        for judge in (*one.judges, *others.values())
        for label, source in controllers.items()
    }
    # The other seeds, under their training conditions.
    for recipe in (one.recipe._replace(seed=seed) for seed in SEEDS[1:]):
        cells[CONTACT.name, f"policy of seed {recipe.seed}"] = one.cell(str(recipe.folder), CONTACT)
    found = dict(zip(cells, results(list(cells.values())), strict=True))
    claims = [_claim(limit, found[limit.judge.name, "policy"]) for limit in one.limits]
    compared = []
    for scenario, (what, least, unit) in one.least.items():
        outcomes = bb.run_scenarios(list(controllers.values()), [scenario])
        scores = {label: outcome.score for label, outcome in zip(controllers, outcomes, strict=True)}
        # Shortfall relative to the requirement.
        shortfall = max(least - scores["policy"], 0.0)
        claims.append(Claim(f"{what}, missing", shortfall, 0.0, 1e-9, unit, absolute=True))
        compared.append(_score(f"{what}, {unit}", scores))
    if not compared:
        own = [limit for limit in one.limits if limit.judge is CONTACT]
        compared.append(_metric(own[0], {label: found[CONTACT.name, label] for label in controllers}))
    lines = [row(judge, label, result) for (judge, label), result in found.items()]
    return Findings(claims, lambda fig: _curves(fig, one), table(head(task), lines), compared=tuple(compared))


def _score(what: str, scores: Mapping[str, float]) -> Comparison:
    """The policy and the best law in a scenario, the more the better."""
    best = max((label for label in scores if label != "policy"), key=lambda label: scores[label])
    ours, theirs = scores["policy"], scores[best]
    better = "tie" if ours == theirs else "policy" if ours > theirs else "law"
    return Comparison(what, best, f"{theirs:.4g}", f"{ours:.4g}", better)


def _metric(limit: Limit, found: Mapping[str, bb.Result]) -> Comparison:
    """The policy and the best law in a task, the less the better; a tie if their intervals overlap."""
    best = min((label for label in found if label != "policy"), key=lambda label: measure(found[label], limit.name))
    ours, theirs = (interval(found[label], limit.name) for label in ("policy", best))
    better = "policy" if ours[1] < theirs[0] else "law" if theirs[1] < ours[0] else "tie"
    law, policy = (
        f"{measure(found[label], limit.name):.3g} ({low:.3g} … {high:.3g})"
        for label, (low, high) in ((best, theirs), ("policy", ours))
    )
    what = limit.what.removesuffix(f", {limit.judge.name}")
    return Comparison(f"{what}, {limit.unit}".removesuffix(", "), best, law, policy, better)


def _claim(limit: Limit, result: bb.Result) -> Claim:
    return Claim(limit.what, measure(result, limit.name), 0.0, limit.most, limit.unit, absolute=True)


def _curves(fig: "Figure", one: Shipped) -> None:
    from ballbot_rs.media.figures import learning_curve
    from ballbot_rs.training import curve

    learning_curve.draw_on(fig, [curve.read(one.recipe._replace(seed=seed).folder) for seed in SEEDS])
