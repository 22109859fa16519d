"""Policies that are symmetric exactly: their weights are tied so that a turned robot gets turned torques.

Hidden units come in sixes, a unit for each symmetry of `training.symmetry`; a symmetry exchanges the units of a six
(regular representation: Cohen and Welling, "Group equivariant convolutional networks", ICML 2016). The value of a state
is the same for all six.

An actor may be odd, too, as linear laws are: it has no biases, and the opposite observation gives reversed torques.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs._core import Batch
from ballbot_rs.control import sb3_recurrent
from ballbot_rs.envs.family import has_several_robots
from ballbot_rs.training import symmetry
from ballbot_rs.training.config import AUTO, TAUGHT
from ballbot_rs.training.symmetry import Matrix

#: Units that the symmetries exchange.
ORBIT: Final = 6

#: Largest difference between weights that are tied.
_ROUNDING: Final = 1e-4

#: Gates of an LSTM cell, each with its own rows of the weights.
_GATES: Final = 4


class Ties:
    """The ties between the weights of a policy's actor and value function.

    Args:
        model: of PPO, or of RecurrentPPO of sb3-contrib.
        pairs: of `symmetry.symmetries`.
        opposite: of `symmetry.opposite` if the actor is odd.

    Raises:
        ValueError: hidden units that are not in sixes, noise that depends on the state, or an odd actor with LSTM cells
            or an activation function other than tanh.
    """

    def __init__(
        self, model: BaseAlgorithm, pairs: list[tuple[Matrix, Matrix]], opposite: Matrix | None = None
    ) -> None:
        policy: Any = model.policy
        #: Parameters with how the symmetries change what they give, and what they are given unless it is a constant.
        self._tied: list[tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]] = []
        #: Of `symmetry.symmetries`.
        self.pairs = pairs
        self._exchanges = _exchanges([of_wheels for _, of_wheels in pairs])
        observations, actions = (_tensor(np.stack(matrices)) for matrices in zip(*pairs, strict=True))
        if policy.log_std.ndim != 1:
            raise ValueError("algorithm_arguments.use_sde = true: its noise depends on the state")
        if opposite is not None:
            _check_odd(model)
        acted = valued = observations
        actor = [*linear_layers(policy.mlp_extractor.policy_net), policy.action_net]
        critic = [*linear_layers(policy.mlp_extractor.value_net), policy.value_net]
        if sb3_recurrent.is_recurrent(model):
            acted = self._tie_cells(policy.lstm_actor, observations)
            if policy.lstm_critic is not None:
                valued = self._tie_cells(policy.lstm_critic, observations)
            elif policy.critic is not None:
                critic.insert(0, policy.critic)
            else:
                valued = acted
        self._tie_layers(actor, acted, actions, opposite)
        self._tie_layers(critic, valued, torch.ones(len(pairs), 1, 1))
        self._tied.append((policy.log_std, actions.abs(), None))

    def _tie_layers(
        self,
        layers: list[torch.nn.Linear],
        given: torch.Tensor,
        gives: torch.Tensor,
        opposite: Matrix | None = None,
    ) -> None:
        others = [*(self._space(layer.out_features) for layer in layers[:-1]), gives]
        if opposite is not None:
            # Each symmetry once more, combined with the opposite motion, which reverses all that layers give.
            given = torch.cat([given, given @ _tensor(opposite)])
            others = [torch.cat([space, -space]) for space in others]
        spaces = [given, *others]
        for layer, (before, after) in zip(layers, pairwise(spaces), strict=True):
            self._tied += [(layer.weight, after, before), (layer.bias, after, None)]

    def _tie_cells(self, lstm: torch.nn.LSTM, given: torch.Tensor) -> torch.Tensor:
        """Ties LSTM cells; returns how the symmetries change their outputs."""
        own = self._space(lstm.hidden_size)
        gates = torch.kron(torch.eye(_GATES), own)
        for layer in range(lstm.num_layers):
            for name, before in (("weight_ih", given if layer == 0 else own), ("weight_hh", own)):
                self._tied.append((getattr(lstm, f"{name}_l{layer}"), gates, before))
            self._tied += [(getattr(lstm, f"{name}_l{layer}"), gates, None) for name in ("bias_ih", "bias_hh")]
        return own

    def _space(self, width: int) -> torch.Tensor:
        """How the symmetries change the outputs of a hidden layer."""
        if width % ORBIT:
            raise ValueError(f"a hidden layer of {width} units: expected a multiple of {ORBIT}, such as {_near(width)}")
        return _tensor(np.stack([np.kron(np.eye(width // ORBIT), one) for one in self._exchanges]))

    @property
    def of_last_layer(self) -> list[tuple[Matrix, Matrix]]:
        """How each symmetry changes a six of hidden units, and actions, as the pairs of `symmetry.symmetries`."""
        return [(exchange, of_wheels) for exchange, (_, of_wheels) in zip(self._exchanges, self.pairs, strict=True)]

    @torch.no_grad()
    def begin(self) -> None:
        """Ties new weights, and keeps their size: the mean of independent weights is smaller."""
        self.hold()
        for parameter, _, given in self._tied:
            if given is not None:
                parameter.mul_(ORBIT**0.5)

    @torch.no_grad()
    def hold(self) -> None:
        """Ties the weights again: the mean of each parameter over the symmetries."""
        for parameter, gives, given in self._tied:
            turned = parameter @ gives if given is None else gives @ parameter @ given.mT
            # Opposites last: they cancel exactly.
            parameter.copy_(turned.reshape(-1, ORBIT, *parameter.shape).mean(dim=1).mean(dim=0))

    @torch.no_grad()
    def holds(self) -> bool:
        """Whether the weights are tied, but for rounding."""
        before = [parameter.clone() for parameter, _, _ in self._tied]
        self.hold()
        pairs = [(parameter, one) for (parameter, _, _), one in zip(self._tied, before, strict=True)]
        found = all(torch.allclose(parameter, one, rtol=0.0, atol=_ROUNDING) for parameter, one in pairs)
        for parameter, one in pairs:
            parameter.copy_(one)
        return found

    def hold_after(self, optimizer: torch.optim.Optimizer) -> None:
        """Ties the weights again after each of an optimizer's steps."""
        optimizer.register_step_post_hook(lambda *_: self.hold())


