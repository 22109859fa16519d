r"""Lag of the motors.

The torque follows its command with the time constant $T$ (`actuators={"lag": T}`), in each model step $h$ by

$$\tau \leftarrow \tau + (1 - e^{-h/T})(\tau_{cmd} - \tau).$$

With the three lagging torques among its states the loop of LQR stays linear. Its largest eigenvalue passes 1 at 102 ms.
"""

import numpy as np

from validation.robots.linear_effect import LinearEffect
from validation.robots.sweep import Sweep

EFFECT = LinearEffect(
    Sweep(
        "lag (ms)",
        (0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0),
        lambda ms: {"actuators": {"lag": 1e-3 * ms}},
        1.0,
        "--set actuators.lag=0.02",
    ),
    "lag {:g} ms",
    (105.0, 112.0, 120.0),
    lambda ms: {"lag": 1e-3 * ms},
    np.linspace(0.0, 120.0, 61).tolist(),
)
claims, run = EFFECT.claims, EFFECT.run
