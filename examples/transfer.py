"""A trained policy in untrained conditions: other models and engines, other robots, less friction, delayed motors.

Events change the robot, not the controllers: LQR and the torque of an action remain designed for the nominal robot.
"""

import importlib.util
import sys
from pathlib import Path

import ballbot_rs as bb

policy = Path(__file__).parents[1] / "assets" / "policies" / "balance.onnx"
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 50


def scaled(term, share):
    """Every robot with a nominal parameter scaled by a factor."""
    return {"events": [{"term": term, "op": "scale", "mode": "startup", "range": [share, share]}]}


places = {model: {"model": model} for model in ("contact", "rigid", "spatial")}
places |= {f"friction x {share}": scaled("wheel_dynamic_friction", share) for share in (0.5, 0.3, 0.2)}
places |= {f"delay {1000 * delay:g} ms": {"actuators": {"delay": delay}} for delay in (0.01, 0.03, 0.05)}
places |= {"body 20 % heavier": scaled("body_mass", 1.2)}
places |= {"sensors of kugle": {"sensors": "kugle", "observation": "sensors"}}
for place, options in places.items():
    results = bb.compare([policy, "lqr"], episodes=episodes, **options)
    print(f"{place:<18} policy {results[0].success_rate:4.0%}  lqr {results[1].success_rate:4.0%}")
if importlib.util.find_spec("mujoco"):
    (result,) = bb.compare([policy], episodes=min(episodes, 20), engine="mujoco")
    print(f"{'MuJoCo':<18} policy {result.success_rate:4.0%}")
