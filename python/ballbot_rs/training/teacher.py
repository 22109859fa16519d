"""A warm start: before it learns from rewards, a policy is fitted to the torques of a classical law.

The law labels the states that the policy visits with its actions (dataset aggregation: Ross, Gordon and Bagnell, "A
reduction of imitation learning and structured prediction to no-regret online learning", AISTATS 2011). Then the value
function learns the returns of the fitted policy: with an untrained one the first updates of PPO destroy the fit.

With `drawn` the law is designed for each robot as events have sampled it, which the policy must infer from its history.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger

from ballbot_rs._core import Batch, Controller
from ballbot_rs._state_rows import BALL_POSITION, BODY_QUATERNION
from ballbot_rs.control import sb3_recurrent
from ballbot_rs.envs.family import has_several_robots
from ballbot_rs.envs.registration import geometry_of
from ballbot_rs.training import teacher_sequences
from ballbot_rs.training.config import Teacher
from ballbot_rs.training.run_state import seed_environments
from ballbot_rs.training.seeds import first_seed
from ballbot_rs.training.teacher_errors import Labels, Weighting, epochs_of, mean_square, set_rate
from ballbot_rs.training.teacher_rounds import Floats, rounds
from ballbot_rs.training.tied import Ties

#: Learning rate of the value function's fit; it is fast, as only the result matters.
VALUE_RATE = 1e-3
VALUE_EPOCHS = 10

#: Most numbers of all observations that a fit keeps; they take 4.3 GB.
MOST_NUMBERS = 2**30

#: Most steps of an episode whose return ranks the laws.
RANKED_STEPS = 1000


def fit(
    model: BaseAlgorithm,
    law: Controller,
    teacher: Teacher,
    seed: int,
    tell: Callable[[str], None],
    ties: Ties | None = None,
) -> None:
    """Fits the actor and the value function of a new model; its steps are not counted.

    Args:
        model: of PPO, or of RecurrentPPO of sb3-contrib.
        law: of the teacher, to fit to.
        teacher: the settings.
        seed: for the choice of robots that the law drives, and for the noise.
        tell: called with a text about the fit.
        ties: between the weights; None for none.
    """
    learner: Any = model
    errors = fit_actor(learner, law, teacher, seed, ties)
    tell(f"fitted to {law.name}: root mean square error of the actions {errors[-1]:.3f}")
    fit_value(learner, teacher.value_rollouts)


def check_size(teacher: Teacher, num_envs: int, width: int) -> None:
    """Checks that the observations of a fit, of `width` numbers each, have room in the memory.

    Raises:
        ValueError: they are too many.
    """
    states = teacher.rounds * teacher.steps * num_envs
    if states * width > MOST_NUMBERS:
        raise ValueError(
            f"teacher.rounds * teacher.steps * num_envs = {states} is out of range: it must be at most "
            f"{MOST_NUMBERS // width} for observations of {width} numbers"
        )


def laws_of(model: BaseAlgorithm, teacher: Teacher) -> list[Controller]:
    """The laws, for the robot of a model's environments.

    Raises:
        ValueError: an unknown law, an option that it does not have, or a task that it cannot perform.
    """
    batch = _batch(model)
    if batch.stage is not None and batch.stage.task is not None:
        raise ValueError(f"teacher: the task {batch.task} is in Python, where laws have no setpoint: leave it out")
    if not teacher.follows_motion and geometry_of(batch.task) != "velocity":
        raise ValueError(f"teacher.follows_motion = False: the task {batch.task} commands no velocity")
    if has_several_robots(batch) and not teacher.drawn:
        raise ValueError("teacher.drawn = False: with several robots the law is designed for each, drawn = true")
    try:
        robot = batch.nominal_params(0)
        return [Controller(name, robot, batch.control_dt, **options) for name, options in teacher.laws.items()]
    except (TypeError, ValueError) as error:
        raise ValueError(f"teacher: {error}") from error


def best_law(model: BaseAlgorithm, teacher: Teacher, seed: int, tell: Callable[[str], None]) -> Controller:
    """The law with the highest mean return in the same episodes; `tell` is called with the returns."""
    laws = laws_of(model, teacher)
    if len(laws) == 1:
        return laws[0]
    returns = [_mean_return(model, law, teacher, seed) for law in laws]
    # The run begins as without the ranking.
    seed_environments(model, first_seed(seed))
    tell("mean returns: " + ", ".join(f"{law.name} {mean:.4g}" for law, mean in zip(laws, returns, strict=True)))
    return laws[int(np.argmax(returns))]


def _mean_return(model: BaseAlgorithm, law: Controller, teacher: Teacher, seed: int) -> float:
    """Mean return of a law in the first episode of each environment, of the first steps if it is longer."""
    environment, batch = model.get_env(), _batch(model)
    assert environment is not None
    seed_environments(model, first_seed(seed))
    environment.reset()
    returns, running = np.zeros(environment.num_envs), np.ones(environment.num_envs, dtype=bool)
    for _ in range(min(batch.max_episode_steps, RANKED_STEPS)):
        _, rewards, dones, _ = environment.step(_actions_of(law, batch, teacher))
        returns[running] += rewards[running]
        running &= ~dones
        if not running.any():
            break
    return float(returns.mean())


def _actions_of(law: Controller, batch: Batch, teacher: Teacher) -> npt.NDArray[np.float32]:
    """The law's actions in the true states."""
    return batch.control(law, _setpoints(batch, law, teacher), privileged=True, drawn=teacher.drawn)


