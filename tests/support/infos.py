"""Comparisons of infos."""

import numpy as np


def assert_same_infos(found, expected):
    """Infos of vector environments: the same keys, values and types, masks included.

    Gymnasium's own `final_obs` is an array of objects, None where no episode ended.
    """
    assert found.keys() == expected.keys()
    for key, ours in found.items():
        theirs = expected[key]
        if isinstance(ours, dict):
            assert_same_infos(ours, theirs)
        elif key == "final_obs" and theirs.dtype == object:
            for mine, other in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(mine, 0.0 if other is None else other)
        else:
            np.testing.assert_array_equal(ours, theirs, err_msg=key, strict=True)


def structure(info):
    """Properties that clients expect to stay the same between steps: keys, types and shapes."""
    return {
        key: structure(value) if isinstance(value, dict) else (type(value), value.dtype, value.shape)
        for key, value in info.items()
    }
