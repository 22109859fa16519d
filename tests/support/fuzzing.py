"""Strategies for foreign input, and settings that give the same examples every time."""

import pytest

pytest.importorskip("hypothesis", reason="nothing is fuzzed: install 'ballbot-rs[dev]'")

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st


def budget(examples):
    """This number of examples, the same in every run."""
    return settings(
        max_examples=examples, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck)
    )


numbers = st.one_of(
    st.integers(-(2**63), 2**64 - 1),
    st.floats(),
    st.sampled_from([0, 1, -1, 1e-300, 1e300, 1e308, float("nan"), float("inf"), -float("inf"), 0.01, 0.002]),
)
#: Values that msgpack and, with names as keys, JSON can represent.
values = st.recursive(
    st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=20)),
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(st.text(max_size=10), inner, max_size=4)),
    max_leaves=12,
)
