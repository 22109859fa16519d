"""A policy that follows the gradient of its robots' motion, through contact and slip; extra `train`.

16 robots move for 32 steps, and the policy changes along the gradient of their cost. What comes after 32 steps costs
what the linear model needs from there.
"""

import sys
import time

import numpy as np
import torch
from scipy.linalg import solve_discrete_are

import ballbot_rs as bb

ROBOTS, STEPS = 16, 32


def deviation(states):
    """Position, tilt, velocity and rates in the heading frame, shape (n, 9)."""
    w, x, y, z = states[:, 16:20].unbind(1)
    lean = 2.0 * torch.stack([x * z + w * y, y * z - w * x], 1)  # of the body's axis, inertial frame
    sine, cosine = 2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2)
    heading = torch.stack([cosine, sine], 1) / torch.hypot(sine, cosine)[:, None]

    def turned(v):
        cosine, sine = heading.unbind(1)
        return torch.stack([cosine * v[:, 0] + sine * v[:, 1], cosine * v[:, 1] - sine * v[:, 0]], 1)

    lean = turned(lean)
    tilt = torch.stack([-lean[:, 1], lean[:, 0]], 1)
    return torch.cat([turned(states[:, 0:2]), tilt, turned(states[:, 7:9]), states[:, 23:26]], 1)


class Policy(torch.nn.Module):
    """Also `bb.evaluate(Policy(limit))`: called with a `State`, it returns torques."""

    name, control_dt = "backpropagation", 0.01

    def __init__(self, limit):
        super().__init__()
        self.limit = limit
        self.scale = torch.tensor([5.0, 5.0, 10.0, 10.0, 3.0, 3.0, 1.0, 1.0, 1.0])
        self.layers = torch.nn.Sequential(torch.nn.Linear(9, 32), torch.nn.Tanh(), torch.nn.Linear(32, 3, bias=False))
        torch.nn.init.normal_(self.layers[2].weight, std=0.01)
        self.double()

    def forward(self, states):
        return self.limit * torch.tanh(self.layers(self.scale * deviation(states)))

    def __call__(self, state):
        if isinstance(state, torch.Tensor):
            return super().__call__(state)
        with torch.no_grad():
            return self.forward(torch.from_numpy(state.to_array()[None]))[0].numpy()


def train(iterations):
    """A policy after so many changes."""
    torch.manual_seed(0)
    robots = bb.DifferentiableBatch(bb.Batch(ROBOTS))
    limit = robots.batch.max_wheel_torque
    policy = Policy(limit)
    weights = np.diag([10.0, 10.0, 40.0, 40.0, 2.0, 2.0, 0.5, 0.5, 0.2])
    effort = 0.02 / limit**2
    a, b = bb.linearize(dt=robots.batch.control_dt)
    used = [0, 1, 2, 3, 5, 6, 7, 8, 9]  # without heading and spin of the ball
    after = torch.from_numpy(solve_discrete_are(a[np.ix_(used, used)], b[used], weights, effort * np.eye(3)))
    weights = torch.from_numpy(weights)
    optimizer = torch.optim.Adam(policy.parameters(), lr=3e-3)
    states = robots.reset()
    for iteration in range(iterations):
        states, loss, alive = states.detach(), 0.0, torch.ones(ROBOTS, dtype=bool)
        for _ in range(STEPS):
            torques = policy(states)
            states, ended = robots.step(states, torques)
            alive = alive & ~ended
            x = deviation(states)
            cost = torch.einsum("ni,ij,nj->n", x, weights, x) + effort * (torques**2).sum(1)
            loss = loss + cost[alive].clamp(max=50.0).sum() / (ROBOTS * STEPS)
        left = torch.einsum("ni,ij,nj->n", x, after, x)[alive]
        loss = loss + 20.0 * (left + 1.0).sqrt().sum() / (ROBOTS * STEPS)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        optimizer.step()
        if iteration % 20 == 19:
            print(f"{ROBOTS * STEPS * (iteration + 1):>7} steps: loss {loss.item():.3f}")
    return policy


if __name__ == "__main__":
    torch.set_num_threads(1)
    begin = time.perf_counter()
    policy = train(int(sys.argv[1]) if len(sys.argv) > 1 else 80)
    print(f"trained for {time.perf_counter() - begin:.0f} s")
    print(bb.evaluate(policy, episodes=100))
