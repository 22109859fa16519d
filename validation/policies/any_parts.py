"""What each part of the policy for any robot is worth: fits without one of them.

`python -m validation.policies.any_parts` prints the table of docs/training.md, in some minutes of one core.
"""

import dataclasses
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs._core import SAME_ROBOT
from ballbot_rs.envs.family import is_family
from ballbot_rs.training import config, teacher, tied

#: Training seeds; each has other robots.
SEEDS: Final = (0, 1, 2)

#: Robots of a fit, a smaller one than the fit of the policy in the package.
NUM_ENVS: Final = 512
ROUNDS: Final = 18

#: The family without other ranges.
USUAL: Final = {"family": NUM_ENVS // SAME_ROBOT}

#: Changed options of the environment, changed settings of the teacher, and whether the policy is symmetric and odd.
ARMS: Final[Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any], tuple[bool, bool]]]] = {
    "all parts": ({}, {}, (True, True)),
    "newest observation only": ({"history": 1}, {}, (True, True)),
    "one robot, the paper's": ({"robot": "paper"}, {}, (True, True)),
    "observations and torques not scaled by the robot": ({"scale_by_robot": False}, {}, (True, True)),
    "not odd": ({}, {}, (True, False)),
    "neither odd nor symmetric": ({}, {}, (False, False)),
    "no robots outside the family, all errors alike": ({"robot": USUAL}, {"weights": {}}, (True, True)),
    "the law with its default weights": ({}, {"options": {"traction": 0.9}}, (True, True)),
    "noise of 0.1": ({}, {"noise": 0.1}, (True, True)),
}


def fitted(arm: str, seed: int) -> PPO:
    """The policy of an arm."""
    options, settings, (symmetric, odd) = ARMS[arm]
    whole = config.parse(config.default_text("balance", "any"), "balance-any.toml")
    assert whole.teacher is not None
    options = {"robot": {**whole.env["robot"], **USUAL}, **options}
    if is_family(options["robot"]):
        options["robot"] = {**options["robot"], "seed": seed}
    env = bb.BallbotVecEnv(NUM_ENVS, num_threads=1, seed=1000 * seed, **{**whole.env, **options, "integral_rate": 0.0})
    fit = dataclasses.replace(whole.teacher, rounds=ROUNDS, **settings)
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=2048, policy_kwargs=dict(whole.policy), seed=seed)
    (law,) = teacher.laws_of(model, fit)
    teacher.fit_actor(model, law, fit, seed, tied.tie(model, symmetric, print, odd=odd))
    return model


def evaluated(path: Path, params: Any, episodes: int) -> bb.Result:
    """A policy on robots that it has not been fitted on."""
    # From tilts that every robot recovers from.
    return bb.evaluate(path, episodes=episodes, seed=1000, num_threads=1, robot=params, events=None, reset_tilt=0.1)


def main() -> int:
    """Prints the rows."""
    torch.set_num_threads(1)
    presets = bb.Params.preset_names()
    print(f"| | 128 robots of the family | {' | '.join(presets)} |\n|---|--:{'|--:' * len(presets)}|")
    with tempfile.TemporaryDirectory() as folder:
        for arm in ARMS:
            cells: list[list[float]] = []
            begin = time.process_time()
            for seed in SEEDS:
                path = bb.save(fitted(arm, seed), Path(folder) / "policy.zip")
                robots = [({"family": 128, "seed": 1000}, 1024), *((name, 100) for name in presets)]
                cells.append([100 * evaluated(path, *robot).success_rate for robot in robots])
            columns = zip(*cells, strict=True)
            shown = " | ".join(", ".join(f"{value:.0f}" for value in column) for column in columns)
            print(f"| {arm} | {shown} |", flush=True)
            print(f"{arm}: {time.process_time() - begin:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
