"""Studies: something that is repeated at the points of a sweep, in parallel, and continued where it was interrupted."""

import contextlib
import itertools
import json
import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any, Final, NoReturn, TypeAlias

import numpy as np

from ballbot_rs._checks import check_count, did_you_mean
from ballbot_rs._core import Params, load_events
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import renamed
from ballbot_rs._machine import threads
from ballbot_rs._progress import Progress
from ballbot_rs._short import number
from ballbot_rs.analysis.checkpoint import Checkpoint
from ballbot_rs.envs.parts import PARAMETER_NAMES, apply

#: Values by name, of which all combinations are points, or a list of points.
Sweep: TypeAlias = Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Any]]

#: Values of a point by name.
Point: TypeAlias = Mapping[str, Any]

#: Numbers by name, in the columns of a table.
Row: TypeAlias = dict[str, Any]

#: The rows of the point of a number, with so many threads; it calls its progress now and then.
Work: TypeAlias = Callable[[int, int | None, Progress], list[Row]]

#: Begins the messages of errors.
FLAG: Final = "sweep"

#: Most points of a study.
MAX_POINTS: Final = 100_000


def points_of(sweep: Sweep) -> list[dict[str, Any]]:
    """The points of a sweep, the last name of a grid varying fastest.

    Raises:
        TypeError: neither names with lists of values nor a list of points.
        ValueError: no values, a value twice, points with different names, or too many points.
    """
    if isinstance(sweep, Mapping):
        axes = [_values(name, values) for name, values in sweep.items()]
        _check_points(math.prod(float(len(axis)) for axis in axes) if axes else 0.0)
        return [dict(zip(sweep, values, strict=True)) for values in itertools.product(*axes)]
    if isinstance(sweep, (str, bytes)) or not isinstance(sweep, Iterable):
        _refuse(sweep)
    points = []
    for point in _limited(sweep):
        if not isinstance(point, Mapping):
            _refuse(point)
        points.append({name: plain(value) for name, value in point.items()})
    _check_points(len(points))
    texts = set()
    for i, point in enumerate(points):
        if point.keys() != points[0].keys() or not point:
            raise InvalidInputError(
                f"{FLAG}: point {i} has {', '.join(point) or 'no names'}, point 0 {', '.join(points[0]) or 'none'}: "
                "every point needs a value for each name"
            )
        text = json.dumps(point, default=repr)
        if text in texts:
            raise InvalidInputError(f"{FLAG} has the point {described(point)} twice")
        texts.add(text)
    return points


def _refuse(given: object) -> NoReturn:
    raise TypeError(f"{FLAG} = {given!r}: expected lists of values by name, or a list of points, each values by name")


def _check_points(count: float) -> None:
    if not count:
        raise InvalidInputError(f"{FLAG} has no points: name values, as {FLAG}={{'body_mass': [2.0, 2.5]}}")
    if count > MAX_POINTS:
        raise InvalidInputError(f"{FLAG} has {count:.0f} points, more than {MAX_POINTS}")


def _limited(values: Iterable[Any]) -> Iterator[Any]:
    """The values, of which there may be more than memory holds, or no end."""
    for i, value in enumerate(values):
        if i == MAX_POINTS:
            raise InvalidInputError(f"{FLAG} has more than {MAX_POINTS} points")
        yield value


def _values(name: str, values: Any) -> list[Any]:
    if isinstance(values, (str, bytes, Mapping, Params)) or not isinstance(values, Iterable):
        raise TypeError(f"{FLAG}['{name}'] = {values!r}: expected a list of values, as [{values!r}]")
    found: list[Any] = []
    seen = set()
    for value in map(plain, _limited(values)):
        key = json.dumps(value, default=repr) if isinstance(value, (list, dict)) else value
        if key in seen:
            raise InvalidInputError(f"{FLAG}['{name}'] has {value!r} twice")
        seen.add(key)
        found.append(value)
    if not found:
        raise InvalidInputError(f"{FLAG}['{name}'] has no values")
    return found


def plain(value: Any) -> Any:
    """A value as JSON has it: numbers of Python, lists, and robots as dicts of their parameters."""
    if isinstance(value, Params):
        return value.to_dict()
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, (tuple, list)):
        return [plain(part) for part in value]
    return {name: plain(part) for name, part in value.items()} if isinstance(value, Mapping) else value


def described(point: Point) -> str:
    """A point in words."""
    return ", ".join(f"{name} = {number(value)}" for name, value in point.items())


