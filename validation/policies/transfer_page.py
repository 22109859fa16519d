"""Trains policies with and without random robots, and writes docs/transfer.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.page import Chapter
from validation.policies import transfer
from validation.policies.training import train_all
from validation.topic import Findings, Topic

_HEAD = """# Transfer

What policies do on robots and in simulators that they were not trained in. Everything below, text apart, is made by
`make transfer`, which trains the policies, judges them, and fails if a claim does not hold.

Judges: `contact` is the simulator of the training; `rigid` is the same robot in rapier, MuJoCo a model of the same
parameters in another engine, with the contact frames turned as [verification](verification.md) does it. *Sensors* are
those of Kugle with the estimator, *delay* is of the torques. The others change the robot, of which policies and LQR
have not been told. 100 episodes each (20 in MuJoCo), the starts and commands of the seeds from 1000 on, the same for
all; in brackets 95 % intervals. Metrics are of the episodes that ran to their end. The limits were set before the first
run; random robots of the judges are none of those of the training.

Under `mild` and `hard` an episode of balancing without success says little of the controller: a push in the last 2 s
denies it to any. [Randomization](randomization.md#sets) has survival and the time to recover.
"""


def main() -> int:
    """The command `python -m validation.policies.transfer_page`."""
    train_all(transfer.recipes())
    chapters = [Chapter("Tasks", transfer.__doc__ or "", transfer.topics())]
    return page.write("transfer", "validation.policies.transfer_page", __doc__, chapters, _head)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return f"{_HEAD}\n{page.contents('task', found)}"


if __name__ == "__main__":
    sys.exit(main())
