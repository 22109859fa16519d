"""A policy that follows the gradient of what its robots cost in 32 steps; then the linear model prices the rest."""

import sys
import time

import numpy as np
import torch
from scipy.linalg import solve_discrete_are

import ballbot_rs as bb

torch.manual_seed(0)
robots = bb.DifferentiableBatch(bb.Batch(16))
limit = robots.batch.max_wheel_torque
weights, effort = np.diag([10.0, 10.0, 40.0, 40.0, 2.0, 2.0, 0.5, 0.5, 0.2]), 0.02 / limit**2
(a, b), used = bb.linearize(), [0, 1, 2, 3, 5, 6, 7, 8, 9]  # without heading and spin of the ball
rest = torch.tensor(solve_discrete_are(a[np.ix_(used, used)], b[used], weights, effort * np.eye(3)))
weights, scale = torch.tensor(weights), torch.tensor([5.0, 5.0, 10.0, 10.0, 3.0, 3.0, 1.0, 1.0, 1.0])
layers = torch.nn.Sequential(torch.nn.Linear(9, 32), torch.nn.Tanh(), torch.nn.Linear(32, 3, bias=False)).double()
torch.nn.init.normal_(layers[2].weight, std=0.01)
policy = lambda x: limit * torch.tanh(layers(scale * x))  # noqa: E731
optimizer, states, begin = torch.optim.Adam(layers.parameters(), lr=3e-3), robots.reset(), time.perf_counter()
for _ in range(int(sys.argv[1]) if len(sys.argv) > 1 else 80):
    states, cost, alive = states.detach(), 0.0, torch.ones(16, dtype=bool)
    for _ in range(32):
        torques = policy(robots.deviations(states))
        states, ended = robots.step(states, torques)
        x, alive = robots.deviations(states), alive & ~ended
        now = ((x @ weights) * x).sum(1) + effort * (torques**2).sum(1)
        cost = cost + now[alive].clamp(max=50.0).sum() / 512
    cost = cost + 20.0 * (((x @ rest) * x).sum(1) + 1.0)[alive].sqrt().sum() / 512
    optimizer.zero_grad()
    cost.backward()
    torch.nn.utils.clip_grad_norm_(layers.parameters(), 1.0)
    optimizer.step()
print(f"trained for {time.perf_counter() - begin:.1f} s, cost {cost.item():.3f}")
law = lambda state: policy(robots.deviations(torch.tensor(state.to_array()[None])))[0].detach().numpy()  # noqa: E731
print(bb.evaluate(law, episodes=100))
