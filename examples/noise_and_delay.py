"""Noisy sensors and delayed motors: the delay that LQR tolerates."""

import sys

import ballbot_rs as bb

delays = [float(text) / 1000 for text in sys.argv[1:]] or [0.0, 0.02, 0.04, 0.06, 0.08]  # ms in the command

for delay in delays:
    row = [f"delay {1000 * delay:3.0f} ms"]
    for sensors in (None, "kugle"):
        run = bb.simulate(
            "lqr",
            tilt=(0.05, 0.0),
            actuators={"delay": delay},
            sensors=sensors,
            observation=sensors and "sensors",
            seconds=6.0,
        )
        ending = "upright" if run.fell_at is None else f"fell at {run.fell_at:.2f} s"
        row.append(f"{sensors or 'exact'}: {ending}, tilt rms {run.metrics().tilt_rms:.4f} rad")
    print("  ".join(row))
