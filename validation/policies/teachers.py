"""Policies fitted to a controller of each sampled robot, or of the nominal robot, with a history and without.

`python -m validation.policies.teachers` prints the table of docs/training.md, in two to three minutes of one core.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import torch
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs.training import teacher
from ballbot_rs.training.config import Teacher

#: Ages of the observations of a policy with a history.
AGES: Final = [0, 1, 2, 4, 8, 16, 31]
TRAINED: Final = [{"term": "body_com_offset", "range": [-0.006, 0.006]}]
EVALUATED: Final = [{"term": "body_com_offset", "range": [[0.005, 0.005], [0.0, 0.0]]}]


def fitted(history: Any, drawn: bool, seed: int = 0) -> tuple[PPO, float]:
    """A policy fitted to `lqr`, and the time of the fit, s of one core."""
    env = bb.BallbotVecEnv(128, events=TRAINED, history=history, num_threads=1, seed=1000 * seed, max_episode_steps=500)
    network = {"net_arch": [128, 128]}
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=2048, policy_kwargs=network, seed=seed)
    settings = Teacher("lqr", drawn=drawn, rounds=8, steps=200, epochs=4, learning_rate=2e-3)
    begin = time.process_time()
    (law,) = teacher.laws_of(model, settings)
    teacher.fit_actor(model, law, settings, seed)
    return model, time.process_time() - begin


def main() -> int:
    """Prints the rows."""
    torch.set_num_threads(1)
    print("| history | teacher | nominal robot | center of mass 5 mm off |\n|---|---|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        for history, drawn in ((AGES, True), (AGES, False), (1, True), (1, False)):
            model, seconds = fitted(history, drawn)
            path = bb.save(model, Path(folder) / "policy.zip")
            results = [bb.evaluate(path, episodes=100, seed=1000, events=events) for events in (None, EVALUATED)]
            cells = " | ".join(f"{100 * result.success_rate:.0f} %" for result in results)
            label = f"`{history}`" if history == AGES else "newest observation only"
            robot = "of each robot (`drawn`)" if drawn else "of the nominal robot"
            print(f"| {label} | {robot} | {cells} |", flush=True)
            print(f"fitted in {seconds:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
