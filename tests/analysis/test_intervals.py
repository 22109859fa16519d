"""Confidence intervals against closed forms."""

import numpy as np
import pytest
from scipy import stats

from ballbot_rs.analysis import intervals


@pytest.mark.parametrize(("successes", "count"), [(0, 10), (3, 10), (100, 100), (173, 200)])
def test_the_interval_of_a_fraction_is_wilsons(successes, count):
    expected = stats.binomtest(successes, count).proportion_ci(method="wilson")
    found = intervals.of_share(successes / count, count)
    np.testing.assert_allclose(found, (expected.low, expected.high), rtol=1e-6, atol=1e-12)


@pytest.mark.slow("many samples")
def test_the_interval_of_a_mean_has_its_nominal_coverage():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(200):
        low, high = intervals.of_mean(rng.exponential(size=100))
        held += low <= 1.0 <= high
    # Binomial of 200 at 0.95, and some less as a bootstrap of skewed values is known to be.
    assert 178 <= held <= 199


def test_equal_values_have_no_spread():
    assert intervals.of_mean(np.full(7, 0.25)) == (0.25, 0.25)
