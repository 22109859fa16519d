"""Batches whose motion JAX differentiates."""

from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.experimental import io_callback

from ballbot_rs._core import Batch
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs.optimal.differentiable import DifferentiableRobots


@named
class DifferentiableJaxBatch(DifferentiableRobots[jax.Array]):
    """Robots of a batch whose states JAX differentiates: `DifferentiableBatch`, for another library.

    For training policies with gradients through the simulation::

    ```python
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    robots = bb.DifferentiableJaxBatch(bb.Batch(4))
    states = robots.reset([0, 1, 2, 3])
    print(jax.grad(lambda torques: robots.step(states, torques)[0][:, 0].sum())(jnp.zeros((4, 3))))
    ```

    The gradient of a policy's cost over 32 steps, compiled::

        jax.config.update("jax_enable_x64", True)
        robots = DifferentiableJaxBatch(Batch(64))

        @jax.jit
        @jax.grad
        def gradient(parameters, states):
            def move(states, _):
                states, ended = robots.step(states, policy(parameters, states))
                return states, jnp.where(ended, 0.0, cost(states)).sum()

            return jax.lax.scan(move, states, length=32)[1].sum()

        gradient(parameters, robots.reset(seeds))

    Derivatives are forward- or reverse-mode, first-order only: higher orders take a step's Jacobian as constant. A
    compiled step calls back into Python, in order; what it rejects is an error of JAX with the same message. `reset`
    and `states` belong outside compiled functions. `jax.vmap` and `jax.checkpoint` of a step are errors, because the
    robots cannot repeat it: for more robots, make a larger batch. `jax.jacfwd`, `jax.jacrev` and `jax.vmap` of
    cotangents map only the derivatives, and work.

    Args:
        batch: as in `DifferentiableBatch`.

    Raises:
        ValueError: another batch, or later an array while JAX has no float64.
    """

    _library = jnp

    def __init__(self, batch: Batch) -> None:
        super().__init__(batch)
        n, width = batch.num_envs, self.width
        shapes = (n, width), (n,), (n, width, width), (n, width, 3)
        found = [jax.ShapeDtypeStruct(shape, bool if len(shape) == 1 else float) for shape in shapes]
        self._compiled = custom_vmap(lambda *values: io_callback(self._advance, found, *values, ordered=True))
        self._compiled.def_vmap(_not_mapped)

    def _tensor(self, numbers: Any) -> jax.Array:
        if not jax.config.jax_enable_x64:
            raise InvalidInputError(
                "states are float64: enable them first, with jax.config.update('jax_enable_x64', True)"
            )
        return jnp.asarray(numbers, dtype=jnp.float64)

    def _linked(self, states: jax.Array, torques: jax.Array) -> tuple[jax.Array, jax.Array]:
        self._check_shapes(states.shape, torques.shape)
        values = jax.lax.stop_gradient((states, torques))
        if any(isinstance(value, jax.core.Tracer) for value in values):
            found = self._compiled(*values)
        else:
            found = map(jnp.asarray, self._advance(*values))
        after, ended, *matrices = found
        return _step(states, torques, after, *matrices), ended


def _not_mapped(size: int, *_: Any) -> Any:
    raise InvalidInputError(
        f"jax.vmap of DifferentiableJaxBatch.step over {size} arrays: a step moves the robots only once; make a Batch "
        "of as many robots, which one step moves together"
    )


def _after(
    _states: jax.Array, _torques: jax.Array, after: jax.Array, _by_states: jax.Array, _by_torques: jax.Array
) -> jax.Array:
    return after


def _change(primals: tuple[jax.Array, ...], tangents: tuple[jax.Array, ...]) -> tuple[jax.Array, jax.Array]:
    _, _, after, by_states, by_torques = primals
    by_both, change = jnp.concatenate([by_states, by_torques], 2), jnp.concatenate(tangents[:2], 1)
    return after, (by_both @ change[..., None])[..., 0]


#: States with known derivatives by the states and torques before.
_step = jax.custom_jvp(_after)
_step.defjvp(_change)
