"""Increasingly steep hills: how often controllers stay upright, and a picture of a robot on them."""

import sys

import ballbot_rs as bb

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 50

limits = bb.Params.paper().slope_limits(0.5)
print("steepest slope on which the robot can stand:", {name: round(limit, 3) for name, limit in limits.items()}, "rad")
for slope in (0.0, 0.1, 0.15, 0.2):  # rad
    hills = bb.Terrain.generate("noise", seed=3, slope=slope)
    results = bb.compare(["lqr", "lqi"], episodes=episodes, terrain=hills)
    cells = [f"{one.controller} upright {one.survival_rate:4.0%}, {one.ball_rms:.3f} m off" for one in results]
    print(f"slope {slope:.2f}   " + "   ".join(cells))
run = bb.simulate("lqi", seconds=5.0, terrain=hills)
print(run)
run.plot("hills.svg")
