"""From fragments to the training batch: all arrays at once, while RLlib's own connector goes step by step."""

from collections.abc import Sequence
from typing import Any

import torch
from ray.rllib.connectors.connector_v2 import ConnectorV2
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.columns import Columns
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.evaluation.postprocessing import Postprocessing

from ballbot_rs.training.on_ray.advantages import advantages, joined, without_last


class TrainBatch(ConnectorV2):  # type: ignore[misc]
    """Replaces RLlib's default pieces; the batch has no artificial steps and needs no mask."""

    def __init__(self, *spaces: Any, gamma: float, lambda_: float) -> None:
        super().__init__(*spaces)
        self._gamma, self._lambda = gamma, lambda_

    def __call__(
        self,
        *,
        rl_module: Any,
        batch: dict[str, Any],  # noqa: ARG002
        episodes: Sequence[SingleAgentEpisode],
        **_: Any,
    ) -> dict[str, Any]:
        """The columns that RLlib's PPO reads, as tensors."""
        lengths = [len(episode) for episode in episodes]
        observations = torch.as_tensor(joined([episode.observations.data for episode in episodes]))
        with torch.no_grad():
            values = rl_module[DEFAULT_MODULE_ID].compute_values({Columns.OBS: observations}).numpy()
        gains, targets = advantages(
            joined([episode.rewards.data for episode in episodes]),
            values,
            lengths,
            [episode.is_terminated for episode in episodes],
            gamma=self._gamma,
            gae_lambda=self._lambda,
        )
        outputs = [episode.extra_model_outputs for episode in episodes]
        columns = {
            Columns.ACTIONS: joined([episode.actions.data for episode in episodes]),
            Columns.ACTION_LOGP: joined([output[Columns.ACTION_LOGP].data for output in outputs]),
            Columns.ACTION_DIST_INPUTS: joined([output[Columns.ACTION_DIST_INPUTS].data for output in outputs]),
            # As RLlib does: over the whole batch.
            Postprocessing.ADVANTAGES: (gains - gains.mean()) / max(1e-4, float(gains.std())),
            Postprocessing.VALUE_TARGETS: targets,
        }
        tensors = {name: torch.as_tensor(column) for name, column in columns.items()}
        return {DEFAULT_MODULE_ID: {Columns.OBS: observations[without_last(lengths)], **tensors}}
