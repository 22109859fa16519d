"""A dataset of episodes of LQR from random starts, for behavior cloning or offline learning: one NumPy file."""

import sys

import ballbot_rs as bb

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 1000

data = bb.record_dataset("lqr", episodes=episodes, noise=0.05, events="mild")
print(data)
# data.to_minari("ballbot/balance-lqr-v0") instead, with the extra `minari`
data.to_npz("dataset.npz")
third = slice(data.starts[2], data.starts[3])
for name in ("observations", "actions", "rewards", "terminations"):
    array = getattr(data, name)
    print(f"{name:<13} {array.shape} {array.dtype}, of the third episode {array[third].shape}")
