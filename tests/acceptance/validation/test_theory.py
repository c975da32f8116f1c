"""The closed forms of the checks, compared with the package and with plain arithmetic."""

import numpy as np
import pytest

from saf_gen.acceptance.validation.theory import count_variance_by_law, window_autocovariance_by_law
from saf_gen.camera.counting_law import count_probabilities, count_variance

MEANS = np.array([0.01, 0.5, 1.0, 7.25, 40.0, 613.0])


@pytest.mark.parametrize("per_spike", [1e-4, 1e-3, 0.02])
def test_the_variance_of_counts_is_that_of_the_package_and_of_the_probabilities(per_spike):
    found = count_variance_by_law(MEANS, MEANS * per_spike)
    np.testing.assert_allclose(found, count_variance(MEANS, MEANS * per_spike), rtol=1e-9, atol=1e-12)
    for mean, variance in zip(MEANS.tolist(), found.tolist(), strict=True):
        numbers, probabilities = count_probabilities(mean, mean * per_spike)
        assert variance == pytest.approx(float((probabilities * (numbers - mean) ** 2).sum()), rel=1e-6)


def test_covariances_of_windows_add_up_to_the_variance_of_the_long_window():
    """Var of 50 windows together is Σ (50 − |j|)·γ(j) over all lags j."""
    lags, per_spike = np.arange(50), 1e-3
    covariance = window_autocovariance_by_law(40, lags, rate=0.2, per_spike=per_spike)
    total = float((np.where(lags == 0, 1, 2) * (50 - lags) * covariance).sum())
    assert total == pytest.approx(float(count_variance(400.0, 400.0 * per_spike)), rel=1e-9)
