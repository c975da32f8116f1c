"""Focus measures against images with known scores, and against slow references written like the formula."""

from collections import Counter
from math import cos, exp, log2, pi, sin

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import dctn
from scipy.ndimage import sobel

from saf_gen import get_measure
from saf_gen.core.seeds import make_generator
from saf_gen.plugins.measures import wavelet_ratio

SHAPES = [(37, 51), (9, 8), (4, 4), (3, 5), (1, 6), (6, 1), (1, 1)]
ROWS, COLS = 40, 60
FLAT = (
    "cen dct_energy_ratio energy_of_laplacian entropy gaussian_derivative mid_band_power modified_laplacian "
    "normalised_variance squared_gradient brenner tenengrad variance variance_of_laplacian vollath_f4 "
    "vollath_f5 wavelet_ratio"
).split()


def score(name, counts, **options):
    return get_measure(name, **options)(counts)


def stripes(period, width, *, mean=20.0, height=24):
    """Sine stripes of amplitude 3 that run down the image."""
    return np.tile(mean + 3.0 * np.sin(2 * pi * np.arange(width) / period), (height, 1))


@pytest.mark.parametrize("name", FLAT)
@pytest.mark.parametrize("level", [7, 20_000])
def test_an_even_image_scores_nothing(name, level):
    even = np.full((ROWS, COLS), level, np.uint32)
    assert score(name, even) == pytest.approx(0.0, abs=1e-24 * (1 + level**2))
    assert score(name, even.astype(np.float32)) == pytest.approx(0.0, abs=1e-24 * (1 + level**2))


SLOPE, FOOT = 3, 5
RAMP = np.tile(SLOPE * np.arange(COLS) + FOOT, (ROWS, 1))
OF_A_RAMP = {
    "tenengrad": 64 * SLOPE**2,
    "brenner": 4 * SLOPE**2,
    "squared_gradient": SLOPE**2,
    "gaussian_derivative": SLOPE**2,
    "energy_of_laplacian": 0.0,
    "modified_laplacian": 0.0,
    "variance_of_laplacian": 0.0,
    "wavelet_ratio": 0.0,
    "variance": SLOPE**2 * (COLS**2 - 1) / 12,
    "normalised_variance": SLOPE**2 * (COLS**2 - 1) / 12 / (SLOPE * (COLS - 1) / 2 + FOOT),
    "vollath_f4": -SLOPE * (SLOPE * (COLS - 3) / 2 + FOOT),
    "vollath_f5": SLOPE**2 * (((COLS - 1) ** 2 - 1) / 12 - 1 / 4),
    "entropy": log2(COLS),
}


@pytest.mark.parametrize("name", OF_A_RAMP)
def test_a_ramp_scores_as_worked_out(name):
    assert score(name, RAMP) == pytest.approx(OF_A_RAMP[name], rel=1e-12, abs=1e-24)


@pytest.mark.parametrize("sigma_px", [0.3, 1.0, 6.0])
def test_a_gaussian_derivative_gives_a_ramp_its_slope_at_any_scale(sigma_px):
    assert score("gaussian_derivative", RAMP.T, sigma_px=sigma_px) == pytest.approx(SLOPE**2, rel=1e-12)


@pytest.mark.parametrize("period", [3, 4, 5, 16])
def test_stripes_of_a_known_period_score_as_worked_out(period):
    w, v = 2 * pi / period, 3.0**2 / 2  # radians per pixel; variance

    def scored(name, beyond, **options):  # averaged over whole periods
        return score(name, stripes(period, 6 * period + beyond), **options)

    assert scored("variance", 0) == pytest.approx(v, rel=1e-12)
    assert scored("squared_gradient", 1) == pytest.approx(4 * v * sin(w / 2) ** 2, rel=1e-12)
    assert scored("brenner", 2) == pytest.approx(4 * v * sin(w) ** 2, rel=1e-12)
    assert scored("tenengrad", 2) == pytest.approx(64 * v * sin(w) ** 2, rel=1e-12)
    assert scored("energy_of_laplacian", 2) == pytest.approx(144 * v * (1 - cos(w)) ** 2, rel=1e-12)
    assert scored("variance_of_laplacian", 2) == pytest.approx(v * (1 - cos(w)) ** 2 / 9, rel=1e-12)
    assert scored("vollath_f4", 2) == pytest.approx(v * (cos(w) - cos(2 * w)), rel=1e-11, abs=1e-11)
    assert scored("vollath_f5", 1) == pytest.approx(v * cos(w), rel=1e-11, abs=1e-11)
    assert scored("cen", 0, highest=0.5) == pytest.approx(1 / period, rel=1e-12)
    assert scored("mid_band_power", 0) == pytest.approx(v if 4 <= period <= 8 else 0.0, abs=1e-12)
    scale = 0.8
    continuous = v * w**2 * exp(-((w * scale) ** 2))
    rel = 0.2 if period == 3 else 0.06  # the kernel is sampled, and cut off at 3 sigma
    assert scored("gaussian_derivative", 6, sigma_px=scale) == pytest.approx(continuous, rel=rel)


