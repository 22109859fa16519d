"""Cost of a control step with payloads, obstacles and the like: `python -m validation.feature_costs [ROBOTS [ROUNDS]]`.

Prints the time of a control step of each robot under `lqr`, five model steps, on one thread, and its ratio to a bare
robot: the median over rounds, in each of which both are timed.
"""

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

import ballbot_rs as bb
from validation.page import table

#: Control steps that are timed together.
STEPS: Final = 20

PAPER: Final = bb.Params.paper()
LOADED: Final = PAPER.with_payload(0.5, position=(0.0, 0.0, 0.3), stiffness=120.0, damping=1.0)
TWO: Final = LOADED.with_payload(0.1, position=(0.1, 0.0, 0.2), stiffness=30.0, damping=0.3, payload=1)
POST: Final = {"kind": "post", "radius": 0.05, "height": 0.12}
#: From a post to the center of the ball, m.
GAP: Final = PAPER.ball_radius + 0.05 + 0.01


def _among(*places: tuple[float, float]) -> bb.Terrain:
    """A level floor with posts."""
    return bb.Terrain.plane(0.0).with_obstacles([{**POST, "x": x, "y": y} for x, y in places])


#: Options of environments.
FEATURES: Final[Mapping[str, Mapping[str, Any]]] = {
    "a payload": {"robot": LOADED},
    "two payloads": {"robot": TWO},
    "an external force": {},
    "a level terrain": {"terrain": bb.Terrain.plane(0.0)},
    "posts, none within 1 m": {"terrain": _among((1.5, 0.0), (-1.5, 0.0), (0.0, 1.5), (0.0, -1.5))},
    "posts 1 cm from the ball": {"terrain": _among(*((x, 0.0) for x in (-GAP, GAP)))},
    "patches of friction": {"robot": PAPER.replace(floor_patch_size=0.2, floor_patch_friction=(0.8, 1.2))},
    "a ship": {"robot": PAPER.replace(floor_tilt_amplitude=(0.02, 0.0))},
    "a tram": {"robot": PAPER.replace(floor_acceleration=(0.1, 0.0))},
    "preload": {"robot": PAPER.replace(wheel_preload=20.0)},
    "inclined rollers": {"robot": PAPER.replace(roller_angle=0.785)},
}


def _stepper(name: str | None, model: str, robots: int) -> Callable[[], None]:
    """What steps robots with a feature; None is without any."""
    options = {} if name is None else dict(FEATURES[name])
    batch = bb.Batch(robots, model=model, num_threads=1, seed=0, **options)
    batch.reset()
    law = bb.Controller("lqr", batch.params(0), batch.control_dt)

    def step() -> None:
        if name == "an external force":
            for i in range(robots):
                batch.apply_force(i, (0.2, 0.0, 0.0))
        batch.rollout(law, STEPS, record=())

    return step


def _seconds(step: Callable[[], None]) -> float:
    began = time.perf_counter()
    step()
    return time.perf_counter() - began


def costs(model: str, robots: int, rounds: int) -> list[list[str]]:
    """Rows: feature, nanoseconds of a control step of a robot, ratio to a bare robot."""
    per_step = 1e9 / (STEPS * robots)
    bare = _stepper(None, model, robots)
    rows = []
    for name in FEATURES:
        featured = _stepper(name, model, robots)
        pairs = np.array([(_seconds(bare), _seconds(featured)) for _ in range(rounds + 1)])[1:]
        ratio = float(np.median(pairs[:, 1] / pairs[:, 0]))
        rows.append([name, f"{per_step * np.median(pairs[:, 1]):.0f}", f"{ratio:.2f}"])
    return rows


def main(robots: int = 256, rounds: int = 31) -> None:
    """Prints a table for `contact` and, with fewer robots, for `rigid`."""
    for model, count in (("contact", robots), ("rigid", max(1, robots // 32))):
        print(table([f"`{model}` with", "ns", "of a bare robot"], costs(model, count, rounds)))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
