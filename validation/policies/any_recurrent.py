"""What recurrence is worth in the policy for any robot: fits with LSTM cells in place of a history of observations.

No policy is odd, as LSTM cells are not.

`python -m validation.policies.any_recurrent` prints the table of docs/training.md, in some minutes of one core.
"""

import dataclasses
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs.training import config, export, teacher, tied
from validation.policies.any_parts import NUM_ENVS, ROUNDS, SEEDS, USUAL, evaluated

#: Changed options of the environment, and the policy.
ARMS: Final[Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]]] = {
    "history of 0.6 s, no state": ({}, {"net_arch": [24, 30]}),
    "newest observation, no state": ({"history": 1}, {"net_arch": [24, 30]}),
    "newest observation, 24 LSTM units": ({"history": 1}, {"net_arch": [], "lstm_hidden_size": 24}),
    "history of 0.6 s, 18 LSTM units": ({}, {"net_arch": [], "lstm_hidden_size": 18}),
}


def fitted(arm: str, seed: int) -> Any:
    """The policy of an arm."""
    options, policy = ARMS[arm]
    whole = config.parse(config.default_text("balance", "any"), "balance-any.toml")
    assert whole.teacher is not None
    robot = {**whole.env["robot"], **USUAL, "seed": seed}
    options = {**whole.env, **options, "robot": robot, "integral_rate": 0.0}
    env = bb.BallbotVecEnv(NUM_ENVS, num_threads=1, seed=1000 * seed, **options)
    fit = dataclasses.replace(whole.teacher, rounds=ROUNDS)
    kind, name = (RecurrentPPO, "MlpLstmPolicy") if "lstm_hidden_size" in policy else (PPO, "MlpPolicy")
    arguments: dict[str, Any] = {"n_steps": 32, "batch_size": 2048, "policy_kwargs": {**whole.policy, **policy}}
    model: Any = kind(name, env, seed=seed, **arguments)
    (law,) = teacher.laws_of(model, fit)
    teacher.fit_actor(model, law, fit, seed, tied.tie(model, whole.symmetric, print))
    return model


def main() -> int:
    """Prints the rows."""
    torch.set_num_threads(1)
    presets = bb.Params.preset_names()
    names = ("parameters", "bytes of ONNX", "128 robots of the family", *presets, "fit, CPU s")
    print(f"| | {' | '.join(names)} |\n|---|{'--:|' * len(names)}")
    with tempfile.TemporaryDirectory() as folder:
        for arm in ARMS:
            cells: list[list[float]] = []
            seconds = 0.0
            for seed in SEEDS:
                begin = time.process_time()
                model = fitted(arm, seed)
                seconds += (time.process_time() - begin) / len(SEEDS)
                source = bb.save(model, Path(folder) / "policy.zip")
                path = source.with_suffix(".onnx")
                export.export(source, path)
                robots = [({"family": 128, "seed": 1000}, 1024), *((name, 100) for name in presets)]
                cells.append([100 * evaluated(path, *robot).success_rate for robot in robots])
            columns = zip(*cells, strict=True)
            shown = " | ".join(", ".join(f"{value:.0f}" for value in column) for column in columns)
            parameters = sum(one.numel() for one in teacher._actor(model))
            print(f"| {arm} | {parameters} | {path.stat().st_size} | {shown} | {seconds:.0f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
