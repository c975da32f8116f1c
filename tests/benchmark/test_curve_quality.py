from dataclasses import asdict

import numpy as np
import pytest

from saf_gen.benchmark.curve_quality import MIN_PROMINENCE, assess_curve
from saf_gen.core.seeds import make_generator

X = np.linspace(0, 1, 201)


def gaussian(centre=0.4, sigma=0.05):
    return np.exp(-(((X - centre) / sigma) ** 2) / 2)


def lorentzian(centre=0.4, half=0.03):
    return 1 / (1 + ((X - centre) / half) ** 2)


def test_a_gaussian_has_the_widths_of_its_formula():
    """The width is σ·2√(2 ln(1/L)); linear interpolation between blocks of 0.1 σ is off by less than 0.1 %."""
    found = assess_curve(X, 7 + 3 * gaussian(), truth=0.41, depth=0.02)
    assert found.peak == pytest.approx(0.4)
    assert found.accuracy == pytest.approx(0.01)
    assert found.accuracy_dof == pytest.approx(0.5)
    assert found.width_50 == pytest.approx(0.05 * 2 * np.sqrt(2 * np.log(2)), rel=2e-3)
    assert found.width_80 == pytest.approx(0.05 * 2 * np.sqrt(2 * np.log(1.25)), rel=2e-3)
    assert (found.range, found.false_maxima, found.false_peaks) == (1, 0, 0)
    assert found.noise < 2e-3


def test_a_lorentzian_is_wide_below_and_narrow_above():
    """The width is half width·2√(1/L − 1); L is relative to the height above the lowest score."""
    y = lorentzian()
    floor = y.min()
    found = assess_curve(X, y, truth=0.4)
    for level, width in ((0.5, found.width_50), (0.8, found.width_80)):
        height = floor + level * (1 - floor)
        assert width == pytest.approx(0.03 * 2 * np.sqrt(1 / height - 1), rel=1e-2)
    assert found.accuracy == pytest.approx(0, abs=1e-12)
    assert found.accuracy_dof is None


def test_a_ripple_makes_false_maxima_and_a_large_one_ends_the_range():
    """A cosine on two slopes has one maximum per period, and one at each end: ten in addition to the peak."""
    base = 1 - np.abs(X - 0.5) / 0.5
    ripple = np.cos(2 * np.pi * (X - 0.5) / 0.1)
    small = assess_curve(X, base + 0.04 * ripple)
    assert (small.false_maxima, small.false_peaks, small.range) == (8 + 2, 0, 1)
    large = assess_curve(X, base + 0.15 * ripple)
    assert large.false_maxima == large.false_peaks == 8 + 2
    # The minimum next to the peak is where the ripple's slope, 0.15·2π/0.1·sin, cancels the slope of 2.
    phase = np.pi + np.arcsin(2 / (0.15 * 2 * np.pi / 0.1))
    assert large.range == pytest.approx(2 * 0.1 * phase / (2 * np.pi), abs=0.005)


def test_a_second_peak_is_false_and_the_valley_between_them_ends_the_range():
    y = gaussian(0.3, 0.03) + 0.6 * gaussian(0.7, 0.03)
    found = assess_curve(X, y)
    assert (found.false_maxima, found.false_peaks) == (1, 1)
    valley = X[np.abs(X - 0.5) < 0.1][y[np.abs(X - 0.5) < 0.1].argmin()]
    assert found.range == pytest.approx(valley, abs=1e-9)
    rising_end = assess_curve(X, gaussian() + 0.3 * (X > 0.9) * (X - 0.9) / 0.1)
    assert (rising_end.false_maxima, rising_end.false_peaks) == (1, 1)
    assert assess_curve(X, X**2).false_maxima == 0


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_noise_is_the_standard_deviation_of_what_was_added(sigma):
    """From 3,500 second differences, correlated (Σρ² = 1.94), the estimate has an sd of 1.7 %; four sd, one seed."""
    random = make_generator("test_curve_quality", "noise", int(1000 * sigma))
    x = np.linspace(0, 1, 4001)
    y = np.exp(-(((x - 0.4) / 0.05) ** 2) / 2) + sigma * random.standard_normal(x.size)
    found = assess_curve(x, y)
    assert found.noise == pytest.approx(sigma / (y.max() - y.min()), rel=0.068)
    assert found.false_maxima > 1000
    assert (found.false_peaks == 0) == (sigma == 0.01)


def test_neither_direction_nor_scale_nor_offset_matters():
    random = make_generator("test_curve_quality", "scale")
    y = gaussian() + 0.02 * random.standard_normal(X.size)
    there, back = assess_curve(X, y, truth=0.4), assess_curve(X[::-1], y[::-1], truth=0.4)
    scaled = assess_curve(X, 1e6 * y - 3e5, truth=0.4)
    assert there == back
    for name, value in asdict(there).items():
        known = value if value is None else pytest.approx(value, rel=1e-6)
        assert getattr(scaled, name) == known, name


def test_a_plateau_is_one_maximum():
    y = np.array([0, 1, 1, 0, 0.5, 0.5, 0.2, 0.0])
    found = assess_curve(np.linspace(0, 1, 8), y)
    assert (found.false_maxima, found.false_peaks) == (1, 1)


def test_a_rise_of_just_less_than_the_limit_is_passed_over():
    x = np.arange(5.0)
    below, above = 0.2 + MIN_PROMINENCE - 1e-6, 0.2 + MIN_PROMINENCE + 1e-6
    assert assess_curve(x, np.array([1, 0.2, below, 0.1, 0])).range == 4
    assert assess_curve(x, np.array([1, 0.2, above, 0.1, 0])).range == 1


@pytest.mark.parametrize(
    ("position", "scores"),
    [([0, 1], [1, 2]), ([0, 0.5, 1], [1, 1, 1]), ([0, 0.5, 0.5], [1, 2, 1]), ([0, 0.5, 0.2], [1, 2, 1])],
    ids=["short", "flat", "at rest", "comes back"],
)
def test_where_there_is_no_curve_there_is_no_quality(position, scores):
    assert assess_curve(np.array(position), np.array(scores)) is None
    assert assess_curve(np.linspace(0, 1, 5), np.array([0, 1, 3, 1, 0])).noise is None  # too few blocks
