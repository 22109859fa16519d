"""`python -m validation.feature_costs`; docs/performance.md has its tables."""

import pytest

from validation.feature_costs import FEATURES, costs


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_every_feature_is_timed(model):
    rows = costs(model, robots=8, rounds=1)
    assert [name for name, _, _ in rows] == list(FEATURES)
    assert all(float(ratio) > 0.0 and float(nanoseconds) > 0.0 for _, nanoseconds, ratio in rows)
