"""Section IV: the environment.

The paper wraps its URDFs in a Python class that senses, actuates and sets joint dynamics, and that class in a Gym
environment with `reset()`, `step()`, `render()` and `close()`, for Stable-Baselines3, on PyBullet. The table has what
does the same here. This section runs the environment checkers of Gymnasium and of Stable-Baselines3, and fails with
them.
"""

import warnings

import gymnasium
import numpy as np

import ballbot_rs as bb
from verification.claim import Claim
from verification.page import table
from verification.topic import Comparison, Findings


def run() -> Findings:
    """Checks the environment, and that what the table names is there."""
    warned = checker_warnings()
    claims = [Claim("warnings of the environment checkers", float(warned), 0.0, 0.0, "", absolute=True)]
    modes = bb.BalanceEnv.metadata["render_modes"]
    render = f"`render()`, modes {', '.join(modes)}" if modes else "not there yet: any `render_mode` is refused"
    rows = [
        ["sensing", "`Ballbot.state`, `.contacts`, `.energy`; `BalanceEnv.state`"],
        ["actuating", "`Ballbot.step(wheel_torques)`, `.push(impulse)`"],
        [
            "joint dynamics",
            "`Ballbot.set_joint_dynamics(viscous_friction, coulomb_friction)`, also of the environments",
        ],
        ["`reset()`", "`BalanceEnv.reset(seed=..., options={'state': ...})`"],
        ["`step()`", "`BalanceEnv.step(action)`"],
        ["`render()`", render],
        ["`close()`", "`BalanceEnv.close()`"],
        ["parameters and dynamics", "`Params`, and the arguments of `BalanceEnv`"],
        ["Stable-Baselines3", "`BallbotVecEnv`, all robots stepped at once; or `BalanceEnv` as it is"],
    ]
    for owner, names in (
        (bb.Ballbot, ("state", "contacts", "energy", "step", "push", "set_joint_dynamics")),
        (bb.BalanceEnv, ("reset", "step", "render", "close", "state", "push", "set_joint_dynamics")),
    ):
        for name in names:
            assert hasattr(owner, name), f"{owner.__name__}.{name}"
    compared = Comparison(
        "environment",
        "Section IV, Fig. 8",
        "`reset`, `step`, `render`, `close`, on PyBullet",
        "the same" if modes else "the same but `render`",
        "" if modes else "not written yet",
    )
    return Findings(claims, markdown=table(["paper", "here"], rows, align="---"), compared=(compared,))


def checker_warnings() -> int:
    """How often Gymnasium's and Stable-Baselines3's checkers warn; they raise on errors."""
    from gymnasium.utils.env_checker import check_env as check_for_gymnasium
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_for_gymnasium(gymnasium.make("ballbot/Balance-v0").unwrapped, skip_render_check=True)
        check_for_sb3(bb.BalanceEnv())
        env = bb.BalanceEnv()
        env.reset(seed=0)
        env.step(np.zeros(3, np.float32))
        env.close()
    return len(caught)
