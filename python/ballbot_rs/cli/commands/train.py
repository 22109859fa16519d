"""`ballbot train`: train a policy, then compare it with the classical controllers."""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ballbot_rs import _interrupts
from ballbot_rs._extras import require
from ballbot_rs._text_table import print_table
from ballbot_rs.analysis.conditions import baselines
from ballbot_rs.analysis.episodes import MAX_EPISODES, compare
from ballbot_rs.cli.commands import report
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options import settings
from ballbot_rs.cli.options.numbers import MAX_RUN_SEED, whole
from ballbot_rs.cli.progress import bar
from ballbot_rs.envs.own import registry
from ballbot_rs.envs.own.source import in_source
from ballbot_rs.envs.registration import DEFAULT_TASK, task_of
from ballbot_rs.training import config as config_module
from ballbot_rs.training import evolution, run_folder
from ballbot_rs.training.on_ray.settings import MAX_WORKERS, Ray

if TYPE_CHECKING:
    from ballbot_rs.training.config import TrainConfig
    from ballbot_rs.training.train import Learn

#: In place of a task: to balance any robot.
ANY = "any"

#: Most steps of a training run; at a hundred thousand per second they take a year.
MAX_TIMESTEPS = 10**12


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("train balance --seed 1 --run runs/mine", "a policy for the paper's robot; the run's report.html has a video"),
    (
        "train goal --robot mine.toml --events mild --timesteps 2e6",
        "for a robot of your own, with random masses and friction",
    ),
    ("train balance --algorithm cma", "a linear policy by evolution, without PyTorch"),
    ("train --resume runs/mine --timesteps 1e6", "continue a run"),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser(
        "train", help="train a policy with Stable-Baselines3 or by evolution", examples=EXAMPLES
    )
    shared.add_task(command, ANY)
    shared.add_robot(
        command,
        otherwise="the configuration's, else",
        others=", or a key of the configuration, as total_timesteps=1e6 or algorithm_arguments.gamma=0.98",
        keys=keys,
    )
    shared.add_events(command)
    shared.add_seed(command, "seed of the run (default 0)", None, MAX_RUN_SEED)
    command.add_argument(
        "--config",
        type=Path,
        help="TOML file to use instead of the task's own, or a variant of it, as recover of balance",
    )
    command.add_argument(
        "--algorithm",
        type=algorithm_name,
        metavar=evolution.ALGORITHM.lower(),
        help="cma: search a linear policy by evolution instead of the configuration's algorithm; needs no PyTorch",
    )
    command.add_argument("--run", type=Path, help="folder of the run (default runs/TASK-seed-SEED-TIME)")
    command.add_argument(
        "--resume", type=Path, metavar="RUN", help="continue a run; with --timesteps even a finished one"
    )
    command.add_argument("--overwrite", action="store_true", default=None, help="delete an earlier run in that folder")
    command.add_argument(
        "--timesteps",
        type=whole(1, MAX_TIMESTEPS),
        help="train for exactly this many steps in total; the exit status still states whether the policy succeeds",
    )
    command.add_argument(
        "--episodes", type=whole(0, MAX_EPISODES), default=100, help="episodes of the comparison (default 100, 0: none)"
    )
    command.add_argument(
        "--on",
        choices=("ray",),
        help="learn with PPO of RLlib on a Ray cluster instead of Stable-Baselines3; docs/ray.md",
    )
    command.add_argument(
        "--workers",
        type=whole(1, MAX_WORKERS),
        metavar="N",
        help="with --on ray: processes among which the robots are divided (default 1)",
    )
    command.add_argument(
        "--ray-address",
        metavar="HOST:PORT",
        help="with --on ray: a cluster to join instead of starting one",
    )
    command.add_argument("--no-report", action="store_true", help="do not end with a report, one HTML file")
    shared.add_verbosity(command, "the result")
    command.set_defaults(carry_out=run)


