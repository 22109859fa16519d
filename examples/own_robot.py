"""A robot from two URDFs: its disturbance limits, a push it recovers from, and its parameters as a TOML file."""

import sys
from pathlib import Path

import numpy as np

import ballbot_rs as bb

assets = Path(__file__).parents[1] / "assets"
bot, ball = sys.argv[1:3] if len(sys.argv) > 2 else (assets / "bot.urdf", assets / "ball.urdf")

params = bb.Params.from_urdf(bot, ball)
print(f"a small tilt grows by e in {1 / max(np.linalg.eigvals(bb.LinearModel(params).A).real):.3f} s")
for limit, slope in params.slope_limits(0.35).items():
    print(f"steepest slope, {limit}: {np.degrees(slope):.1f} deg")
print(f"steepest lean that traction can hold: {np.degrees(bb.Scale.of(params).holdable_lean):.1f} deg")
run = bb.simulate("lqr", robot=params, pushes=[bb.Push((0.5, 0.0, 0.0))], seconds=6.0)
print(run, f"tilt up to {np.degrees(run.metrics().tilt_max):.1f} deg")
Path("robot.toml").write_text(params.to_toml(), encoding="utf-8")  # for --robot of each command
