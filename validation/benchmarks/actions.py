"""Cost of larger actions: the balance task at increasing torques, and with all robots fallen."""

from typing import Any

from validation.benchmarks import fallen, simulators, task
from validation.benchmarks.ours import WANTED, known_models
from validation.benchmarks.throughput import EXTERNAL
from validation.benchmarks.timing import interleave
from validation.benchmarks.worker import in_child
from validation.engines.installed import missing

#: Largest torque of the sampled actions, N·m: half of the least at which a wheel of the upright robot slips, and more.
TORQUES = (task.HEADLINE_TORQUE, 0.3, 0.6, 1.0)
#: The peers that one process steps, and the number of robots of each; a robot of PyBullet takes 35 MiB.
_PEERS = {"mujoco-batch": 256, "mujoco-dummy": 8, "pybullet-dummy": 8}
_OURS = 256


def measure(quick: bool) -> list[dict[str, Any]]:
    """Rows of simulator, case ("driven" or "fallen"), torque, robots, falls, and rate or reason of absence."""
    rows: list[dict[str, Any]] = []
    plan = [(f"ours:{model}", _OURS) for model in known_models((*WANTED, "planar"))]
    for name, robots in _PEERS.items():
        if reason := missing(EXTERNAL[name][0]):
            rows.append({"simulator": name, "reason": reason})
        else:
            plan.append((name, robots))
    print(f"actions: up to {', '.join(map(str, TORQUES))} N·m, one core", flush=True)
    try:
        rows += in_child(
            "actions:measure_here", pinned=True, plan=plan, rounds=3 if quick else 11, seconds=0.15 if quick else 0.5
        )
    except Exception as error:
        rows += [{"simulator": name, "reason": str(error)} for name, _ in plan]
    return rows


def measure_here(plan: list[tuple[str, int]], rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Rows for all simulators of `plan` (name, robots) at all torques, interleaved in this process."""
    rows: list[dict[str, Any]] = []
    running: list[tuple[dict[str, Any], simulators.Running]] = []
    try:
        for name, robots in plan:
            cases = [("driven", torque) for torque in TORQUES]
            # On the floor this model leaves its fast path.
            cases += [("fallen", task.MAX_TORQUE)] if name == f"ours:{fallen.MODEL}" else []
            for case, torque in cases:
                row = {"simulator": name, "case": case, "torque": torque, "robots": robots}
                row["headline"] = case == "driven" and torque == task.HEADLINE_TORQUE
                try:
                    if case == "fallen":
                        one = fallen.thrashing(robots)
                    else:
                        one = simulators.environment(name, robots, 1, torque=torque, settling=settling(robots))
                    running.append((row, one))
                except Exception as error:
                    rows.append(row | {"reason": str(error)})
        rates = interleave({str(i): one.run for i, (_, one) in enumerate(running)}, rounds, seconds)
        for i, (row, one) in enumerate(running):
            rows.append(row | one.found() | rates[str(i)].to_dict())
    finally:
        for _, one in running:
            one.close()
    return rows


def settling(robots: int) -> int:
    """Control steps before the first round: falls reach equilibrium with starts, and few robots have time to fall."""
    return max(100, 6400 // robots)
