"""How the cost of this simulator grows with robots, with substeps and with threads."""

from typing import Any

from validation.benchmarks import ours, task
from validation.benchmarks.timing import Run, interleave, timed
from validation.benchmarks.worker import cores, in_child
from validation.engines.steps import SIM_DT, SUBSTEPS

#: Robots where something else grows.
MANY = 1024


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of model, axis ("robots", "substeps" or "threads"), robots, substeps, threads and environment steps/s."""
    robots = [4**k for k in range(6 if quick else 8)]
    plans = [
        ("robots", [(n, SUBSTEPS, 1) for n in robots], True),
        ("substeps", [(MANY, s, 1) for s in (1, 2, 5, 10, 20)], True),
        ("threads", [(MANY, SUBSTEPS, t) for t in range(1, len(cores()) + 1)], False),
    ]
    rows: list[dict[str, Any]] = []
    for model in ours.known_models(("contact", "rigid")):
        for axis, points, pinned in plans:
            print(f"scaling: {model}, {axis}", flush=True)
            rows += in_child(
                "scaling:measure_here", pinned=pinned, model=model, axis=axis, points=points, rounds=2 if quick else 3,
                seconds=0.05 if quick else 0.3,
            )  # fmt: skip
    return rows


def measure_here(
    model: str, axis: str, points: list[tuple[int, int, int]], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Rows for the points (robots, substeps, threads), interleaved in this process."""
    runs = {"/".join(map(str, point)): _run(model, *point) for point in points}
    rates = interleave(runs, rounds, seconds)
    rows = []
    for key, rate in rates.items():
        robots, substeps, threads = map(int, key.split("/"))
        row = {"model": model, "axis": axis, "robots": robots, "substeps": substeps, "threads": threads}
        rows.append(row | rate.to_dict())
    return rows


def _run(model: str, robots: int, substeps: int, threads: int) -> Run:
    env = ours.make_env(model, robots, threads, control_dt=substeps * SIM_DT, sim_dt=SIM_DT)
    env.reset()
    action = task.make_actions(1, robots)[0]
    return timed(lambda: env.step(action), robots)
