"""Three controllers follow a circle at increasing speed: the ball's position error in mm, or why it is rejected."""

import sys

import numpy as np

import ballbot_rs as bb

periods = [float(text) for text in sys.argv[1:]] or [10.0, 6.0, 4.0, 2.0]  # s, for a radius of 0.5 m

print("period (s)  share of the friction limit  lqr   lqi   cascade_pid")
for period in periods:
    try:
        circle = bb.Reference.circle(0.5, period)
    except ValueError as error:
        print(f"{period:10g}  {error}")
        continue
    errors = []
    for controller in ("lqr", "lqi", "cascade_pid"):
        run = bb.simulate(controller, reference=circle, seconds=3 * period)
        away = run.of_states("ball_position")[:, :2] - run.setpoints["position"]
        on_speed = run.times > period
        errors.append(1e3 * np.sqrt((away[on_speed] ** 2).sum(axis=1).mean()))
    print(f"{period:10g}  {circle.demand:27.0%}  " + "  ".join(f"{error:4.2f}" for error in errors))
