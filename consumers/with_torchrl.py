"""TorchRL: `GymEnv` by id, and a collector that feeds PPO from the Gymnasium vector environment."""

import gymnasium
import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from consumers.common import ENV_ID, NUM_ENVS, ROLLOUT, Timer, finish


def _layers(inputs, outputs):
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(0)
    check_env_specs(GymEnv(ENV_ID))
    timer = Timer()
    # TorchRL rejects environments that are reset in a separate step.
    env = GymWrapper(gymnasium.make_vec(ENV_ID, NUM_ENVS, autoreset_mode="same_step"))
    net = nn.Sequential(_layers(16, 6), NormalParamExtractor())
    policy = ProbabilisticActor(
        TensorDictModule(net, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    value = ValueOperator(_layers(16, 1), in_keys=["observation"])
    advantage = GAE(gamma=0.98, lmbda=0.95, value_network=value, average_gae=True)
    loss = ClipPPOLoss(policy, value, entropy_coeff=0.0)
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    collector = Collector(env, policy, frames_per_batch=NUM_ENVS * ROLLOUT, total_frames=-1)
    steps = 0
    for batch in collector:
        steps += batch.numel()
        for _ in range(5):
            with torch.no_grad():
                advantage(batch)
            rows = batch.reshape(-1)
            for part in torch.randperm(len(rows)).split(1024):
                losses = loss(rows[part])
                optimizer.zero_grad()
                (losses["loss_objective"] + losses["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        if timer.is_over:
            break
    collector.shutdown()

    def act(observations):
        """The mean, squashed."""
        with torch.no_grad():
            return torch.tanh(net(torch.as_tensor(observations))[0]).numpy()

    finish(steps, timer, act)
