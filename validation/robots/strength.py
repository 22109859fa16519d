r"""Weak motors.

Each motor gives the fraction $s$ of the commanded torque (`actuators={"strength": s}`, or a number per motor). The gain
of the loop is then $sK$: with three weak motors the largest eigenvalue of LQR's loop passes 1 at $s = 0.36$. Falls from
large tilts occur earlier, because the largest torque is smaller, too.
"""

import numpy as np

from validation.robots.linear_effect import LinearEffect
from validation.robots.sweep import Sweep

EFFECT = LinearEffect(
    Sweep(
        "strength of the motors",
        (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2),
        lambda share: {"actuators": {"strength": share}},
        0.005,
        "--set actuators.strength=0.9",
    ),
    "strength {:g}",
    (0.3, 0.25, 0.2),
    lambda share: {"strength": share},
    np.linspace(1.0, 0.2, 81).tolist(),
)
claims, run = EFFECT.claims, EFFECT.run