# Slow references: loops and full kernels, with no code in common with the measures.


def valid(c, kernel):
    kernel = np.asarray(kernel, float)
    if min(np.subtract(c.shape, kernel.shape)) < 0:
        return np.zeros((0, 0))
    return (sliding_window_view(c, kernel.shape) * kernel).sum(axis=(2, 3))


def pairs(c, apart):
    return [(row[x], row[x + apart]) for row in c for x in range(len(row) - apart)]


def mean(values):
    values = np.asarray(values)
    return values.mean() if values.size else 0.0


def slow_tenengrad(c):
    inside = (slice(1, -1),) * 2
    return mean(sobel(c, axis=0)[inside] ** 2 + sobel(c, axis=1)[inside] ** 2) if min(c.shape) > 2 else 0.0


def slow_modified_laplacian(c):
    across, down = (valid(c, [[0, 0, 0], [-1, 2, -1], [0, 0, 0]]), valid(c, [[0, -1, 0], [0, 2, 0], [0, -1, 0]]))
    return mean(np.abs(across) + np.abs(down))


def slow_gaussian_derivative(c):
    x = np.arange(-3.0, 4.0)
    bell = np.exp(-(x**2) / 2)
    kernel = np.outer(bell / bell.sum(), x * bell / (x**2 * bell).sum())
    return mean(valid(c, kernel) ** 2) + mean(valid(c, kernel.T) ** 2)


def slow_variance_of_laplacian(c):
    found = valid(c, np.array([[0, -1, 0], [-1, 4, -1], [0, -1, 0]]) / 6)
    return found.var() if found.size else 0.0


def slow_vollath_f4(c):
    return mean([row[x] * (row[x + 1] - row[x + 2]) for row in c for x in range(len(row) - 2)])


def slow_vollath_f5(c):
    return mean([a * b for a, b in pairs(c, 1)]) - c.mean() ** 2 if c.shape[1] > 1 else 0.0


def slow_entropy(c):
    return -sum(n / c.size * log2(n / c.size) for n in Counter(c.ravel().tolist()).values())


def slow_dct_energy_ratio(c, orders=14):
    u = np.add.outer(np.arange(8), np.arange(8))
    ratios = []
    for y in range(0, c.shape[0] - 7, 8):
        for x in range(0, c.shape[1] - 7, 8):
            power = dctn(c[y : y + 8, x : x + 8], norm="ortho") ** 2
            ratios.append(power[(u > 0) & (u <= orders)].sum() / power[0, 0] if power[0, 0] else 0.0)
    return mean(ratios)


def spectrum(c):
    radius = np.hypot(np.fft.fftfreq(c.shape[0])[:, None], np.fft.fftfreq(c.shape[1])[None])
    return radius, np.abs(np.fft.fft2(c - c.mean())) ** 2 / c.size**2


def slow_cen(c):
    radius, power = spectrum(c)
    low = radius <= 0.15
    return (radius * power)[low].sum() / power[low].sum() if power[low].sum() > 1e-20 else 0.0


def slow_mid_band_power(c):
    radius, power = spectrum(c)
    return power[(radius >= 0.125) & (radius <= 0.25)].sum()


def slow_wavelet_ratio(c):
    low = wavelet_ratio.LOW
    high = np.array([(-1) ** k * low[5 - k] for k in range(6)])
    details = sum(mean(valid(c, np.outer(*taps))[::2, ::2] ** 2) for taps in [(low, high), (high, low), (high, high)])
    left = mean(valid(c, np.outer(low, low))[::2, ::2] ** 2)
    return details / left if left else 0.0


