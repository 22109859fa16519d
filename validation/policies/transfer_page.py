"""Trains policies with and without random robots, and writes docs/transfer.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.page import Chapter
from validation.policies import transfer
from validation.policies.training import train_all
from validation.topic import Findings, Topic

_HEAD = """# Transfer

How policies perform on robots and in simulators on which they were not trained. `make transfer` trains and judges the
policies, writes everything below except the text, and fails if a claim does not hold.

Judges: `contact` is the simulator of the training; `rigid` is the same robot in rapier, MuJoCo a model of the same
parameters in another engine, with the contact frames turned as in [verification](verification.md). *Sensors* are
Kugle's sensors with the estimator; *delay* is a delay of the torques. The others change the robot without informing the
policies or LQR. 100 episodes each (20 in MuJoCo), with the starts and commands of seeds 1000 and up, the same for all;
in brackets 95 % intervals. Metrics are means over the episodes that ran to completion. The limits were set before the
first run; the judges' random robots differ from the training's.

Under `mild` and `hard` the success of a balancing episode is not a measure of the controller: no controller succeeds
after a push in the last 2 s. [Randomization](randomization.md#sets) has survival and the time to recover.
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
