"""The fit of a recurrent policy to a law, over sequences.

As in `training.teacher` the law labels the states that the policy visits. What a recurrent policy chooses depends on
all steps of an episode, so a robot's steps stay in order, cut into windows. The fit differentiates within a window
(truncated backpropagation through time: Williams and Peng, "An efficient gradient-based algorithm for on-line training
of recurrent network trajectories", Neural Computation 2, 1990). The state in which a window begins comes from a pass of
the present network over all steps before it, once per epoch. Where an episode begins the state is zero.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs.training.config import Teacher
from ballbot_rs.training.teacher_errors import Labels, epochs_of, mean_square, set_rate
from ballbot_rs.training.teacher_rounds import Floats, Round, rounds

#: Largest norm of a gradient.
MAX_GRADIENT = 1.0

#: Outputs and cell states of the LSTM layers, each of shape (layers, n, units).
State = tuple[torch.Tensor, torch.Tensor]


@dataclasses.dataclass(frozen=True)
class Window:
    """Consecutive steps of all robots."""

    #: Shape (n, steps, rows).
    observations: torch.Tensor
    #: The law's actions, shape (n, steps, 3).
    labels: torch.Tensor
    #: Whether an episode begins with the first step, shape (n,).
    begins: torch.Tensor
    #: Factors of the errors, shape (n, steps).
    factors: torch.Tensor
    #: 1 where an episode begins with a later step, shape (n, steps).
    starts: torch.Tensor


def fit_actor(
    model: BaseAlgorithm,
    teacher: Teacher,
    rng: np.random.Generator,
    label: Callable[[], Labels],
    optimizer: torch.optim.Optimizer,
) -> list[float]:
    """Fits the most likely actions of a recurrent policy.

    Args:
        model: of `RecurrentPPO`.
        teacher: the settings.
        rng: for the choice of robots that the law drives, and for the noise.
        label: gives the law's actions in the present states.
        optimizer: of what is fitted.

    Returns:
        The root mean square error of each round, over all states so far.
    """
    environment = model.get_env()
    assert environment is not None
    windows: list[Window] = []
    errors = []
    state = _zeros(model, environment.num_envs)

    def act(observations: Floats, begins: npt.NDArray[np.bool_]) -> Floats:
        nonlocal state
        with torch.no_grad():
            given = torch.as_tensor(observations), state, torch.as_tensor(begins, dtype=torch.float32)
            distribution, state = _policy_of(model).get_distribution(*given)
            own: Floats = distribution.mode().numpy()
        return own

    for done, found in enumerate(rounds(environment, act, label, teacher, rng)):
        windows += _cut(found, teacher.window)
        for epoch in range(epochs_of(teacher, done)):
            set_rate(optimizer, teacher, done, epoch)
            error = _epoch(model, optimizer, windows, teacher)
        errors.append(error)
    return errors


def _zeros(model: BaseAlgorithm, n: int) -> State:
    lstm: Any = model.policy.lstm_actor
    zeros = torch.zeros(lstm.num_layers, n, lstm.hidden_size)
    return zeros, zeros


def _cut(found: Round, length: int) -> list[Window]:
    """The steps of a round as windows of at most `length`."""
    windows = []
    for first in range(0, len(found.starts), length):
        observations, labels, factors, starts = (
            torch.as_tensor(np.ascontiguousarray(rows[first : first + length].swapaxes(0, 1)))
            for rows in (found.observations, found.labels, found.factors, found.starts)
        )
        later = starts.float()
        later[:, 0] = 0.0
        windows.append(Window(observations, labels, starts[:, 0], factors, later))
    return windows


def states_before(model: BaseAlgorithm, windows: list[Window]) -> list[State]:
    """The states of all robots where each window begins, by the present network."""
    policy = _policy_of(model)
    state = _zeros(model, len(windows[0].begins))
    states = []
    with torch.no_grad():
        for one in windows:
            goes_on = (~one.begins).float()[:, None]
            state = state[0] * goes_on, state[1] * goes_on
            states.append(state)
            features = policy.extract_features(one.observations.flatten(0, 1), policy.pi_features_extractor)
            _, state = policy._process_sequence(features, state, one.starts.flatten(), policy.lstm_actor)
    return states


def _epoch(
    model: BaseAlgorithm,
    optimizer: torch.optim.Optimizer,
    windows: list[Window],
    teacher: Teacher,
) -> float:
    """An epoch of least squares of weighted errors; returns their root mean square."""
    states = states_before(model, windows)
    batches: list[tuple[Any, ...]] = []
    for length in sorted({one.starts.shape[1] for one in windows}):
        of_length = [k for k, one in enumerate(windows) if one.starts.shape[1] == length]
        observations, labels, factors, starts = (
            torch.cat([getattr(windows[k], name) for k in of_length])
            for name in ("observations", "labels", "factors", "starts")
        )
        before = [torch.cat([states[k][part] for k in of_length], dim=1) for part in range(2)]
        has_starts = starts.any(dim=1)
        # The library steps through a batch one by one if an episode begins in it, so these are together.
        for group in (torch.nonzero(~has_starts).flatten(), torch.nonzero(has_starts).flatten()):
            if len(group):
                shuffled = group[torch.randperm(len(group))]
                parts = torch.split(shuffled, max(teacher.batch_size // length, 1))
                batches.extend((observations, labels, starts, before, factors, chosen) for chosen in parts)
    total, count = 0.0, 0
    for i in torch.randperm(len(batches)).tolist():
        observations, labels, starts, before, factors, chosen = batches[i]
        state = before[0][:, chosen], before[1][:, chosen]
        distribution, _ = _policy_of(model).get_distribution(
            observations[chosen].flatten(0, 1), state, starts[chosen].flatten()
        )
        expected = labels[chosen]
        found = distribution.mode().reshape(expected.shape)
        loss = mean_square(found, expected, factors[chosen][:, :, None], teacher)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for fitted in optimizer.param_groups:
            torch.nn.utils.clip_grad_norm_(fitted["params"], MAX_GRADIENT)
        optimizer.step()
        total += loss.item() * len(chosen) * expected.shape[1]
        count += len(chosen) * expected.shape[1]
    return float(np.sqrt(total / count))


def _policy_of(model: BaseAlgorithm) -> Any:
    return model.policy