REFERENCES = {
    "tenengrad": slow_tenengrad,
    "brenner": lambda c: mean([(a - b) ** 2 for a, b in pairs(c, 2)]),
    "squared_gradient": lambda c: mean([(a - b) ** 2 for a, b in pairs(c, 1)]),
    "gaussian_derivative": slow_gaussian_derivative,
    "energy_of_laplacian": lambda c: mean(valid(c, [[-1, -4, -1], [-4, 20, -4], [-1, -4, -1]]) ** 2),
    "modified_laplacian": slow_modified_laplacian,
    "variance_of_laplacian": slow_variance_of_laplacian,
    "variance": np.var,
    "normalised_variance": lambda c: c.var() / c.mean() if c.any() else 0.0,
    "vollath_f4": slow_vollath_f4,
    "vollath_f5": slow_vollath_f5,
    "entropy": slow_entropy,
    "dct_energy_ratio": slow_dct_energy_ratio,
    "cen": slow_cen,
    "mid_band_power": slow_mid_band_power,
    "wavelet_ratio": slow_wavelet_ratio,
}


@pytest.mark.daily(64)
@pytest.mark.parametrize("name", REFERENCES)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("highest", [3, 60])
def test_a_measure_agrees_with_its_slow_reference(name, shape, highest):
    c = make_generator("forms", *shape, highest).integers(0, highest, shape, dtype=np.uint32)
    assert score(name, c) == pytest.approx(REFERENCES[name](c.astype(float)), rel=1e-10, abs=1e-10)


def test_options_of_a_measure_agree_with_their_slow_reference():
    c = make_generator("forms", "options").integers(0, 60, (24, 40))
    for orders in (1, 7):
        expected = slow_dct_energy_ratio(c.astype(float), orders)
        assert score("dct_energy_ratio", c, highest_order=orders) == pytest.approx(expected, rel=1e-12)
    assert score("mid_band_power", c, lowest=0.0, highest=0.75) == pytest.approx(c.var(), rel=1e-12)  # Parseval
    assert score("modified_laplacian", stripes(4, 28), step=2) == pytest.approx(6.0, rel=1e-12)  # twice the extremes


def test_the_full_energy_ratio_is_the_spike_dispersion_of_tiles():
    c = make_generator("forms", "tiles").integers(0, 60, (24, 40))
    tiles = [c[y : y + 8, x : x + 8] for y in range(0, 24, 8) for x in range(0, 40, 8)]
    expected = np.mean([score("sd", tile) for tile in tiles])
    assert score("dct_energy_ratio", c) == pytest.approx(expected, rel=1e-12)


def test_the_wavelet_keeps_energy_and_has_three_vanishing_moments():
    low, high, k = wavelet_ratio.LOW, wavelet_ratio.HIGH, np.arange(6)
    for taps in (low, high):
        assert taps @ taps == pytest.approx(1.0, rel=1e-14)
        assert taps[2:] @ taps[:-2] == pytest.approx(0.0, abs=1e-15)
        assert taps[4:] @ taps[:-4] == pytest.approx(0.0, abs=1e-15)
    assert low @ high == pytest.approx(0.0, abs=1e-15)
    assert low.sum() == pytest.approx(2**0.5, rel=1e-14)
    for moment in range(3):
        assert high @ k.astype(float) ** moment == pytest.approx(0.0, abs=1e-13)
    assert abs(high @ k.astype(float) ** 3) > 0.1


def test_entropy_sees_levels_not_places():
    c = make_generator("forms", "levels").integers(0, 9, 4096)
    assert score("entropy", c.reshape(64, 64)) == score("entropy", np.sort(c).reshape(32, 128))
    assert score("entropy", np.arange(64).reshape(8, 8)) == 6.0
    assert score("entropy", np.arange(-32, 32).reshape(8, 8) * 2.0**60) == 6.0  # too far apart for a table


OF_NOISE = {
    "tenengrad": (24, 0.3),
    "brenner": (2, 0.03),
    "squared_gradient": (2, 0.03),
    "gaussian_derivative": (1 / (4 * pi), 0.002),
    "energy_of_laplacian": (468, 7.0),
    "variance_of_laplacian": (20 / 36, 0.008),
    "mid_band_power": (0.147, 0.0036),
    "vollath_f4": (0.0, 0.01),
    "vollath_f5": (0.0, 0.006),
}
"""Score of white noise of variance 1, and six standard errors for 500,000 numbers (measured with 12 seeds)."""


@pytest.mark.parametrize("name", OF_NOISE)
def test_white_noise_scores_what_the_docstring_says(name):
    """504,000 normal numbers; a bound of six standard errors fails once in 10^8 seeds."""
    expected, bound = OF_NOISE[name]
    noise = make_generator("forms", "noise").normal(size=(700, 720))
    assert score(name, noise) == pytest.approx(expected, abs=bound)
