"""A custom live curve on the page: the mechanical power of the motors of a robot that is pushed."""

import sys
from collections import deque

import numpy as np
from viser import uplot

import ballbot_rs as bb

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
PERIOD, SPAN = 0.05, 200  # s, samples

with bb.show("lqr") as page:
    print(f"a curve at {page.url}")
    series = (uplot.Series(label="time (s)"), uplot.Series(label="power (W)", stroke="#1f6fb4", width=1.5))
    with page.add_tab("Power"):
        chart = page.gui.add_uplot((np.zeros(2), np.zeros(2)), series, scales={"x": {"time": False}}, aspect=2.0)
        impulse = page.gui.add_slider("Push (N·s)", min=0.0, max=0.5, step=0.05, initial_value=0.3)
    samples = deque(maxlen=SPAN)
    next_push = 1.0
    while page.time < seconds:
        if page.time > next_push:
            page.push((impulse.value, 0.0))
            next_push += 4.0
        samples.append((page.time, page.torques[0] @ page.state.wheel_speeds))
        chart.data = tuple(np.array(samples).T)
        page.wait(PERIOD)
    print(f"largest power {max(power for _, power in samples):.2f} W")
