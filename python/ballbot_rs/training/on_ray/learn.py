"""The training loop: RLlib learns, its weights go back to the model, which is evaluated and saved."""

import contextlib
import copy
import dataclasses
import logging
import os
import time
from collections.abc import Iterator
from typing import Any

import ray
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import configure_logger
from tqdm import tqdm

from ballbot_rs import __version__
from ballbot_rs.training.config import TrainConfig
from ballbot_rs.training.on_ray import settings
from ballbot_rs.training.on_ray.connector import TrainBatch
from ballbot_rs.training.on_ray.env_runner import BatchEnvRunner, setup
from ballbot_rs.training.on_ray.module import Learner, PolicyModule
from ballbot_rs.training.on_ray.settings import Ray
from ballbot_rs.training.seeds import EVALUATION_SEEDS, first_seed
from ballbot_rs.training.train import Session

#: Consecutive rounds without a step, a second apart, after which the wait for workers ends.
MAX_IDLE = 60


@dataclasses.dataclass(frozen=True)
class OnRay:
    """The argument `learn` of `train` and `resume`."""

    where: Ray

    def check(self, config: TrainConfig) -> None:
        """Rejects a configuration.

        Raises:
            ValueError: a setting that RLlib's PPO does not have, or robots that cannot be divided evenly.
            ConnectionError: nothing listens at the address of the cluster.
            RuntimeError: the cluster does not have this version of the package.
        """
        settings.arguments(config)
        if config.symmetric is True:
            raise ValueError("symmetric = true: on Ray weights are not tied, expected false or 'auto'")
        self.where.robots_each(config)
        self.where.reach()
        if self.where.address is not None:
            # An earlier run that will be overwritten still exists.
            with cluster(self.where):
                pass

    def __call__(self, session: Session) -> None:
        """Learns to the end of the session.

        Raises:
            ConnectionError: there is no cluster at the address.
            RuntimeError: no worker could be started, or none is left.
        """
        with cluster(self.where), algorithm(self.where, session) as made:
            iterate(session, made)


@contextlib.contextmanager
def cluster(where: Ray) -> Iterator[None]:
    """Joins a cluster, or starts a cluster in this process; keeps a cluster that has been joined already.

    Raises:
        ConnectionError: there is no cluster at the address.
        ValueError: it has fewer cores than workers.
        RuntimeError: it does not have this version of the package.
    """
    if ray.is_initialized():
        yield
        return
    for name in ("ray", "ray.rllib"):
        logging.getLogger(name).setLevel(logging.ERROR)
    # The log level of the C++ parts: they report errors that Ray then handles.
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if where.address is None:
        # One core for the learner, one for each worker, even if there are fewer.
        quiet |= {"num_cpus": where.workers + 1, "include_dashboard": False}
    # Without an address Ray would join any cluster that runs on this machine.
    ray.init(address=where.address or "local", **quiet)
    try:
        if where.address is not None:
            _check_cluster(where)
        yield
    finally:
        ray.shutdown()


def _check_cluster(where: Ray) -> None:
    cores = int(ray.cluster_resources().get("CPU", 0))
    if cores < where.workers:
        raise ValueError(
            f"--workers {where.workers} is out of range: the cluster has {cores} cores, one for each worker"
        )

    def version() -> str:
        import ballbot_rs

        return ballbot_rs.__version__

    try:
        theirs = ray.get(ray.remote(version).remote())
    except ray.exceptions.RayTaskError as error:
        raise RuntimeError(f"ballbot_rs cannot be imported on the cluster {where.address}: {error.cause}") from error
    if theirs != __version__:
        raise RuntimeError(f"the cluster {where.address} has ballbot_rs {theirs}, expected {__version__}")


@contextlib.contextmanager
def algorithm(where: Ray, session: Session) -> Iterator[Algorithm]:
    """RLlib's PPO with the model's weights and optimizer."""
    model, config = session.model, session.config
    try:
        made = algorithm_config(where, config, model, session.seed).build_algo()
    except IndexError as error:
        # RLlib's message if every worker has failed at creation.
        raise RuntimeError(
            f"none of {where.workers} workers could be started: their logs are in {_log_folder()}"
        ) from error
    try:
        _each_learner(made, lambda learner: _give(model, learner))
        made.env_runner_group.sync_weights(from_worker_or_learner_group=made.learner_group)
        yield made
    finally:
        made.stop()


