"""A dataset of episodes of LQR from random starts, for behavior cloning or offline learning: one NumPy file."""

import sys
import time

import numpy as np

import ballbot_rs as bb

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
steps = 1000

batch = bb.Batch(episodes, "balance", autoreset="disabled", seed=0, events="mild")
batch.reset()
began = time.perf_counter()
rows = batch.rollout(bb.Lqr(), steps, record=("observations", "actions", "rewards", "terminated"))
print(f"{episodes * steps / (time.perf_counter() - began):.3g} steps a second")
# Axes in the order of an episode: episode, time, number.
dataset = {name: np.swapaxes(array, 0, 1) for name, array in rows.items()}
np.savez("dataset.npz", **dataset)
for name, array in dataset.items():
    print(f"{name:<13} {array.shape} {array.dtype}")
