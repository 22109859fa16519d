"""PPO of skrl on the Gymnasium vector environment."""

import gymnasium
import numpy as np
import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from torch import nn

from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish


def _layers(inputs, outputs):
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


class Actor(GaussianMixin, Model):
    """Means of the torques, and one spread each."""

    def __init__(self, observation_space, action_space, device):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        GaussianMixin.__init__(self)
        self.net = _layers(self.num_observations, self.num_actions)
        self.log_std = nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs, role=""):  # noqa: ARG002
        """As skrl expects."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Critic(DeterministicMixin, Model):
    """The value of an observation."""

    def __init__(self, observation_space, action_space, device):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, device=device)
        DeterministicMixin.__init__(self)
        self.net = _layers(self.num_observations, 1)

    def compute(self, inputs, role=""):  # noqa: ARG002
        """As skrl expects."""
        return self.net(inputs["observations"]), {}


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    timer = Timer()
    # skrl learns from the observation that ends an episode only if the reset is a separate step.
    env = wrap_env(gymnasium.make_vec(ENV_ID, NUM_ENVS), verbose=False)
    models = {
        "policy": Actor(env.observation_space, env.action_space, env.device),
        "value": Critic(env.observation_space, env.action_space, env.device),
    }
    cfg = PPO_CFG(rollouts=ROLLOUT, learning_epochs=5, mini_batches=4, discount_factor=0.98, learning_rate=1e-3)
    cfg.experiment.write_interval = 0
    cfg.experiment.checkpoint_interval = 0
    agent = PPO(
        models=models,
        memory=RandomMemory(memory_size=ROLLOUT, num_envs=NUM_ENVS, device=env.device),
        observation_space=env.observation_space,
        action_space=env.action_space,
        device=env.device,
        cfg=cfg,
    )
    agent.init()
    agent.enable_training_mode(True)
    observations, _ = env.reset()
    step = 0
    while not timer.is_over:
        agent.pre_interaction(timestep=step, timesteps=10**9)
        with torch.no_grad():
            actions, _ = agent.act(observations, None, timestep=step, timesteps=10**9)
            following, rewards, terminated, truncated, infos = env.step(actions)
            agent.record_transition(
                observations=observations,
                states=None,
                actions=actions,
                rewards=rewards,
                next_observations=following,
                next_states=None,
                terminated=terminated,
                truncated=truncated,
                infos=infos,
                timestep=step,
                timesteps=10**9,
            )
        agent.post_interaction(timestep=step, timesteps=10**9)
        observations = following
        step += 1

    def act(observations):
        """The means."""
        with torch.no_grad():
            return models["policy"].net(torch.as_tensor(observations)).numpy()

    assert np.isfinite(act(np.zeros((1, 16), dtype=np.float32))).all()
    finish(step * NUM_ENVS, timer, act)
