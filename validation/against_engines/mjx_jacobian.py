"""Derivatives of a step of MuJoCo XLA by forward differentiation, in double precision."""

from collections.abc import Callable
from typing import Any

import jax
import mujoco
import numpy as np
from mujoco import mjx

from ballbot_rs.engines.mujoco_robot import BODY_QUATERNION
from ballbot_rs.engines.robot_geometry import Array


def differentiator() -> Callable[[mujoco.MjModel, mujoco.MjData], Array]:
    """A function of robots that differ in numbers alone, compiled once; derivatives as in `differentiated`."""

    def after(model: Any, data: Any, turn: Any, velocities: Any, torques: Any) -> Any:
        w, x, y, z = data.qpos[BODY_QUATERNION]
        a, b, c = 0.5 * turn
        change = (-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a)
        turned = data.qpos.at[BODY_QUATERNION].add(jax.numpy.stack(change))
        return mjx.step(model, data.replace(qpos=turned, qvel=velocities, ctrl=torques)).qvel

    compiled = jax.jit(jax.jacfwd(after, (2, 3, 4)))

    def differentiate(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        with jax.enable_x64(True):
            state = mjx.put_data(model, data)
            parts = compiled(mjx.put_model(model), state, jax.numpy.zeros(3), state.qvel, state.ctrl)
            return np.concatenate([np.asarray(part) for part in parts], axis=1)

    return differentiate