def algorithm_name(name: str) -> str:
    """The algorithm of evolution, for argparse."""
    known = evolution.ALGORITHM.lower()
    if name == known:
        return name
    others = [other for other in config_module.ALGORITHMS if other != evolution.ALGORITHM]
    for other in others:
        if name.lower() == other.lower():
            raise argparse.ArgumentTypeError(
                f"'{name}' is set in the configuration: --set algorithm={other}, with a --config that has its arguments"
            )
    raise argparse.ArgumentTypeError(
        f"invalid choice: '{name}', expected {known}, or --set algorithm= with {' or '.join(others)}"
    )


def keys() -> dict[str, str]:
    """What `--set` takes in the training of a task, by names that might be taken for options."""
    config, _ = config_module.load(DEFAULT_TASK)
    names = {field.name: field.name for field in dataclasses.fields(config)}
    return {**settings.of_environments(), **_parts(config), **names}


def _parts(config: "TrainConfig") -> dict[str, str]:
    """The keys of the tables of a configuration, with their tables."""
    evaluation = [field.name for field in dataclasses.fields(config.evaluation)]
    tables = {"policy": config.policy, "evaluation": evaluation, "algorithm_arguments": config.algorithm_arguments}
    return {key: f"{table}.{key}" for table, keys in tables.items() for key in keys}


def _config_of_run(folder: Path, chosen: str | None) -> "TrainConfig":
    """The configuration of a run, before the run is changed.

    Raises:
        ValueError: another task is requested, or the configuration is damaged.
        FileNotFoundError: the folder has no run.
    """
    run_folder.read_record(folder)
    config = config_module.parse(run_folder.read_config_text(folder), str(folder / run_folder.CONFIG))
    task = task_of(config.env_id)
    if chosen is not None and chosen != task:
        raise ValueError(f"{folder} is a run of {task}, not of {chosen}: omit the task, or name the run's task")
    return config


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    started = time.perf_counter()
    if arguments.task == ANY:
        if arguments.config is not None:
            raise ValueError(f"'{ANY}' names a configuration of {DEFAULT_TASK}: leave out --config")
        arguments.task = DEFAULT_TASK
        arguments.config = Path(ANY) if arguments.resume is None else None
    progress_bar = not (arguments.quiet or arguments.json)
    if arguments.resume is not None:
        fixed = ("config", "algorithm", "run", "seed", "overwrite")
        given = [name for name in fixed if getattr(arguments, name) is not None]
        if given:
            raise ValueError(f"--resume continues a run as it was configured: --{given[0]} cannot be combined with it")
        if arguments.set or shared.named_options(arguments):
            raise ValueError("--resume continues a run as it was configured: it takes no other values")
        folder = arguments.resume
        config = _config_of_run(folder, arguments.task)
        policy = _interruptible(
            task_of(config.env_id), folder, lambda: _resume(config, folder, arguments, progress_bar)
        )
    else:
        task = arguments.task or DEFAULT_TASK
        config, text = config_module.load(task, arguments.config, arguments.robot)
        if arguments.algorithm not in (None, config.algorithm.lower()):
            text = evolution.adapted(text)
            config = config_module.parse(text, "the configuration")
        values = values_of(arguments, task, config)
        if arguments.timesteps is not None:
            values |= config_module.steps_alone(config, arguments.timesteps)
        if values:
            text = config_module.with_values(text, values)
            config = config_module.parse(text, "the configuration")
        seed = 0 if arguments.seed is None else arguments.seed
        stamp = time.strftime("%Y%m%d-%H%M%S")
        folder = arguments.run or Path("runs") / f"{task.replace('/', '-')}-seed-{seed}-{stamp}"
        # Checkpoints of an earlier run do not belong to this run.
        run_folder.check(folder, bool(arguments.overwrite))
        policy = _interruptible(task, folder, lambda: _train(config, text, folder, seed, arguments, progress_bar))
    seconds = time.perf_counter() - started
    results = []
    if arguments.episodes > 0:
        with bar("comparing", not progress_bar) as progress:
            trained = task_of(config.env_id)
            results = compare(
                [str(policy), *baselines(trained)], task=trained, episodes=arguments.episodes, progress=progress
            )
    written = None if arguments.no_report else report.after_training(folder, results, not progress_bar)
    record = run_folder.read_record(folder)
    if arguments.json:
        printed = {
            "policy": str(policy),
            "seconds": seconds,
            "timesteps": record.get("timesteps"),
            "success": record.get("success"),
            "required_success": record.get("required_success"),
            "results": [vars(result) for result in results],
            "report": None if written is None else str(written),
        }
        print(json.dumps(printed, indent=2))
    else:
        print(f"trained in {seconds:.0f} s, best policy: {policy}")
        own = registry.find(task_of(config.env_id)) is not None
        print(f"watch it: ballbot view {f'{in_source(config.env_id)} --controller {folder}' if own else folder}")
        if results:
            nominal = {name: value for name, value in config.env.items() if name != "events"}
            print_table(results, task_of(config.env_id), nominal)
        if written is not None:
            print(f"\nreport: {written}")
    failure = run_folder.failure(record)
    if failure is not None:
        raise RuntimeError(f"the training has failed: {failure}")


