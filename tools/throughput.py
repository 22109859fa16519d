"""Prints the median throughput of `BallbotVecEnv` over several runs: environment steps per second."""

import argparse
import statistics
import time

import numpy as np

import ballbot_rs as bb


def main() -> None:
    """Measures as the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--num-threads", type=int, default=1)
    parser.add_argument("--model", default="rigid")
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--steps", type=int, default=50, help="steps of the whole batch in one run")
    arguments = parser.parse_args()

    env = bb.BallbotVecEnv(
        num_envs=arguments.num_envs, model=arguments.model, num_threads=arguments.num_threads, seed=0
    )
    env.reset()
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.1, 0.1, (arguments.steps, arguments.num_envs, 3)).astype(np.float32)
    rates = []
    for _ in range(arguments.runs):
        start = time.perf_counter()
        for action in actions:
            env.step(action)
        rates.append(actions.shape[0] * actions.shape[1] / (time.perf_counter() - start))
    print(
        f"{arguments.model}, {arguments.num_envs} robots, {arguments.num_threads} thread(s): "
        f"median {statistics.median(rates):,.0f} env steps/s, min {min(rates):,.0f}, max {max(rates):,.0f}"
    )


if __name__ == "__main__":
    main()
