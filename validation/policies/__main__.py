"""Trains the policies that come with the package, and writes docs/policies.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence
from pathlib import Path

from validation import page
from validation.page import Chapter
from validation.policies import shipped
from validation.policies.training import train_all
from validation.topic import Findings, Topic

FOLDER = Path(__file__).parents[2] / "assets" / "policies"

_HEAD = """# Policies

Of each task a policy comes with the package, `assets/policies/TASK.onnx`; every command takes it:

```sh
ballbot view --controller assets/policies/velocity.onnx
ballbot evaluate --controller assets/policies/path.onnx --controller lqr --episodes 200 --engine mujoco
```

Everything below, text apart, is made by `make policies`, which trains three seeds a policy with the configurations in
`python/ballbot_rs/training/configs/`, ships that of seed 0, and fails if a claim does not hold. The bank of starts and
commands of an evaluation is that of the seeds from 1000 on, 200 episodes (50 in MuJoCo), which are not among those of
trainings. Policies are trained on `contact`; `rigid` is the same robot in rapier, MuJoCo a model of the same parameters
in another engine, with the contact frames turned as [verification](verification.md) does it. The limits of the claims
were set before the policies were trained. In brackets: 95 % intervals, Wilson's of shares, by bootstrap over episodes
of means. Metrics are means over the episodes that ran to their end.
"""


def main() -> int:
    """The command `python -m validation.policies`."""
    train_all(shipped.recipes())
    _export()
    return page.write(
        "policies", "validation.policies", __doc__, [Chapter("The policies", "", shipped.topics(FOLDER))], _head
    )


def _export() -> None:
    """Ships the policies of the first seed."""
    from ballbot_rs.training.export import export

    for one in shipped.SHIPPED:
        export(one.recipe.folder, FOLDER / one.file, one.recipe.task)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return f"{_HEAD}\n{page.contents('policy', found)}"


if __name__ == "__main__":
    sys.exit(main())
