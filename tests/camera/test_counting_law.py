"""Counts and intervals of the encoder, compared with their exact law, saf_gen/camera/counting_law.py."""

import numpy as np
import pytest
from scipy import stats

from saf_gen.camera import Encoder, get_sensor
from saf_gen.camera.counting_law import (
    count_chi_squared,
    count_deviations,
    count_oscillation,
    count_probabilities,
    count_variance,
)

THETA, THRESHOLD_NOISE = 400.0, 0.03
PER_SPIKE = 1 / THETA + THRESHOLD_NOISE**2  # relative variance of a threshold
EVEN = 1.5  # noise, in units of the phase, that leaves 10⁻¹⁹ of any unevenness of the phase
BEFORE = 8 * int(2 * EVEN**2 / PER_SPIKE / 8)  # readouts at half a threshold each
FAR = stats.norm.isf(0.5e-4)  # standard deviations, at a two-sided significance of 1e-4
RATES = [0.05, 0.13, 0.29, 0.43, 0.61, 0.77]
MEANS = [0.3, 1.0, 2.5, 3.3, 7.5, 20.5]


def spikes(charge, *, frames, seed, before=0):
    """Return spikes (pixel, frame) of 40,000 pixels that all collect this charge, without fixed pattern or dark charge.

    They are preceded by ``before`` readouts of half a threshold each, so that noise spreads the phase evenly.
    """
    noise = dict.fromkeys(("dark", "response", "threshold_spread", "dust"), False)
    sensor = get_sensor(
        "vidar_400x250", reset_loss=0, threshold_e=THETA, threshold_noise_rms=THRESHOLD_NOISE, noise=noise
    )
    gain = np.repeat([THETA / 2, charge], [before, frames])[:, None]
    packed = Encoder(sensor, (200, 200), seed=seed).encode(
        np.ones((1, 1, 200, 200), np.float32), index=np.zeros(len(gain), int), fraction=np.zeros(len(gain)), gain=gain
    )
    return np.unpackbits(packed, axis=-1, bitorder="little", count=len(gain)).reshape(-1, len(gain))[:, before:]


def p_value(seen, mean, *, variance):
    """Return the p-value of Pearson's χ² test of observed integers against the exact law of counting."""
    return stats.chi2.sf(*count_chi_squared(seen, count_probabilities(mean, variance)))


@pytest.mark.parametrize("sd", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("mean", [0.37, 1.0, 7.81])
def test_the_law_has_the_moments_of_its_probabilities(mean, sd):
    """The variance by a series is that of the probabilities (second differences of an integral); the mean is exact."""
    n, p = count_probabilities(mean, sd**2)
    assert p.sum() == pytest.approx(1, rel=1e-12)
    assert (n * p).sum() == pytest.approx(mean, rel=1e-12)
    assert ((n - mean) ** 2 * p).sum() == pytest.approx(count_variance(mean, sd**2), rel=1e-9)


def test_the_law_has_its_limits():
    """The variance is f(1 − f) without noise, and s² + 1/6 with much noise or averaged over m.

    The oscillating part is between −1/12 and 1/6.
    """
    for mean in (0.2, 0.5, 3.0, 4.9):
        assert count_variance(mean, 0.0) == pytest.approx(mean % 1 * (1 - mean % 1), abs=1e-4)
        assert count_variance(mean, 1.0) == pytest.approx(1 + 1 / 6, rel=1e-8)
    over = [count_variance(mean, 0.01) for mean in np.arange(1000) / 1000]
    assert np.mean(over) == pytest.approx(0.01 + 1 / 6, rel=1e-12)
    assert (count_oscillation(0.5, 0), count_oscillation(1.0, 0)) == pytest.approx((-1 / 12, 1 / 6), abs=1e-4)


@pytest.mark.parametrize("rate", RATES)
def test_intervals_obey_the_exact_law(rate):
    """Pearson's χ² and the variance of 40,000 intervals at each of 6 rates; significance 1e-4 each, seed 9.

    Each interval comes after enough spikes to make the phase uniform.
    """
    charge = np.float32(rate * THETA)
    mean = THETA / float(charge)
    variance = PER_SPIKE * mean**2
    skipped = int(np.ceil(EVEN**2 / variance))
    latest = (skipped + 2) * mean + 8 * np.sqrt((skipped + 2) * variance) + 2
    so_far = spikes(charge, frames=int(latest), seed=9).cumsum(axis=1, dtype=np.uint16)
    first, second = ((so_far == count).argmax(axis=1) for count in (skipped, skipped + 1))
    assert (second > first).all()
    assert p_value(second - first, mean, variance=variance) > 1e-4
    assert abs(count_deviations(second - first, mean, variance=variance)) < FAR


@pytest.mark.parametrize("mean", MEANS)
def test_counts_obey_the_exact_law(mean):
    """Pearson's χ² and the variance of 40,000 counts at each of 6 means; significance 1e-4 each, seed 3."""
    frames = 200
    charge = np.float32(mean * THETA / frames)
    mean = float(charge) * frames / THETA
    variance = PER_SPIKE * mean
    seen = spikes(charge, frames=frames, seed=3, before=BEFORE).sum(axis=1, dtype=np.int64)
    assert p_value(seen, mean, variance=variance) > 1e-4
    assert abs(count_deviations(seen, mean, variance=variance)) < FAR


@pytest.mark.parametrize(("values", "noise_grows_as", "rejected"), [(RATES, 2, 4), (MEANS, 1, 6)])
def test_the_tests_above_can_reject_the_average_law(values, noise_grows_as, rejected):
    """s² + 1/6 is off by more than 3 times what they allow, at 4 of the 6 rates and all 6 means."""
    off = []
    for value in values:
        mean = 1 / value if noise_grows_as == 2 else value
        variance = PER_SPIKE * mean**noise_grows_as
        n, p = count_probabilities(mean, variance)
        exact = count_variance(mean, variance)
        sd = np.sqrt(((p * (n - mean) ** 4).sum() - exact**2) / 40_000)
        off.append(abs(variance + 1 / 6 - exact) / sd)
    assert sum(one > 3 * FAR for one in off) == rejected


@pytest.mark.parametrize("mean", [0.5, 1.0, 2.25, 6.5])
def test_the_covariance_of_adjacent_half_windows_obeys_the_law(mean):
    """cov(A, B) = (Var(A + B) − Var A − Var B)/2, from 0 to −1/4, on average −1/12; 40,000 pixels, 1e-4, seed 8.

    The standard error of the mean product is computed from the sample.
    """
    frames = 200
    charge = np.float32(mean * THETA / frames)
    expected = (count_variance(2 * mean, 2 * mean * PER_SPIKE) - 2 * count_variance(mean, mean * PER_SPIKE)) / 2
    seen = (
        spikes(charge, frames=2 * frames, seed=8, before=BEFORE).reshape(-1, 2, frames).sum(axis=2, dtype=np.int64)
        - mean
    )
    products = seen[:, 0] * seen[:, 1]
    assert abs(products.mean() - expected) < FAR * products.std() / np.sqrt(products.size)