def fit_actor(model: PPO, law: Controller, teacher: Teacher, seed: int, ties: Ties | None = None) -> list[float]:
    """Fits the most likely actions; the root mean square error of each round, over all states so far.

    Raises:
        ValueError: observations have an integral, on which no law acts.
    """
    environment = model.get_env()
    assert environment is not None
    batch = _batch(model)
    if batch.integral is not None:
        raise ValueError("integral_rate: a fit needs observations without the integral: it must be 0")
    rng = np.random.default_rng(seed)
    optimizer = torch.optim.Adam(_actor(model), lr=teacher.learning_rate)
    if ties is not None:
        ties.hold_after(optimizer)
    weighting = Weighting(batch, teacher)

    def label() -> Labels:
        actions = _actions_of(law, batch, teacher)
        return actions, weighting.of(batch, actions)

    if sb3_recurrent.is_recurrent(model):
        return teacher_sequences.fit_actor(model, teacher, rng, label, optimizer)

    def act(observations: Floats, _: npt.NDArray[np.bool_]) -> Floats:
        with torch.no_grad():
            own: Floats = _actions(model, torch.as_tensor(observations)).numpy()
        return own

    length = teacher.steps * environment.num_envs
    # The states of all rounds, kept once: they take gigabytes.
    shapes = (environment.observation_space.shape or (), (3,), ())
    states = [torch.empty(teacher.rounds * length, *shape) for shape in shapes]
    errors = []
    for done, found in enumerate(rounds(environment, act, label, teacher, rng)):
        end = (done + 1) * length
        for rows, new in zip(states, (found.observations, found.labels, found.factors), strict=True):
            rows[end - length : end] = torch.as_tensor(new).reshape(length, *rows.shape[1:])
        errors.append(_regress(model, optimizer, [rows[:end] for rows in states], teacher, done))
    return errors


def fit_value(model: PPO, rollouts: int) -> None:
    """Lets the value function learn from rollouts of the actor, which stays unchanged."""
    if rollouts == 0:
        return
    frozen = [*_actor(model), model.policy.log_std]
    settings = {"lr_schedule": lambda _: VALUE_RATE, "n_epochs": VALUE_EPOCHS, "target_kl": None}
    # Without a log, which belongs to training.
    settings |= {"_logger": Logger(None, []), "_custom_logger": True}
    kept = {name: getattr(model, name, None) for name in settings}
    try:
        _set(model, settings)
        for parameter in frozen:
            parameter.requires_grad_(False)
        model.learn(rollouts * model.n_steps * model.n_envs, reset_num_timesteps=False)
    finally:
        for parameter in frozen:
            parameter.requires_grad_(True)
        _set(model, {**kept, "num_timesteps": 0, "_episode_num": 0, "_n_updates": 0})


