"""PyTorch and JAX take every array of a batch through DLPack, PyTorch without a copy."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import ballbot_rs as bb

torch = pytest.importorskip("torch")


def arrays(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """All arrays in a result of a method, with the name of each."""
    if isinstance(value, np.ndarray):
        yield name, value
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from arrays(part, f"{name}[{key!r}]")
    elif isinstance(value, tuple):
        for i, part in enumerate(value):
            yield from arrays(part, f"{name}[{i}]")


def of_a_batch() -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of a batch with everything."""
    batch = bb.Batch(
        8, "velocity", terrain="wave", scan={"points": (2, 3)}, sensors={}, observation="sensors", events="mild"
    )
    yield from arrays(batch.reset(), "reset")
    yield from arrays(batch.step(np.zeros((8, 3))), "step")
    for name in ("states", "estimates", "contacts", "readings", "metrics", "running_metrics", "endings", "command"):
        yield from arrays(getattr(batch, name)(), name)
    for name in ("draws", "observations", "privileged_observations"):
        yield from arrays(getattr(batch, name)(), name)
    yield from arrays(batch.perceived("scan"), "perceived")
    yield from arrays(batch.rollout(bb.Lqr(), 3, record=("states", "observations", "rewards", "terminated")), "rollout")


def test_pytorch_takes_every_array_of_a_batch_without_a_copy():
    names = []
    for name, array in of_a_batch():
        tensor = torch.from_dlpack(array)
        assert tensor.data_ptr() == array.__array_interface__["data"][0], name
        assert tuple(tensor.shape) == array.shape, name
        np.testing.assert_array_equal(tensor.numpy(), array, err_msg=name)
        names.append(name)
    assert {"reset", "step[3]", "contacts['wheel_tractions']", "rollout['states']"} <= set(names)


def test_a_tensor_outlives_its_batch():
    batch = bb.Batch(64)
    array = batch.reset()
    tensor, expected = torch.from_dlpack(array), array.copy()
    batch.step(np.zeros((64, 3)))
    del batch, array
    np.testing.assert_array_equal(tensor.numpy(), expected)


def test_actions_are_tensors_of_the_cpu():
    one, other = (bb.Batch(4, seed=1) for _ in range(2))
    one.reset()
    other.reset()
    actions = torch.full((4, 3), 0.1)
    for mine, its in zip(one.step(actions), other.step(actions.numpy()), strict=True):
        np.testing.assert_array_equal(mine, its)


def test_jax_takes_arrays():
    dlpack = pytest.importorskip("jax.dlpack")
    observations = bb.Batch(4).reset()
    np.testing.assert_array_equal(np.asarray(dlpack.from_dlpack(observations)), observations)