def algorithm_config(where: Ray, config: TrainConfig, model: BaseAlgorithm, seed: int) -> PPOConfig:
    """The configuration of RLlib."""
    robots, steps = where.robots_each(config), settings.steps_each(config)
    arguments = settings.arguments(config, model.num_timesteps)
    spaces = {"observation_space": model.observation_space, "action_space": model.action_space}
    return (
        PPOConfig()
        .environment(
            env_config=setup(
                config.env_id,
                config.env,
                robots=robots,
                base=first_seed(seed),
                span=EVALUATION_SEEDS,
                steps=model.num_timesteps,
                reward_scale=config.reward_scale,
            ),
            **spaces,
        )
        .env_runners(
            env_runner_cls=BatchEnvRunner,
            num_env_runners=where.workers,
            num_envs_per_env_runner=robots,
            rollout_fragment_length=steps,
            create_local_env_runner=False,
        )
        .learners(
            num_learners=0,
            learner_class=Learner,
            add_default_connectors_to_learner_pipeline=False,
            learner_connector=lambda *spaces: TrainBatch(
                *spaces, gamma=arguments["gamma"], lambda_=arguments["lambda_"]
            ),
        )
        .rl_module(rl_module_spec=RLModuleSpec(PolicyModule, model_config={"policy": dict(config.policy)}, **spaces))
        .training(
            train_batch_size_per_learner=config.num_envs * steps,
            grad_clip_by="global_norm",
            shuffle_batch_per_epoch=True,
            use_kl_loss=False,
            # The value is not clipped, as in Stable-Baselines3.
            vf_clip_param=float("inf"),
            **arguments,
        )
        .fault_tolerance(restart_failed_env_runners=True, max_num_env_runner_restarts=1000)
        .debugging(seed=(seed + model.num_timesteps) % 2**31, log_level="ERROR")
    )


def iterate(session: Session, made: Algorithm) -> None:
    """Trains to the end of the session, with evaluations, logs and checkpoints."""
    model = session.model
    begun, goal = model.num_timesteps, model.num_timesteps + session.timesteps
    model.set_logger(configure_logger(0, model.tensorboard_log, "PPO", reset_num_timesteps=False))
    started, idle, evaluated = time.perf_counter(), 0, begun
    with tqdm(total=goal, initial=begun, disable=not session.progress_bar, unit="steps", unit_scale=True) as bar:
        while model.num_timesteps < goal:
            result = made.train()
            found = result.get("env_runners", {})
            steps = begun + int(found.get("num_env_steps_sampled_lifetime", model.num_timesteps - begun))
            if steps == model.num_timesteps:
                idle += 1
                if idle > MAX_IDLE:
                    raise RuntimeError(f"no worker has made a step in {MAX_IDLE} rounds after {steps} steps")
                time.sleep(1.0)
                continue
            idle = 0
            _each_learner(made, lambda learner: _take(model, learner))
            model._n_updates += made.config.num_epochs
            bar.update(steps - model.num_timesteps)
            model.num_timesteps = steps
            for name, key in (("ep_rew_mean", "episode_return_mean"), ("ep_len_mean", "episode_len_mean")):
                if key in found:
                    model.logger.record(f"rollout/{name}", float(found[key]))
            model.logger.record("time/fps", (steps - begun) / (time.perf_counter() - started))
            model.logger.record("time/total_timesteps", steps, exclude="tensorboard")
            model.logger.dump(steps)
            if steps - evaluated >= session.every:
                evaluated = steps
                session.checkpoints.keep(model)
                if not session.keep_best.evaluate_and_log(model):
                    return


def _each_learner(made: Algorithm, do: Any) -> None:
    for result in made.learner_group.foreach_learner(do).result_or_errors:
        result.get()


def _log_folder() -> str:
    return str(ray._private.worker._global_node.get_logs_dir_path())


def _parts(learner: Any) -> tuple[Any, Any]:
    """Policy and optimizer."""
    return learner.module[DEFAULT_MODULE_ID].policy, learner.get_optimizer(DEFAULT_MODULE_ID)


def _give(model: BaseAlgorithm, learner: Any) -> None:
    policy, optimizer = _parts(learner)
    policy.load_state_dict(model.policy.state_dict())
    _copy_moments(model.policy.optimizer, optimizer)


def _take(model: BaseAlgorithm, learner: Any) -> None:
    policy, optimizer = _parts(learner)
    model.policy.load_state_dict(policy.state_dict())
    _copy_moments(optimizer, model.policy.optimizer)


def _copy_moments(source: Any, target: Any) -> None:
    """Copies moments and counts of Adam; each optimizer keeps its own rate."""
    target.load_state_dict({**target.state_dict(), "state": copy.deepcopy(source.state_dict()["state"])})
