"""Training steps per second on Ray: our runner, RLlib's own runner, and Stable-Baselines3, on the same task.

`python tools/ray_throughput.py [--seconds 20] [--workers 1 2 4]`, with the extra `rllib`, for docs/ray.md.
"""

import argparse
import pickle
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from ray.rllib.algorithms.ppo import PPOConfig
from stable_baselines3.common.callbacks import BaseCallback

from ballbot_rs.training import config as config_module
from ballbot_rs.training import train
from ballbot_rs.training.on_ray.env_runner import BatchEnvRunner
from ballbot_rs.training.on_ray.learn import algorithm_config, cluster
from ballbot_rs.training.on_ray.settings import Ray

#: Updates before the clock starts.
WARM_UP = 3


class Clock(BaseCallback):
    """Ends training of Stable-Baselines3 after a time."""

    def __init__(self, seconds: float, warm_up: int) -> None:
        super().__init__()
        self.seconds, self.warm_up = seconds, warm_up
        self.rollouts, self.start, self.first = 0, 0.0, 0
        self.rate = 0.0

    def _on_rollout_end(self) -> None:
        self.rollouts += 1
        if self.rollouts == self.warm_up:
            self.start, self.first = time.perf_counter(), self.num_timesteps

    def _on_step(self) -> bool:
        if self.rollouts < self.warm_up:
            return True
        taken = time.perf_counter() - self.start
        self.rate = (self.num_timesteps - self.first) / taken
        return taken < self.seconds


class Timed:
    """A function and the duration of its calls."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.seconds = function, 0.0

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Calls it."""
        start = time.perf_counter()
        try:
            return self.function(*arguments, **options)
        finally:
            self.seconds += time.perf_counter() - start


def with_sb3(config: Any, seconds: float) -> dict[str, float]:
    """The loop of `ballbot train` without evaluations."""
    clock = Clock(seconds, WARM_UP)
    with tempfile.TemporaryDirectory() as folder:
        train._new_model(config, Path(folder), 0).learn(10**9, callback=clock)
    return {"steps/s": clock.rate}


def with_ray(config: Any, workers: int, seconds: float, is_plain: bool) -> dict[str, float]:
    """The loop of `ballbot train --on ray` without evaluations."""
    where = Ray(workers)
    with tempfile.TemporaryDirectory() as folder, cluster(where):
        made = algorithm_config(where, config, train._new_model(config, Path(folder), 0), 0)
        algorithm = (_plain(made, config) if is_plain else made).build_algo()
        for _ in range(WARM_UP):
            result = algorithm.train()
        learning = Timed(algorithm.learner_group.update)
        algorithm.learner_group.update = learning
        first, start = _steps(result), time.perf_counter()
        while time.perf_counter() - start < seconds:
            result = algorithm.train()
        taken, last = time.perf_counter() - start, _steps(result)
        algorithm.stop()
    return {"steps/s": (last - first) / taken, "learning": learning.seconds / taken}


def parts(config: Any, samples: int = 30) -> dict[str, float]:
    """Cost of the parts in one process: a runner by itself, and its messages."""
    with tempfile.TemporaryDirectory() as folder:
        made = algorithm_config(Ray(1), config, train._new_model(config, Path(folder), 0), 0)
    runner = BatchEnvRunner(config=made, worker_index=1)
    runner.sample()
    start = time.perf_counter()
    collected = [runner.sample() for _ in range(samples)]
    rolled = time.perf_counter()
    messages = [pickle.dumps(episodes, protocol=5) for episodes in collected]
    packed = time.perf_counter()
    for message in messages:
        pickle.loads(message)
    unpacked = time.perf_counter()
    steps = sum(len(episode) for episodes in collected for episode in episodes)
    return {
        "runner, us a step": 1e6 * (rolled - start) / steps,
        "packing, us a step": 1e6 * (packed - rolled) / steps,
        "unpacking, us a step": 1e6 * (unpacked - packed) / steps,
        "bytes a step": sum(map(len, messages)) / steps,
        "bytes of weights": float(len(pickle.dumps(runner.module.get_state(), protocol=5))),
    }


def _plain(made: PPOConfig, config: Any) -> PPOConfig:
    """The same with RLlib's own runner; the id imports our package in the worker."""
    # `environment` would keep the keys of our runner.
    made.env_config = {}
    made.learners(add_default_connectors_to_learner_pipeline=True)
    made._learner_connector = None
    return made.environment(f"ballbot_rs:{config.env_id}", env_config={**config.env, "num_threads": 1}).env_runners(
        env_runner_cls=None, gym_env_vectorize_mode="vector_entry_point"
    )


def _steps(result: dict[str, Any]) -> float:
    return float(result["env_runners"]["num_env_steps_sampled_lifetime"])


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement (default 20)")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4], help="numbers of runners (default 1 2 4)")
    parser.add_argument("--model", default="contact", help="that moves the robots (default contact)")
    parser.add_argument(
        "--parts", action="store_true", help="what a runner and its messages cost, instead of the table"
    )
    arguments = parser.parse_args()
    text = config_module.with_values(config_module.default_text("balance"), {"env.model": arguments.model})
    config = config_module.parse(text, "balance")
    torch.set_num_threads(config.torch_threads)
    if arguments.parts:
        for name, value in parts(config).items():
            print(f"{name}: {value:,.1f}")
        return
    print("| loop | runners | steps/s | learner's share |\n|---|---|---|---|", flush=True)
    rows = [("Stable-Baselines3", 0)]
    rows += [(name, workers) for name in ("RLlib's runner", "ours") for workers in arguments.workers]
    for name, workers in rows:
        if workers:
            found = with_ray(config, workers, arguments.seconds, is_plain=name != "ours")
        else:
            found = with_sb3(config, arguments.seconds)
        share = f"{found['learning']:.0%}" if "learning" in found else ""
        print(f"| {name} | {workers or ''} | {found['steps/s']:,.0f} | {share} |", flush=True)


if __name__ == "__main__":
    main()
