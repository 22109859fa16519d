"""PPO in one file, as in CleanRL, on the Gymnasium vector environment; needs only PyTorch."""

import gymnasium
import torch
from torch import nn
from torch.distributions import Normal

from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish

GAMMA, LAMBDA, CLIP, EPOCHS, MINIBATCH, RATE = 0.98, 0.95, 0.2, 5, 1024, 1e-3


def layers(outputs, gain):
    """Two hidden layers."""
    net = nn.Sequential(nn.Linear(16, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))
    for layer in net[::2]:
        nn.init.orthogonal_(layer.weight, gain if layer is net[-1] else 2**0.5)
        nn.init.zeros_(layer.bias)
    return net


def advantages(rewards, values, following, dones):
    """Generalized advantage estimates; `following` has the values of the last observations of episodes, too."""
    found, running = torch.zeros_like(rewards), 0.0
    for i in reversed(range(len(rewards))):
        running = rewards[i] + GAMMA * following[i] - values[i] + GAMMA * LAMBDA * (1.0 - dones[i]) * running
        found[i] = running
    return found


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    timer = Timer()
    # Resets within the step: no step is lost, and `final_obs` has what a truncated episode is valued by.
    env = gymnasium.make_vec(ENV_ID, NUM_ENVS, autoreset_mode="same_step")
    actor, critic, log_std = layers(3, 0.01), layers(1, 1.0), nn.Parameter(torch.zeros(3))
    weights = [*actor.parameters(), *critic.parameters(), log_std]
    optimizer = torch.optim.Adam(weights, lr=RATE, eps=1e-5)
    rows = (ROLLOUT, NUM_ENVS)
    observed, acted = torch.zeros(*rows, 16), torch.zeros(*rows, 3)
    rewards, dones, following, chances = (torch.zeros(rows) for _ in range(4))
    observations = torch.as_tensor(env.reset(seed=0)[0])
    steps = 0
    while not timer.is_over:
        with torch.no_grad():
            for i in range(ROLLOUT):
                policy = Normal(actor(observations), log_std.exp())
                actions = policy.sample()
                observed[i], acted[i], chances[i] = observations, actions, policy.log_prob(actions).sum(1)
                found, reward, terminated, truncated, infos = env.step(actions.clamp(-1.0, 1.0).numpy())
                observations = torch.as_tensor(found)
                last = observations.clone()
                if "final_obs" in infos:
                    ended = torch.as_tensor(infos["_final_obs"])
                    last[ended] = torch.as_tensor(infos["final_obs"])[ended]
                following[i] = critic(last)[:, 0] * torch.as_tensor(~terminated)
                rewards[i] = torch.as_tensor(reward)
                dones[i] = torch.as_tensor(terminated | truncated)
            values = critic(observed)[..., 0]
            gains = advantages(rewards, values, following, dones)
            returns = (gains + values).reshape(-1)
            gains = gains.reshape(-1)
        optimizer.param_groups[0]["lr"] = RATE * timer.left
        flat = [part.reshape(-1, *part.shape[2:]) for part in (observed, acted, chances)]
        for _ in range(EPOCHS):
            for part in torch.randperm(len(gains)).split(MINIBATCH):
                seen, taken, before = (array[part] for array in flat)
                policy = Normal(actor(seen), log_std.exp())
                ratio = (policy.log_prob(taken).sum(1) - before).exp()
                gain = (gains[part] - gains[part].mean()) / (gains[part].std() + 1e-8)
                loss = -torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
                loss = loss + 0.5 * (critic(seen)[:, 0] - returns[part]).square().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(weights, 0.5)
                optimizer.step()
        steps += ROLLOUT * NUM_ENVS

    def act(observations):
        """The means."""
        with torch.no_grad():
            return actor(torch.as_tensor(observations)).numpy()

    finish(steps, timer, act)
