"""Statistics of a map, compared with planted profiles, spectra, tails and correlations of neighbours."""

import numpy as np
import pytest
from scipy import stats

from saf_gen.addons.calibrate.pattern_statistics import (
    BANDS,
    band_statistics,
    legendre_fractions,
    measure_dark,
    measure_pattern,
    split_pattern,
)
from saf_gen.core.seeds import make_generator


def test_profiles_and_rest_add_up_to_the_map_and_are_orthogonal():
    map_ = 3 + make_generator("pattern").standard_normal((40, 60))
    columns, rows, white = split_pattern(map_)
    assert columns + rows[:, None] + white == pytest.approx(map_ / map_.mean() - 1)
    assert np.abs([columns.sum(), rows.sum(), *white.sum(axis=0), *white.sum(axis=1)]).max() < 1e-10
    parts = measure_pattern(map_)
    assert parts.rms**2 == pytest.approx(parts.column_rms**2 + parts.row_rms**2 + parts.white_rms**2)


def test_planted_profiles_are_found():
    """Columns are a cosine of 4 % rms and rows a slope of 2 % rms, whose statistics have closed forms."""
    columns = 0.04 * np.sqrt(2) * np.cos(2 * np.pi * np.arange(128) / 16)
    rows = 0.02 * np.sqrt(3) * np.linspace(-1, 1, 1001)
    found = measure_pattern(5.0 * (1 + columns + rows[:, None]))
    assert (found.mean, found.column_rms) == pytest.approx((5, 0.04))
    assert found.row_rms == pytest.approx(0.02, rel=2e-3)
    assert found.white_rms < 1e-12
    assert found.column_bands == pytest.approx((0, 0, 0, 0, 1, 0, 0), abs=1e-12)  # 1/16 is above 0.05, below 0.1
    assert found.row_degrees == pytest.approx((1, 1, 1))


def test_bands_hold_all_of_the_variance_and_each_wave_is_in_its_own():
    assert sum(band_statistics(make_generator("bands").standard_normal(400))) == pytest.approx(1)
    for length in (400, 401):
        for at, band in enumerate(BANDS):
            wave = np.cos(2 * np.pi * np.floor(band * length) / length * np.arange(length))
            assert band_statistics(wave)[at] == pytest.approx(1)


def test_white_noise_is_spread_over_bands_by_their_width():
    """Mean of 400 profiles of 400 white numbers; each fraction to 4 standard errors (1e-4 two-sided; seed 1)."""
    random = make_generator("white bands", 1)
    found = np.array([band_statistics(random.standard_normal(400)) for _ in range(400)])
    number = np.diff([0, *(np.floor(np.array(BANDS) * 400 + 1e-9))])
    number[-1] -= 0.5  # the highest frequency is in the spectrum once, all others twice
    error = found.std(axis=0) / np.sqrt(len(found))
    assert (np.abs(found.mean(axis=0) - number / number.sum()) < 4 * error).all()


def test_legendre_fits_hold_the_polynomials_they_are_made_for():
    place = np.linspace(-1, 1, 500)
    assert legendre_fractions(3 * place) == pytest.approx((1, 1, 1))
    assert legendre_fractions(place**2) == pytest.approx((0, 1, 1), abs=1e-10)
    quartic = np.polynomial.legendre.Legendre([0, 0, 0, 0, 1])(place)
    assert legendre_fractions(quartic) == pytest.approx((0, 0, 1), abs=0.01)


def test_tails_and_neighbours_of_a_white_rest_are_found():
    """250 × 400 normal numbers have kurtosis 3, robust rms = rms, and no correlation, to 4 standard errors (seed 3).

    Then 50 pixels are set to 7 rms and 20 to 30 rms, and each pixel is mixed with its neighbour.
    """
    random = make_generator("white rest", 3)
    noise = 0.02 * random.standard_normal((250, 400))
    found = measure_pattern(1 + noise)
    assert found.white_kurtosis == pytest.approx(3, abs=4 * np.sqrt(24 / noise.size))
    assert found.white_robust_rms == pytest.approx(0.02, rel=4 * 1.17 / np.sqrt(noise.size))
    assert abs(found.neighbour_correlation) < 4 / np.sqrt(noise.size)
    assert found.beyond_10 == 0
    assert found.beyond_5 < 1e-4
    chosen = random.permutation(noise.size)
    noise.ravel()[chosen[:50]] = 0.14
    noise.ravel()[chosen[50:70]] = -0.6
    found = measure_pattern(1 + noise)
    assert (found.beyond_5, found.beyond_10) == (70 / noise.size, 20 / noise.size)
    mixed = random.standard_normal((250, 401))
    mixed = mixed[:, 1:] + 0.3 * mixed[:, :-1]
    expected = 0.3 / (1 + 0.3**2)
    assert measure_pattern(1 + 0.02 * mixed).neighbour_correlation == pytest.approx(expected, abs=4 / np.sqrt(1e5))


def test_the_dark_is_that_of_a_log_normal_with_hot_and_silent_pixels():
    """250 × 400 rates; median, sd of ln and hot fraction to 4 standard errors (seed 2)."""
    rates = 0.004 * np.exp(0.4 * make_generator("dark", 2).standard_normal((250, 400)))
    tail = stats.norm.sf(np.log(4) / 0.4)
    found = measure_dark(rates)
    assert found.median == pytest.approx(0.004, rel=4 * 1.2533 * 0.4 / np.sqrt(1e5))
    assert found.log_sd == pytest.approx(0.4, rel=4 / np.sqrt(2e5))
    assert found.hot_fraction == pytest.approx(tail, abs=4 * np.sqrt(tail / 1e5))
    rates[:10] = 0
    assert measure_dark(rates).silent_fraction == pytest.approx(10 / 250)
