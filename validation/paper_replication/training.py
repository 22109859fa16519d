"""Section IV: training with Stable-Baselines3.

"No RL agent is trained yet", according to the paper, which leaves training as a next step. Here is this step: PPO with
the project's own configuration (`make train`), seed 0, in a temporary folder; the only change is an evaluation every 40
960 steps, for the curve. The best policy is then compared with LQR and the paper's PID (at 500 Hz) on the same 100
starts, on the model it was trained on. Success means upright for 10 s and, over the last 2 s, tilt within 1° and the
ball within 0.10 m of where it should be: the PID controls only the tilt, so its ball drifts off.
"""

import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ballbot_rs.analysis.episodes import compare
from ballbot_rs.analysis.result import Result
from validation.claim import Claim
from validation.page import table
from validation.topic import Comparison, Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SEED, _EPISODES = 0, 100
_EVERY = 40_960


def run() -> Findings:
    """Trains and compares."""
    from ballbot_rs.training import config, train

    _, text = config.load("balance")
    changed, count = re.subn(r"(?m)^every_timesteps = \S+$", f"every_timesteps = {_EVERY}", text)
    settings = config.parse(changed, "balance.toml")
    assert count == 1, "balance.toml sets every_timesteps once"
    assert settings.evaluation.every_timesteps == _EVERY
    with tempfile.TemporaryDirectory() as folder:
        policy = train.train(settings, changed, Path(folder) / "run", seed=_SEED, progress_bar=False)
        with np.load(policy.parent / "evaluations.npz") as log:
            steps, returns, successes = log["timesteps"], log["results"], log["successes"]
        results = compare([str(policy), "lqr", "pid"], episodes=_EPISODES, **settings.env)
    names = ("policy (PPO)", "LQR", "PID of the paper")
    rows = [[name, *_cells(result)] for name, result in zip(names, results, strict=True)]
    claims = [
        Claim(f"successes of the policy in {_EPISODES}", _EPISODES * results[0].success_rate, 100.0, 3.0, "", True)
    ]
    compared = Comparison(
        "trained agent",
        "Section IV, V",
        "none yet",
        f"{100 * results[0].success_rate:.0f} of 100 successes after {steps[-1]} steps",
        "the paper's next step",
    )

    def draw(fig: "Figure") -> None:
        from ballbot_rs.media.figures.style import COLORS

        left, right = fig.subplots(1, 2)
        thousands = steps / 1e3
        left.plot(thousands, returns.mean(axis=1), "o-", markersize=3, color=COLORS[0], label="mean")
        low, high = np.percentile(returns, [10, 90], axis=1)
        left.fill_between(thousands, low, high, color=COLORS[0], alpha=0.2, linewidth=0, label="10 to 90 %")
        left.set(xlabel="environment steps (thousands)", ylabel="return (at most 1000)", ylim=(0.0, 1050.0))
        left.legend(loc="lower right")
        right.plot(thousands, 100.0 * successes.mean(axis=1), "o-", markersize=3, color=COLORS[0])
        right.set(xlabel="environment steps (thousands)", ylabel="success (% of 50 episodes)", ylim=(-3.0, 103.0))

    head = [
        "",
        "success (%)",
        "upright to the end (%)",
        "settling (s)",
        "tilt RMS (deg)",
        "ball excursion (m)",
        "torque RMS (N·m)",
    ]
    return Findings(claims, draw, table(head, rows), compared=(compared,))


def _cells(result: Result) -> list[str]:
    settling = "never" if result.settling_time is None else f"{result.settling_time:.2f}"
    return [
        f"{100 * result.success_rate:.0f}",
        f"{100 * result.survival_rate:.0f}",
        settling,
        f"{np.degrees(result.tilt_rms):.2f}",
        f"{result.ball_excursion:.3f}",
        f"{result.torque_rms:.3f}",
    ]
