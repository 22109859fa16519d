"""Push a robot under LQR, print how far it leaned and rolled, and plot the trajectory."""

import sys

import ballbot_rs as bb

impulse = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0  # N·s

run = bb.simulate("lqr", pushes=[bb.Push((impulse, 0.0, 0.0), time=1.0)], seconds=4.0)
print(run)
for name, value in vars(run.metrics()).items():
    print(f"{name:<26} {value:.4f}")
run.plot("push.svg")
run.to_csv("push.csv")
