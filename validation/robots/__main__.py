"""Changes the robot and its motors more and more and writes docs/robots.md; fails if a claim does not hold."""

import sys
from collections.abc import Sequence

from validation import page
from validation.page import Chapter
from validation.robots import BODY, MOTORS
from validation.topic import Findings, Topic

_HEAD = """# Off-nominal robots

What a real robot has and the nominal robot lacks: each effect with its closed-form solution, and its consequences for
controllers that were designed without it. `make robots` writes everything on this page except the text, and fails if a
claim does not hold.

Each row of a table summarizes 100 episodes of the [balance task](tasks/balance.md): model `contact`, the paper's robot,
the starts of `ballbot evaluate`. LQR (100 Hz) and the policy that comes with the package are designed for the nominal
robot with ideal motors; "LQR made for it" is designed for the changed robot. *Success* is defined by the task: at the
end the ball is within 0.1 m and the tilt within 1°. *Upright* is the fraction of episodes without a fall. *Position
rms* is the distance of the ball from the setpoint over all steps up to the fall, `ball_rms` of `ballbot evaluate
--json`. LQR also turns the robot to the commanded heading, from up to 180° away, which takes torque and wheel speed;
the policy leaves the heading alone. Each figure shows the closed-form solution (lines) with the simulation (dots), the
fraction of upright robots, and the position rms.

`ballbot view` has sliders for most of these effects. Parameters are in [conventions](conventions.md#parameters),
motors in [actuators](actuators.md), random robots in [randomization](randomization.md).
"""


def main() -> int:
    """The command `python -m validation.robots`."""
    chapters = [Chapter("The body, the wheels and the floor", "", BODY), Chapter("The motors", "", MOTORS)]
    return page.write("robots", "validation.robots", __doc__, chapters, _head)


def _head(found: Sequence[tuple[Topic, Findings]]) -> str:
    return f"{_HEAD}\n{page.contents('effect', found)}"


if __name__ == "__main__":
    sys.exit(main())
