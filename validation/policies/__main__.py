"""Trains the policies that come with the package, and writes docs/policies.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence
from pathlib import Path

from validation import page
from validation.page import Chapter
from validation.policies import any_robot, robots, shipped, slippery
from validation.policies.training import train_all
from validation.topic import Findings, Topic

FOLDER = Path(__file__).parents[2] / "assets" / "policies"

_HEAD = """# Policies

The package has a policy for each of these tasks, `assets/policies/TASK.onnx`; every command accepts it:

```sh
ballbot view --controller assets/policies/velocity.onnx
ballbot evaluate --controller assets/policies/path.onnx --controller lqr --episodes 200 --engine mujoco
```

A [classical controller](controllers.md) needs no training and is the better choice where the table lists the law as
better: a policy is worth choosing only if it does better than tie. `ballbot train TASK --robot ROBOT` trains a policy
for [any task on any robot](#all-tasks-on-all-robots), and [one policy](#one-policy-for-any-robot) balances any robot.

{better}

`OnnxPolicy(file).controller(robot)` wraps a policy as a [controller](controllers.md): in Rust, for one robot or for all
robots of a `Batch`, and following setpoints. A policy of `balance` or `push` observes the robot in the frame of the
setpoint's motion, and its torques are added to the feedforward torques of the motion, computed for the given robot.
Where the setpoint turns, a PD law of the heading is added, and the policy, which only balances, sees no turn. Policies
of `goal` follow a position, and policies of `velocity` a velocity. This needs the extra `export`. If a task is given,
`evaluate`, `simulate`, `record`, `plot` and `view` use an ONNX policy of another task in this way:

```python
import ballbot_rs as bb

law = bb.OnnxPolicy("assets/policies/balance-any.onnx").controller("kugle")
circle = bb.Reference.circle(radius=0.5, period=12.0, robot="kugle")
print(bb.simulate(law, robot="kugle", seconds=12.0, reference=circle).metrics().position_error_rms)
```

<!-- scene: controller=balance-any&robot=kugle&course=circle -->

Driven this way with velocity commands of up to 0.5 m/s, `balance-any` stays upright in 50 of 50 episodes on each
preset. Its settled errors, with exact observations, are 0.2 cm/s (paper), 1.9 (asroballet), 1.7 (kugle) and 0.7
(rezero) without turns, and 0.6, 1.9, 1.8 and 0.8 with the turns of the task, up to 1 rad/s on kugle and 0.4 on rezero.
Kugle's ball spins at 30 rad/s under the body that turns. On a circle of 0.5 m in 12 s it falls from none of 24 starts
on any preset. The policy `velocity` and the laws are the better choice for commands that turn.

```sh
ballbot evaluate velocity --controller assets/policies/balance-any.onnx --robot kugle --episodes 50 --set speed=0.5
```

`make policies` trains three seeds per policy with the configurations in `python/ballbot_rs/training/configs/`, ships
the policy of seed 0 (for any robot, of seed 3), writes everything on this page except the text, and fails if a claim
does not hold. An evaluation has 200 episodes (50 in MuJoCo), with starts and commands from seeds 1000 and up, which are
never used in training. Policies are trained on `contact`; `rigid` is the same robot in rapier; MuJoCo is a model with
the same parameters in another engine, with the contact frames turned as in [verification](verification.md). The limits
of the claims were set before the policies were trained. In brackets: 95 % intervals, Wilson's for fractions, and for
means a bootstrap over episodes. Metrics are means over the episodes that ran to completion. """


def main() -> int:
    """The command `python -m validation.policies`."""
    chapters = [
        Chapter("The policies", "", shipped.topics(FOLDER)),
        Chapter("Any robot", "", [any_robot.topic(FOLDER), robots.topic()]),
        Chapter("Where learning wins", "", [slippery.topic()]),
    ]
    topics = [topic for chapter in chapters for topic in chapter.topics]
    chosen = page.arguments("validation.policies", __doc__, topics).topics or [topic.name for topic in topics]
    recipes = {**shipped.recipes(), "any": [any_robot.RECIPE], "robots": robots.recipes()}
    recipes["slippery"] = slippery.recipes()
    train_all([recipe for name in chosen for recipe in recipes[name]])
    _export(chosen)
    return page.write("policies", "validation.policies", __doc__, chapters, _head)


def _export(chosen: Sequence[str]) -> None:
    """Ships the policies of the first seed of the topics with these names."""
    from ballbot_rs.training.export import export

    files = {one.name: (one.recipe, one.file) for one in shipped.SHIPPED} | {"any": (any_robot.RECIPE, any_robot.FILE)}
    for recipe, file in (files[name] for name in chosen if name in files):
        export(recipe.folder, FOLDER / file, recipe.task)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    lines = [
        [f"[{topic.title}](#{page.anchor(topic.title)})", one.what, one.ours, f"{one.where}: {one.printed}", one.why]
        for topic, findings in found
        for one in findings.compared
    ]
    better = page.table(["policy", "measure, `contact`", "policy", "best law", "better"], lines)
    return f"{_HEAD.format(better=better)}\n{page.contents('policy', found)}"


if __name__ == "__main__":
    sys.exit(main())
