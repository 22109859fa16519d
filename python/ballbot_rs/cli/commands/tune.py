"""`ballbot tune`: search the hyperparameters of training."""

import argparse
import dataclasses
import json
import multiprocessing
import os
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ballbot_rs import _interrupts
from ballbot_rs._extras import require
from ballbot_rs._modules import import_from_here
from ballbot_rs._text_table import WIDTH
from ballbot_rs.cli.commands import train as train_command
from ballbot_rs.cli.options import arguments as shared
from ballbot_rs.cli.options.numbers import MAX_RUN_SEED, whole
from ballbot_rs.envs.own.source import in_source
from ballbot_rs.envs.registration import DEFAULT_TASK, name_of

if TYPE_CHECKING:
    from ballbot_rs.training.search import Search

MAX_TRIALS = 1_000_000

#: Number of best trials printed.
SHOWN = 5


#: For the help: command lines and what they do.
EXAMPLES: Final = (
    ("tune balance --trials 50 --jobs 2", "search the rates, batches and discounts of PPO"),
    (
        "tune velocity --search algorithm_arguments.learning_rate=1e-5:1e-3:log --timesteps 1e5",
        "search one of them in short trainings",
    ),
)


def add_to(commands: Any) -> None:
    """Adds the command to the parser."""
    command = commands.add_parser("tune", help="search the hyperparameters of a training", examples=EXAMPLES)
    shared.add_task(command)
    shared.add_robot(
        command,
        otherwise="the configuration's, else",
        others=", or a key of the configuration, as evaluation.episodes=200",
        keys=train_command.keys,
    )
    shared.add_events(command)
    shared.add_seed(command, "seed of every trial (default 0)", 0, MAX_RUN_SEED)
    command.add_argument("--config", type=Path, help="TOML file to start from instead of the task's own")
    command.add_argument(
        "--timesteps",
        type=whole(1, train_command.MAX_TIMESTEPS),
        help="steps of a trial instead of the configuration's",
    )
    command.add_argument(
        "--trials", type=whole(1, MAX_TRIALS), default=20, help="total trials, earlier calls included (default 20)"
    )
    command.add_argument(
        "--jobs", type=whole(1, 1024), default=1, help="trials at once, each a process with one thread (default 1)"
    )
    command.add_argument(
        "--study", type=Path, help="folder of the search; an existing search continues (default runs/tune-TASK)"
    )
    command.add_argument(
        "--search",
        action="append",
        default=[],
        metavar="NAME=RANGE",
        help="a key of the configuration and its range: LOW:HIGH, LOW:HIGH:log or [A, B]; repeat for more "
        "(default: rates, steps, batches, discounts and noise of PPO)",
    )
    shared.add_verbosity(command, "the result")
    command.set_defaults(carry_out=run)


def run(arguments: argparse.Namespace) -> None:
    """Carries the command out."""
    with require("the search", "train", "tune"):
        from ballbot_rs.training import search as search_module
    task = arguments.task or DEFAULT_TASK
    search = _search(arguments, task, search_module)
    tell = _silent if arguments.quiet or arguments.json else _tell
    started = time.perf_counter()
    try:
        with _interrupts.patient():
            _carry_out(search, arguments.jobs, tell, in_source(task))
    except (KeyboardInterrupt, OSError):
        _tell(f"to continue, give the same command again: {search.folder} has the trials that have ended")
        raise
    best = search.finish()
    config = search.folder / search_module.BEST
    if arguments.json:
        shown = [{"number": trial.number, "return": trial.value, "values": trial.params} for trial in best]
        print(json.dumps({"config": str(config), "trials": shown}, indent=2))
        return
    print(f"{len(best)} of {arguments.trials} trials ran to their end, in {time.perf_counter() - started:.0f} s")
    for trial in best[:SHOWN]:
        values = ", ".join(f"{name.rpartition('.')[2]} {_short(value)}" for name, value in trial.params.items())
        line = f"trial {trial.number:4}  return {trial.value:10.1f}  {values}"
        print(textwrap.fill(line, WIDTH, subsequent_indent=" " * 32, break_on_hyphens=False))
    print(f"train with the best: ballbot train {in_source(task)} --config {config}")


def _search(arguments: argparse.Namespace, task: str, module: Any) -> "Search":
    from ballbot_rs.training import config as config_module

    config, text = config_module.load(task, arguments.config, arguments.robot)
    values = train_command.values_of(arguments, task, config)
    if arguments.timesteps is not None:
        values["total_timesteps"] = arguments.timesteps
    if arguments.jobs > 1:
        values.setdefault("num_threads", 1)
    text = config_module.with_values(text, values)
    given = {}
    for one in arguments.search:
        name, equals, space = one.partition("=")
        if not equals or not name:
            raise ValueError(f"--search {one}: expected NAME=RANGE")
        given[name] = space
    if not given and config_module.parse(text, "the configuration").algorithm != "PPO":
        raise ValueError("the default search is for PPO: give the keys to search with --search")
    chosen = given or module.DEFAULT_SPACE
    space = {name: module.dimension_of(name, range_) for name, range_ in chosen.items()}
    folder = arguments.study or Path("runs") / f"tune-{task.replace('/', '-')}"
    found: Search = module.Search(text, space, folder, arguments.trials, arguments.seed)
    found.study()
    return found


def _carry_out(search: "Search", jobs: int, tell: Any, task: str) -> None:
    if jobs == 1:
        search.work(tell)
        return
    context = multiprocessing.get_context("spawn")
    each = [(dataclasses.replace(search, worker=i), tell, task) for i in range(jobs)]
    workers = [context.Process(target=_work, args=arguments) for arguments in each]
    for worker in workers:
        worker.start()
    try:
        for worker in workers:
            worker.join()
    finally:
        for worker in workers:
            worker.terminate()
            worker.join()
    failed = [worker.exitcode for worker in workers if worker.exitcode]
    if failed:
        raise RuntimeError(f"{len(failed)} of {jobs} processes ended with exit code {failed[0]}, as printed above")


def _work(search: "Search", tell: Any, task: str) -> None:
    _interrupts.install()
    _interrupts.be_quiet()
    # A task in Python is registered in this process, too.
    import_from_here()
    name_of(task)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    search.work(tell)


def _end_with_parent() -> None:
    """Ends this process if its parent was killed: then the parent has not ended it."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _silent(text: str) -> None:
    pass