def _set(model: PPO, values: dict[str, Any]) -> None:
    for name, value in values.items():
        setattr(model, name, value)


def _regress(
    model: PPO,
    optimizer: torch.optim.Optimizer,
    states: list[torch.Tensor],
    teacher: Teacher,
    done: int,
) -> float:
    """Some epochs of least squares of weighted errors after `done` rounds.

    Args:
        model: whose actor is fitted.
        optimizer: of the actor.
        states: observations, the law's actions there, and the factors of the errors, of all states so far.
        teacher: the settings.
        done: rounds before the last one.

    Returns:
        The root mean square error in the last epoch.
    """
    seen, targets, weights = states
    total = 0.0
    for epoch in range(epochs_of(teacher, done)):
        total = 0.0
        batches = torch.split(torch.randperm(len(seen)), teacher.batch_size)
        for i, chosen in enumerate(batches):
            loss = mean_square(_actions(model, seen[chosen]), targets[chosen], weights[chosen, None], teacher)
            set_rate(optimizer, teacher, done, epoch + i / len(batches))
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            total += loss.item() * len(chosen)
    return float(np.sqrt(total / len(seen)))


def _setpoints(batch: Batch, law: Controller, teacher: Teacher) -> dict[str, npt.NDArray[np.float64]]:
    """The task's setpoint for the law on each robot, with the robot's own heading: no task observes the heading."""
    setpoints = batch.setpoint()
    parts = {part: setpoints[part] for part in law.setpoint_parts if part in setpoints}
    states = batch.states()
    w, _, _, z = states[:, BODY_QUATERNION].T
    yaw = 2.0 * np.arctan2(z, w)
    if "yaw" in law.setpoint_parts:
        parts["yaw"] = yaw
    if not teacher.follows_motion:
        motion = _steady_motion(batch.command(), yaw)
        parts |= {part: values for part, values in motion.items() if part in law.setpoint_parts}
    if "position" in parts and not teacher.follows_position:
        parts["position"] = states[:, BALL_POSITION][:, :2].copy()
    return parts


def _steady_motion(
    commands: npt.NDArray[np.float64], yaw: npt.NDArray[np.float64]
) -> dict[str, npt.NDArray[np.float64]]:
    """The motion at a commanded velocity (heading frame) and rate of the heading, with all its derivatives."""
    x, y, rate = commands.T
    velocity = np.stack([np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y], axis=-1)
    across = rate[:, None] * np.stack([-velocity[:, 1], velocity[:, 0]], axis=-1)
    squared = -(rate[:, None] ** 2)
    return {
        "velocity": velocity,
        "acceleration": across,
        "jerk": squared * velocity,
        "snap": squared * across,
        "yaw_rate": rate,
    }


def _actions(model: PPO, observations: torch.Tensor) -> torch.Tensor:
    """The most likely actions."""
    actions: torch.Tensor = model.policy.get_distribution(observations).mode()
    return actions


def _actor(model: PPO) -> list[torch.nn.Parameter]:
    """The parameters that determine the most likely action, but not the value."""
    policy: Any = model.policy
    cells = policy.lstm_actor.parameters() if sb3_recurrent.is_recurrent(model) else ()
    return [*cells, *model.policy.mlp_extractor.policy_net.parameters(), *model.policy.action_net.parameters()]


def _batch(model: BaseAlgorithm) -> Batch:
    environment: Any = model.get_env()
    batch: Batch = environment.unwrapped._batch
    return batch