def _train(
    config: "TrainConfig", text: str, folder: Path, seed: int, arguments: argparse.Namespace, progress_bar: bool
) -> Path:
    """A new run, with the algorithm of its configuration."""
    if config.algorithm == evolution.ALGORITHM:
        if arguments.on is not None:
            raise ValueError(f"--on {arguments.on}: algorithm = {config.algorithm} runs on one machine")
        with bar("evolving", not progress_bar) as progress:
            return evolution.train(
                config, text, folder, seed=seed, overwrite=bool(arguments.overwrite), progress=progress
            )
    with require("training", "train"):
        from ballbot_rs.training import train
    return train.train(
        config,
        text,
        folder,
        seed=seed,
        overwrite=bool(arguments.overwrite),
        progress_bar=progress_bar,
        tell=_tell if progress_bar else lambda _: None,
        learn=_loop(arguments),
    )


def _resume(config: "TrainConfig", folder: Path, arguments: argparse.Namespace, progress_bar: bool) -> Path:
    if config.algorithm == evolution.ALGORITHM:
        raise ValueError(f"{folder}: a run of evolution keeps no checkpoints: begin it again with --overwrite")
    with require("training", "train"):
        from ballbot_rs.training import train
    return train.resume(
        folder, timesteps=arguments.timesteps, progress_bar=progress_bar, tell=_tell, learn=_loop(arguments)
    )


def _loop(arguments: argparse.Namespace) -> "Learn | None":
    """The training loop; None is the loop of Stable-Baselines3."""
    if arguments.on is None:
        for name in ("workers", "ray_address"):
            if getattr(arguments, name) is not None:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} {getattr(arguments, name)} requires --on ray")
        return None
    where = Ray(1 if arguments.workers is None else arguments.workers, arguments.ray_address)
    with require("training on Ray", "rllib"):
        from ballbot_rs.training.on_ray.learn import OnRay
    return OnRay(where)


def values_of(arguments: argparse.Namespace, task: str, config: "TrainConfig") -> dict[str, Any]:
    """Values that override the configuration, by dotted name.

    Args:
        arguments: of the command line.
        task: name of the task.
        config: what they override.
    """
    keys = [field.name for field in dataclasses.fields(config)]
    given = settings.assignments(arguments.set)
    for name, value in given.items():
        if name.startswith("env."):
            raise ValueError(f"--set {name}={value}: omit the prefix env.: options of the environment need none")
    settings.check_names(given, task, keys, parts=_parts(config))
    values = {name: value for name, value in given.items() if name.partition(".")[0] in keys}
    options = {name: value for name, value in given.items() if name not in values}
    options = settings.apply(options, shared.named_options(arguments), config.env)
    return values | {f"env.{name}": value for name, value in options.items()}


def _interruptible(task: str, folder: Path, work: Callable[[], Path]) -> Path:
    """Does the work; if anything ends it early, prints what has been saved and how to continue."""
    try:
        with _interrupts.patient():
            return work()
    except (KeyboardInterrupt, OSError):
        saved = run_folder.checkpoints(folder) or run_folder.checkpoints(folder / run_folder.FIT)
        if saved:
            _tell(f"saved {saved[0]}, to continue: ballbot train {in_source(task)} --resume {folder}")
        raise


def _tell(text: str) -> None:
    print(text, file=sys.stderr)
