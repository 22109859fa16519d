"""Section IV: the environment.

The paper wraps its URDFs in a Python class that senses, actuates and sets joint dynamics, and that class in a Gym
environment with `reset()`, `step()`, `render()` and `close()`, for Stable-Baselines3, on PyBullet. The table has what
does the same here. This section runs the environment checkers of Gymnasium and of Stable-Baselines3 on an environment
that renders, rendering included, and fails with them.
"""

import warnings

import gymnasium
import numpy as np

import ballbot_rs as bb
from validation.claim import Claim
from validation.page import table
from validation.topic import Comparison, Findings

_MODE = "rgb_array"


def run() -> Findings:
    """Checks the environment, and that everything named in the table exists."""
    warned = checker_warnings()
    claims = [Claim("warnings of the environment checkers", float(warned), 0.0, 0.0, "", absolute=True)]
    rows = [
        ["sensing", "`Ballbot.state`, `.contacts`, `.energy`; `BalanceEnv.state`"],
        ["actuating", "`Ballbot.step(wheel_torques)`, `.push(impulse)`"],
        [
            "joint dynamics",
            "`Ballbot.set_params(params.replace(wheel_viscous_friction=...))`, also of the environments",
        ],
        ["`reset()`", "`BalanceEnv.reset(seed=..., options={'state': ...})`"],
        ["`step()`", "`BalanceEnv.step(action)`"],
        ["`render()`", f"`BalanceEnv(render_mode='{_MODE}').render()`"],
        ["`close()`", "`BalanceEnv.close()`"],
        ["parameters and dynamics", "`Params`, and the arguments of `BalanceEnv`"],
        ["Stable-Baselines3", "`BallbotVecEnv`, all robots stepped at once; or `BalanceEnv` as it is"],
    ]
    for owner, names in (
        (bb.Ballbot, ("state", "contacts", "energy", "step", "push", "set_params")),
        (bb.BalanceEnv, ("reset", "step", "render", "close", "state", "push", "set_params")),
    ):
        for name in names:
            assert hasattr(owner, name), f"{owner.__name__}.{name}"
    compared = Comparison(
        "environment",
        "Section IV",
        "`reset`, `step`, `render`, `close`, on PyBullet",
        "the same, with this simulator's contacts",
        "they do not: the table below has what does the same",
    )
    picture = Comparison(
        "the robot in the environment",
        "Section IV, Fig. 8",
        "a picture of PyBullet",
        f"`render_mode='{_MODE}'`",
        "not comparable: a picture, without a number",
    )
    return Findings(claims, markdown=table(["paper", "here"], rows, align="---"), compared=(compared, picture))


def checker_warnings() -> int:
    """How often Gymnasium's and Stable-Baselines3's checkers warn; they raise on errors."""
    from gymnasium.utils.env_checker import check_env as check_for_gymnasium
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_for_gymnasium(gymnasium.make("ballbot/Balance-v0", render_mode=_MODE).unwrapped, skip_render_check=False)
        env = bb.BalanceEnv(render_mode=_MODE)
        check_for_sb3(env, skip_render_check=False)
        env.reset(seed=0)
        env.step(np.zeros(3, np.float32))
        picture = env.render()
        env.close()
    assert isinstance(picture, np.ndarray)
    assert picture.std() > 0.0, "an empty picture"
    return len(caught)