def numbered(names: Sequence[str]) -> list[str]:
    """Names of controllers, of which the second "lqr" is "lqr-2"."""
    return [f"{name}-{names[:i].count(name) + 1}" if name in names[:i] else name for i, name in enumerate(names)]


def full_names(names: Iterable[str], options: Sequence[str]) -> dict[str, str]:
    """The option, or its part, of each name of a sweep: a parameter of the robot needs no `robot.` before it.

    Args:
        names: of the sweep; "robot" is the whole robot.
        options: names of the options that are known.

    Raises:
        ValueError: an unknown name, or two names of one option.
    """
    known = (*options, *PARAMETER_NAMES)
    found: dict[str, str] = {}
    for name in names:
        head = name.partition(".")[0] if isinstance(name, str) else name
        if head not in known:
            close = renamed(head, known) or did_you_mean(str(name), known) or f": expected one of {', '.join(known)}"
            raise InvalidInputError(f"{FLAG}: unknown option '{name}'{close}")
        full = name if head in options else f"robot.{name}"
        same = next((other for other, its in found.items() if its == full), None)
        if same is not None:
            raise InvalidInputError(f"{FLAG} has '{same}' and '{name}', which are the same option")
        found[name] = full
    return found


def options_at(
    point: Point, names: Mapping[str, str], given: Mapping[str, Any], base: Mapping[str, Any]
) -> dict[str, Any]:
    """The options of the environment at a point.

    Args:
        point: its values; the value of "events.TERM" is a number, or the range that it is sampled from, of the events
            of that term, or of a new event.
        names: as `full_names` returns them.
        given: options that are the same at all points.
        base: options that `given` overrides.
    """
    values = {names[name]: value for name, value in point.items()}
    drawn = {name: values.pop(name) for name in list(values) if name.startswith("events.")}
    options = apply(values, given, base, FLAG)
    if drawn:
        events = options.get("events", base.get("events")) or []
        events = load_events(events) if isinstance(events, str) else list(events)
        for name, value in drawn.items():
            term, ends = name.partition(".")[2], value if isinstance(value, list) else [value, value]
            # An event of the term keeps its mode and operation.
            known = any(one.get("term") == term for one in events)
            events = [{**one, "range": ends} if one.get("term") == term else one for one in events]
            events += [] if known else [{"term": term, "range": ends}]
        options["events"] = events
    return options


@contextlib.contextmanager
def at(point: Point) -> Iterator[None]:
    """A context in which an error of input names the point."""
    try:
        yield
    except (ValueError, TypeError) as error:
        text = f"{FLAG} at {described(point)}: {str(error).removeprefix(FLAG).lstrip()}"
        raise (TypeError if isinstance(error, TypeError) else InvalidInputError)(text) from error


class _Stopped(Exception):
    """Another point failed, or Ctrl-C was pressed."""


def run_points(
    points: Sequence[Point],
    work: Work,
    *,
    num_threads: int | None,
    is_parallel: bool,
    checkpoint: Checkpoint | None,
    progress: Progress,
) -> list[Row]:
    """The rows of all points, in their order; the same for any number of threads.

    Args:
        points: of the sweep.
        work: makes the rows of a point.
        num_threads: points that run at once; None is the number of cores.
        is_parallel: whether several points may run at once. Otherwise one after the other has all threads.
        checkpoint: has the rows of points that are done, and takes others.
        progress: called with the number of points done and their total.
    """
    workers = (threads() or 1) if num_threads is None else check_count("num_threads", num_threads)
    done: dict[int, list[Row]] = {} if checkpoint is None else checkpoint.read()
    missing = [i for i in range(len(points)) if i not in done]
    workers = min(workers, len(missing)) if is_parallel else 1
    progress(len(done), len(points))
    try:
        for i, rows in _worked(missing, work, workers, num_threads):
            done[i] = rows
            if checkpoint is not None:
                checkpoint.add(i, rows)
            progress(len(done), len(points))
    finally:
        if checkpoint is not None:
            checkpoint.write()
    # A column that is a name of the sweep has its values.
    return [{**point, **row, **point} for i, point in enumerate(points) for row in done[i]]


def _worked(
    missing: Sequence[int], work: Work, workers: int, num_threads: int | None
) -> Iterator[tuple[int, list[Row]]]:
    stopped = threading.Event()

    def stop_if_told(_done: int, _total: int) -> None:
        if stopped.is_set():
            raise _Stopped

    if workers <= 1:
        for i in missing:
            yield i, work(i, num_threads, stop_if_told)
        return
    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(work, i, 1, stop_if_told): i for i in missing}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            # Points that have begun end at their next report.
            stopped.set()
            pool.shutdown(wait=True, cancel_futures=True)
