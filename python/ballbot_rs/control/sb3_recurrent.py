"""Recurrent policies of sb3-contrib: policies with LSTM cells."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from ballbot_rs.control.recurrent import Rows

#: The policy of RecurrentPPO for vectors of observations.
POLICY = "MlpLstmPolicy"


class RecurrentModel:
    """A model with a recurrent policy as a `Recurrent`: the most likely actions.

    A state has the outputs of all LSTM layers, then their cell states.
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        self._model = model
        lstm: Any = model.policy.lstm_actor
        self._shape = (2, lstm.num_layers, lstm.hidden_size)
        #: Numbers of a state.
        self.state_len = 2 * lstm.num_layers * lstm.hidden_size
        #: What an ONNX file states of it.
        self.metadata = {"state": {"cell": "LSTM", "layers": lstm.num_layers, "units": lstm.hidden_size}}

    def initial_state(self, count: int) -> Rows:
        """As `Recurrent`."""
        return np.zeros((count, self.state_len), dtype=np.float32)

    def step(self, observation: Rows, state: Rows) -> tuple[npt.NDArray[np.float32], Rows]:
        """As `Recurrent`, computed on one thread."""
        n = len(state)
        # The library has the axis of the robots between layers and units.
        given = tuple(np.moveaxis(state.reshape(n, *self._shape), 0, 2))
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            actions, after = self._model.predict(observation, state=given, deterministic=True)
        finally:
            torch.set_num_threads(threads)
        return actions, np.moveaxis(np.asarray(after, dtype=np.float32), 2, 0).reshape(n, self.state_len)


def is_recurrent(model: BaseAlgorithm) -> bool:
    """Whether a model's policy has LSTM cells."""
    return hasattr(model.policy, "lstm_actor")


def of(model: BaseAlgorithm) -> RecurrentModel | None:
    """A model's recurrent policy; None for other policies."""
    return RecurrentModel(model) if is_recurrent(model) else None


#: The parts of `_last_lstm_states` of a learner: outputs and cell states of the actor and of the critic.
_OF_LEARNER = {"lstm_pi_outputs": (0, 0), "lstm_pi_cells": (0, 1), "lstm_vf_outputs": (1, 0), "lstm_vf_cells": (1, 1)}


def states_of_learner(model: BaseAlgorithm) -> dict[str, npt.NDArray[np.float32]]:
    """The states in which a learner's robots are between two rollouts, by name."""
    states: Any = model
    states = states._last_lstm_states
    return {name: states[i][j].cpu().numpy() for name, (i, j) in _OF_LEARNER.items()}


def give_states_to_learner(model: BaseAlgorithm, found: Mapping[str, npt.NDArray[Any]]) -> None:
    """Restores `states_of_learner`.

    Raises:
        KeyError: a state is missing.
        ValueError: it has another shape.
    """
    learner: Any = model
    states: list[list[Any]] = [[None, None], [None, None]]
    for name, (i, j) in _OF_LEARNER.items():
        expected = learner._last_lstm_states[i][j].shape
        if found[name].shape != tuple(expected):
            raise ValueError(f"{name} has shape {found[name].shape}, expected {tuple(expected)}")
        states[i][j] = torch.as_tensor(found[name].copy())
    learner._last_lstm_states = type(learner._last_lstm_states)(tuple(states[0]), tuple(states[1]))
