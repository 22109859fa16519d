"""Display names of the simulators, and the rows that represent them."""

from typing import Any

_LABELS = {
    "mujoco-batch": "MuJoCo batch + NumPy VecEnv",
    "mujoco-dummy": "MuJoCo Gymnasium, DummyVecEnv",
    "mujoco-subproc": "MuJoCo Gymnasium, SubprocVecEnv",
    "pybullet-dummy": "PyBullet Gymnasium, DummyVecEnv",
    "pybullet-subproc": "PyBullet Gymnasium, SubprocVecEnv",
    "mujoco": "MuJoCo",
    "pybullet": "PyBullet",
}


def label(simulator: str, quantity: str = "environment") -> str:
    """A simulator's display name; where physics is measured, there is no environment around it."""
    if quantity == "physics" and not simulator.startswith("ours:"):
        return {"mujoco-batch": "MuJoCo batch"}.get(simulator, _LABELS.get(simulator.partition("-")[0], simulator))
    if simulator.startswith("ours:"):
        return f"ballbot-rs, {simulator.removeprefix('ours:')}"
    return _LABELS.get(simulator, simulator)


def measured(rows: list[dict[str, Any]], quantity: str, threads: int) -> list[dict[str, Any]]:
    """Rows of a quantity at a number of threads that have a rate."""
    return [r for r in rows if r.get("quantity") == quantity and r.get("threads") == threads and "median" in r]


def strongest(rows: list[dict[str, Any]], quantity: str, threads: int) -> list[dict[str, Any]]:
    """The best row of each simulator over numbers of robots."""
    best: dict[str, dict[str, Any]] = {}
    for row in measured(rows, quantity, threads):
        name = row["simulator"]
        if name not in best or row["median"] > best[name]["median"]:
            best[name] = row
    return list(best.values())
