"""Steps per second: the engine by itself, and the balance task through a `VecEnv`."""

from typing import Any

from validation.benchmarks import simulators
from validation.benchmarks.ours import known_models
from validation.benchmarks.timing import interleave
from validation.benchmarks.worker import cores, in_child
from validation.engines.installed import missing

#: Other simulators by name, the package that each needs, and whether one process steps all of its robots.
EXTERNAL = {
    "mujoco-batch": ("mujoco.batch", True),
    "mujoco-dummy": ("mujoco", True),
    "pybullet-dummy": ("pybullet", True),
    "mujoco-subproc": ("mujoco", False),
    "pybullet-subproc": ("pybullet", False),
}
#: These step all robots in one call; the others step one by one, and more robots only take longer to make.
_BATCHED = "mujoco-batch"


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of simulator, quantity ("environment" or "physics"), threads, robots, and rate or reason of absence."""
    models = [f"ours:{model}" for model in known_models()]
    rows: list[dict[str, Any]] = []
    installed = []
    for name, (package, _) in EXTERNAL.items():
        if reason := missing(package):
            rows.append({"simulator": name, "reason": reason})
        else:
            installed.append(name)
    everything = {"rounds": 3 if quick else 11, "seconds": 0.15 if quick else 0.5}
    for threads in sorted({1, len(cores())}):
        # Separate processes do not help on one core, and a single process cannot use many.
        fitting = [name for name in installed if name == _BATCHED or EXTERNAL[name][1] == (threads == 1)]
        raw = [name for name in fitting if name == _BATCHED or (name == "pybullet-dummy" and threads == 1)]
        for quantity, names, sizes in (
            ("environment", models + fitting, (64, 1024)),
            ("physics", models + raw, (1024,)),
        ):
            print(f"throughput: {quantity} steps, {threads} thread(s)", flush=True)
            plan = [
                (name, size) for size in sizes for name in names if size == 64 or name in models or name == _BATCHED
            ]
            if quantity == "physics":
                plan += [(name, 64) for name in names if name == "pybullet-dummy"]
            try:
                rows += in_child(
                    "throughput:measure_here", pinned=threads == 1, quantity=quantity, threads=threads, plan=plan,
                    **everything,
                )  # fmt: skip
            except Exception as error:
                rows += [
                    {"simulator": n, "quantity": quantity, "threads": threads, "reason": str(error)} for n in names
                ]
    return rows


def measure_here(
    quantity: str, threads: int, plan: list[tuple[str, int]], rounds: int, seconds: float
) -> list[dict[str, Any]]:
    """Rows for all simulators of `plan` (name, robots), interleaved in this process."""
    rows: list[dict[str, Any]] = []
    running: dict[str, simulators.Running] = {}
    build = simulators.environment if quantity == "environment" else simulators.physics
    try:
        # Processes are forked from this process, before it has threads.
        for name, num_envs in sorted(plan, key=lambda item: not item[0].endswith("subproc")):
            key = f"{name}/{num_envs}"
            try:
                running[key] = build(name, num_envs, threads)
            except Exception as error:
                rows.append({"simulator": name, "quantity": quantity, "threads": threads, "reason": str(error)})
        rates = interleave({key: running[key].run for key in running}, rounds, seconds)
    finally:
        for one in running.values():
            one.close()
    for key, rate in rates.items():
        name, robots = key.rsplit("/", 1)
        row = {"simulator": name, "quantity": quantity, "threads": threads, "robots": int(robots)}
        rows.append(row | rate.to_dict())
    return rows
