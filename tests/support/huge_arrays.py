"""Calls everything with arrays that are small in memory and huge in shape: `python -m tests.support.huge_arrays`.

The memory of this process is limited. A call may succeed, or fail with an exception and a message; it must not end the
process, panic or hang.
"""

import faulthandler
import resource
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import ballbot_rs as bb
from tests.support import surface

#: Memory that the process may use in addition to its present memory, bytes.
MEMORY = 1 << 30
#: A call that takes longer counts as hanging, s.
DEADLINE = 60
#: Words in a message that indicate a bug of ours.
OURS = ("internal error", "panic", "unreachable", "borrowed")


def field() -> np.ndarray:
    """Numbers that are neither contiguous nor aligned."""
    records = np.zeros(3, dtype=[("flag", "u1"), ("number", "f8")])
    records["number"] = [0.1, 0.2, 0.3]
    return records["number"]


#: Arrays by their defect.
ODD: dict[str, Callable[[], Any]] = {
    **{
        f"shape {shape}": lambda shape=shape: np.broadcast_to(0.0, shape)
        for shape in [10**12, (10**10, 2), (10**10, 3), (10**10, 32), (10**6, 10**6), (10**10, 2, 3), (2, 10**10)]
    },
    "bools": lambda: np.broadcast_to(True, 10**12),
    "whole": lambda: np.broadcast_to(1, 10**12),
    "half": lambda: np.broadcast_to(np.float16(0.5), (10**10, 3)),
    "objects": lambda: np.broadcast_to(None, 10**12),
    "texts": lambda: np.broadcast_to("states", 10**12),
    "backwards": lambda: np.broadcast_to(0.0, (10**10, 3))[::-1],
    "range": lambda: range(10**12),
    "empty": lambda: np.broadcast_to(0.0, (0, 10**12)),
    "of nothing": lambda: np.broadcast_to(0.0, (10**12, 0)),
    "reversed": lambda: np.arange(3.0)[::-1],
    "columns": lambda: np.zeros((3, 2), order="F"),
    "masked": lambda: np.ma.masked_array(np.zeros(3), mask=[True, False, False]),
    "field": field,
}

#: Arguments inside others.
NESTED: dict[str, Callable[[Any], Any]] = {
    "actuators.strength": lambda odd: bb.BalanceEnv(actuators={"strength": odd}),
    "sensors.gyro_noise": lambda odd: bb.BalanceEnv(sensors={"gyro_noise": odd}),
    "scan.points": lambda odd: bb.BalanceEnv(scan={"points": odd}),
    "depth.size": lambda odd: bb.BalanceEnv(depth={"size": odd}),
    "lidar.position": lambda odd: bb.BalanceEnv(lidar={"position": odd}),
    "reward.alive": lambda odd: bb.BalanceEnv(reward={"alive": odd}),
    "events.range": lambda odd: bb.BalanceEnv(events=[{"term": "gravity", "range": odd}]),
    "terrain.cell": lambda odd: bb.BalanceEnv(terrain={"kind": "wave", "cell": odd}),
    "camera.target": lambda odd: bb.Renderer(camera={"target": odd}),
    "setpoints.position": lambda odd: surface._batch().control(bb.Lqr(), {"position": odd}),
    "setpoint.position": lambda odd: bb.Lqr()(bb.State([0, 0, 1]), {"position": odd}),
    "the heights of a function": lambda odd: bb.Terrain.from_function(lambda _x, _y: odd, (1.0, 1.0), 0.1),
    "the states of a motion": lambda odd: surface._batch().step_with(np.zeros((2, 3)), lambda _states, _pushes: odd),
}


def calls() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Calls by name: each argument of everything is odd once, the other required arguments are valid."""
    alike = {f"{surface.class_name(task)}Env" for task in bb._core.TASKS} - {"BalanceEnv"} | {"BallbotEnv"}
    for target in surface.targets():
        if target.name.partition(".")[0] in alike:
            continue
        for name, _ in target.arguments:
            for kind, make in ODD.items():

                def call(target: surface.Target = target, name: str = name, make: Callable[[], Any] = make) -> Any:
                    given = {other: target.right(other)[0] for other, needed in target.arguments if needed}
                    instance = (target.instances[-1](),) if target.instances else ()
                    return target.function(*instance, **{**given, name: make()})

                yield f"{target.name}({name}: {kind})", call
    for name, nested in NESTED.items():
        for kind, make in ODD.items():
            yield f"{name}: {kind}", lambda nested=nested, make=make: nested(make())


def complaint(call: Callable[[], Any]) -> str | None:
    """What is wrong with the result of a call."""
    faulthandler.dump_traceback_later(DEADLINE, exit=True)
    try:
        call()
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        # Python's own memory error has no message.
        silent = not str(error) and type(error) is not MemoryError
        return message if silent or any(word in message.lower() for word in OURS) else None
    except BaseException as error:
        # A panic is not an Exception.
        return f"{type(error).__name__}: {error}"
    finally:
        faulthandler.cancel_dump_traceback_later()
    return None


def main() -> int:
    """Calls everything; 1 if something is wrong. The current call is in the file given as argument."""
    status = Path("/proc/self/statm").read_text(encoding="ascii")
    limit = int(status.split()[0]) * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    warnings.simplefilter("ignore")
    found = 0
    with Path(sys.argv[1]).open("w", encoding="utf-8") as log:
        for name, call in calls():
            # If the process ends, this is the last line.
            log.write(f"{name}\n")
            log.flush()
            output = complaint(call)
            if output is not None:
                print(f"{name}: {output}", flush=True)
                found += 1
    return min(found, 1)


if __name__ == "__main__":
    faulthandler.enable()
    sys.exit(main())