def _check_odd(model: BaseAlgorithm) -> None:
    policy: Any = model.policy
    if sb3_recurrent.is_recurrent(model):
        raise ValueError("LSTM cells are not odd")
    for layer in policy.mlp_extractor.policy_net:
        if not isinstance(layer, (torch.nn.Linear, torch.nn.Tanh)):
            raise ValueError(f"the activation function is {layer}, expected Tanh")


def tie(
    model: BaseAlgorithm,
    symmetric: bool | str,
    tell: Callable[[str], None],
    *,
    odd: bool = False,
    is_new: bool = True,
) -> Ties | None:
    """Ties the weights of a model, and holds them tied after each of its updates.

    Args:
        model: with new weights, or with the weights of a checkpoint.
        symmetric: whether to tie them; `AUTO` where the robots and the policy allow it.
        tell: called with the reason why `AUTO` does not tie them.
        odd: whether the actor is odd, too; only with `symmetric`.
        is_new: whether the weights are new; others must be tied already.

    Raises:
        ValueError: `symmetric` is true, and the robots, the rows of their observations or the policy are not, the actor
            cannot be odd, or the weights of the checkpoint are not tied.
    """
    if symmetric is False:
        return None
    environment = model.get_env()
    assert environment is not None
    try:
        if type(model).__name__ not in TAUGHT:
            raise ValueError(f"{type(model).__name__} has no symmetric policies, only {' and '.join(TAUGHT)}")
        unwrapped: Any = environment.unwrapped
        batch = unwrapped._batch
        _check_sides(batch)
        ties = Ties(model, symmetry.of_batch(batch), symmetry.opposite_of_batch(batch) if odd else None)
        if not is_new and not ties.holds():
            raise ValueError("the weights of the checkpoint are not tied")
    except ValueError as error:
        if symmetric == AUTO:
            tell(f"the policy is not symmetric: {error}")
            return None
        raise ValueError(f"symmetric = true{', odd = true' * odd}: {error}") from error
    if is_new:
        ties.begin()
    ties.hold_after(model.policy.optimizer)
    return ties


def _check_sides(batch: Batch) -> None:
    """Rejects one robot with a preferred side; several robots need none on average only."""
    robot = batch.nominal_params(0)
    if has_several_robots(batch):
        return
    strength = batch.actuators(0)["strength"]
    sides = {
        "its body or wheels differ between directions (Params.is_symmetric)": not robot.is_symmetric,
        f"floor_tilt = {robot.floor_tilt}": any(robot.floor_tilt),
        "its floor moves or has a gradient of friction": robot.on_still_floor() != robot,
        f"actuators.strength = {strength}": len(set(np.ravel(strength).tolist())) > 1,
    }
    if found := [side for side, is_there in sides.items() if is_there]:
        raise ValueError(f"the robot has a preferred side: {', '.join(found)}")


def _near(width: int) -> int:
    return max(round(width / ORBIT), 1) * ORBIT


def linear_layers(layers: torch.nn.Sequential) -> list[torch.nn.Linear]:
    """The linear layers of a network."""
    return [layer for layer in layers if isinstance(layer, torch.nn.Linear)]


def _tensor(matrices: Matrix) -> torch.Tensor:
    return torch.as_tensor(matrices, dtype=torch.float32)


def _exchanges(group: list[Matrix]) -> list[Matrix]:
    """The matrix by which each element of a group exchanges its elements, of rows."""
    found = []
    for first in group:
        products = [first @ second for second in group]
        found.append(np.array([[float(np.allclose(row, product)) for product in products] for row in group]))
    return found
