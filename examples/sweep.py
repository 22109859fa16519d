"""Which friction and delay, unknown to them, do controllers survive? Interrupt it, start it again: it continues."""

import sys

import ballbot_rs as bb

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100

study = bb.compare(
    ["lqr", "pid"],
    episodes=episodes,
    sweep={
        "events.wheel_dynamic_friction": [0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5],
        "actuators.delay": [0.0, 0.02, 0.04],
    },
    checkpoint=f"sweep-{episodes}.json",
    progress=lambda done, total: print(f"\r{done} of {total} points", end="", file=sys.stderr),
)
print(study)
for row in study.table("survival_rate"):
    print("  ".join(f"{cell:>29}" if i == 0 else f"{cell:>15}" for i, cell in enumerate(row)))
study.plot("survival_rate", "sweep.svg")
study.to_csv("sweep.csv")
