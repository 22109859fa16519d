r"""Delay of the motors.

A command acts $d$ later (`actuators={"delay": d}`): $u(t - d)$. The sampled loop of LQR is linear in the states of the
linear model and the delayed commands. Its largest eigenvalue passes 1 between 56 and 58 ms. Falls from the starts of
the task occur earlier, because large tilts need torques beyond the limit. The policy has a higher gain: with more than
12 ms of delay, its wheels oscillate, and at 50 ms the robot stays up but oscillates by more than 1°.
"""

import numpy as np

from validation.robots.linear_effect import LinearEffect
from validation.robots.loop import SIM_DT
from validation.robots.sweep import Sweep

EFFECT = LinearEffect(
    Sweep(
        "delay (ms)",
        (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0),
        # A whole number of model steps.
        lambda ms: {"actuators": {"delay": SIM_DT * round(1e-3 * ms / SIM_DT)}},
        2.0,
        "--set actuators.delay=0.01",
    ),
    "delay {:g} ms",
    (58.0, 64.0, 70.0),
    lambda ms: {"delay": 1e-3 * ms},
    np.arange(0.0, 71.0, 2.0).tolist(),
)
claims, run = EFFECT.claims, EFFECT.run
