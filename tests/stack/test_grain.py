"""Grain from two renders: white noise of known size on known pictures, and the coverage of intervals."""

import math

import numpy as np
import pytest
from mean_energy import mean_energy
from refusals import refusal
from scipy.stats import binom

from saf_gen.core.seeds import make_generator
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.grain import ENERGIES, correlate_grain, estimate_grain

FACTORS = (1, 2, 24, 2, 468, 20 / 36)
"""Energies of white noise of variance 1, in the order of ENERGIES: the sum of the squares of each filter."""
PERIOD, MEAN, AMPLITUDE = 16, 2.0, 0.6


def stripes(rows=64, columns=96, *, amplitude=AMPLITUDE):
    return np.tile(MEAN + amplitude * np.sin(2 * np.pi * np.arange(columns) / PERIOD), (rows, 1))


def renders(clean, sigma, random, count=2):
    return [clean + sigma * random.standard_normal(clean.shape) for _ in range(count)]


@pytest.mark.parametrize("energy", ENERGIES)
def test_an_energy_is_the_focus_measure(energy):
    picture = make_generator("picture", 1).random((37, 53))
    assert mean_energy(picture, picture, energy=energy) == pytest.approx(
        get_measure("variance" if energy == "contrast" else energy)(picture), rel=1e-12
    )


def test_the_energies_of_stripes_are_closed_forms():
    """A·sin(2πx/P) has the variance A²/2, Brenner 2A²·sin²(2π/P), Tenengrad 32A²·sin²(2π/P).

    Filters leave out the border, so that the last two miss two columns: 0.2 % of 96 periods.
    """
    clean, s2 = stripes(5, 96 * PERIOD), math.sin(2 * math.pi / PERIOD) ** 2
    assert mean_energy(clean, clean, energy="contrast") == pytest.approx(AMPLITUDE**2 / 2, rel=1e-12)
    assert mean_energy(clean, clean, energy="brenner") == pytest.approx(2 * AMPLITUDE**2 * s2, rel=2e-3)
    assert mean_energy(clean, clean, energy="tenengrad") == pytest.approx(32 * AMPLITUDE**2 * s2, rel=2e-3)


@pytest.mark.parametrize("sigma", [0.02, 0.3, 2.0])
def test_planted_noise_is_found(sigma):
    """White noise adds FACTORS times σ² to the energies. One draw of 256 × 384 pixels, seed 2.

    Noise energies scatter by at most 1 %, quotients by 1 % + 5 % · σ if noise is up to 20 times the signal; four
    standard deviations are allowed.
    """
    clean = stripes(256, 384)
    first, second = renders(clean, sigma, make_generator("planted", 2))
    found = estimate_grain(first, second)
    assert found.mean == pytest.approx(MEAN, rel=0.01 * (1 + sigma))
    assert found.rms.value == pytest.approx(sigma / MEAN, rel=0.02)
    for energy, factor in zip(ENERGIES, FACTORS, strict=True):
        noise = mean_energy(first - second, first - second, energy=energy) / 2
        assert noise == pytest.approx(factor * sigma**2, rel=0.04)
        figure, expected = (found.noise_over_signal[energy], noise / mean_energy(clean, clean, energy=energy))
        if expected < 20:
            assert figure.value == pytest.approx(expected, rel=0.04 + 0.2 * sigma)
        else:
            assert figure.low < expected


def test_noise_of_fewer_samples_counts_by_the_ratio():
    """A second render with an eighth of the samples has 8 times the variance of the first. Seed 3, 98,304 pixels."""
    clean, random = stripes(256, 384), make_generator("ratio", 3)
    first, second = renders(clean, 0.1, random, 1)[0], renders(clean, 0.1 * math.sqrt(8), random, 1)[0]
    found = estimate_grain(first, second, ratio=8)
    assert found.rms.value == pytest.approx(0.1 / MEAN, rel=0.02)
    assert found.noise_over_signal["contrast"].value == pytest.approx(0.01 / (AMPLITUDE**2 / 2), rel=0.05)


def uneven(random, shape):
    """Noise that is three times as strong on the right half, and equal within squares of 2 × 2 pixels."""
    coarse = random.standard_normal((shape[0] // 2, shape[1] // 2))
    fine = np.kron(coarse, np.ones((2, 2)))
    return fine * np.where(np.arange(shape[1]) < shape[1] // 2, 0.5, 1.5)


@pytest.mark.parametrize("kind", ["white", "uneven"])
@pytest.mark.slow
def test_an_interval_holds_the_truth_as_often_as_it_says(kind):
    """200 draws, seed 4, 64 × 96 pixels, noise of half the amplitude; significance 10⁻⁴.

    A 95 % interval then contains the truth at least 177 times, and that of the rms in white noise at most 199 times.
    Uneven noise may only widen it.
    """
    draws, clean, random = 200, stripes(), make_generator("coverage", 4)
    sigma = AMPLITUDE / 2

    def draw(stream):
        if kind == "white":
            return sigma * stream.standard_normal(clean.shape)
        return sigma * uneven(stream, clean.shape)

    many = [draw(make_generator("reference", n)) for n in range(200)]  # their mean is known to 0.3 %
    expected = {
        e: np.mean([mean_energy(n, n, energy=e) for n in many]) / mean_energy(clean, clean, energy=e) for e in ENERGIES
    }
    rms = sigma / MEAN * (1 if kind == "white" else math.sqrt((0.5**2 + 1.5**2) / 2))
    held = dict.fromkeys(("rms", *ENERGIES), 0)
    for _ in range(draws):
        found = estimate_grain(clean + draw(random), clean + draw(random))
        held["rms"] += found.rms.low <= rms <= found.rms.high
        for energy, figure in found.noise_over_signal.items():
            held[energy] += figure.low <= expected[energy] <= figure.high
    lowest, highest = binom.ppf((1e-4, 1 - 1e-4), draws, 0.95)
    assert min(held.values()) >= lowest, held
    if kind == "white":
        assert held["rms"] <= highest, held


def test_a_signal_that_noise_hides_has_no_upper_end():
    found = estimate_grain(*renders(np.full((40, 40), MEAN), 0.2, make_generator("flat", 5)))
    for figure in found.noise_over_signal.values():
        assert figure.low >= 0
        assert figure.high == math.inf


def test_equal_renders_have_no_grain():
    found = estimate_grain(stripes(), stripes())
    for figure in (found.rms, *found.noise_over_signal.values()):
        assert (figure.value, figure.low, figure.high) == (0.0, 0.0, 0.0)


def test_a_black_region_has_no_figure():
    found = estimate_grain(np.zeros((9, 9)), np.zeros((9, 9)))
    assert all(math.isnan(figure.value) for figure in (found.rms, *found.noise_over_signal.values()))


def test_a_mask_counts_its_own_pixels():
    """Strong noise outside the mask has no effect: the figures are those of the masked part, cut out."""
    clean, random = stripes(64, 96), make_generator("mask", 6)
    first, second = renders(clean, 0.1, random)
    mask = np.zeros(clean.shape, bool)
    mask[8:40, 16:64] = True
    loud = [np.where(mask, picture, picture + 5 * random.standard_normal(clean.shape)) for picture in (first, second)]
    inside, cut = estimate_grain(*loud, mask=mask), estimate_grain(first[8:40, 16:64], second[8:40, 16:64])
    assert inside.rms.value == pytest.approx(cut.rms.value, rel=1e-12)
    for energy in ENERGIES:
        assert inside.noise_over_signal[energy].value == pytest.approx(cut.noise_over_signal[energy].value, rel=1e-12)


@pytest.mark.parametrize("kept", [0.0, 0.95])
def test_the_correlation_of_grain_is_found(kept):
    """A later moment keeps a fraction of the noise: correlation ``kept``. 200 draws of 48 × 48 pixels, seed 8.

    The interval contains it at least 176 times, at a significance of 10⁻⁴; five standard errors of the mean are 0.005.
    """
    random, clean, draws = make_generator("correlation", 8, str(kept)), np.full((48, 48), MEAN), 200
    moved, held, values = stripes(48, 48), 0, []
    for _ in range(draws):
        noise = random.standard_normal((2, 2, *clean.shape))
        earlier = [clean + 0.1 * one for one in noise[0]]
        later = [moved + 0.1 * (kept * a + math.sqrt(1 - kept**2) * b) for a, b in zip(*noise, strict=True)]
        found = correlate_grain(tuple(earlier), tuple(later))
        held += found.low <= kept <= found.high
        values.append(found.value)
    assert held >= binom.ppf(1e-4, draws, 0.95)
    assert np.mean(values) == pytest.approx(kept, abs=0.0075)


def test_what_cannot_be_compared_is_refused():
    picture = stripes()
    assert "shapes" in refusal(estimate_grain, picture, picture[1:]).problem
    assert "shapes" in refusal(estimate_grain, picture[0], picture[0]).problem
    assert "marks 0 pixels" in refusal(estimate_grain, picture, picture, mask=np.zeros(picture.shape)).problem
    assert "ratio" in refusal(estimate_grain, picture, picture, ratio=0).problem
    assert "moments" in refusal(correlate_grain, (picture, picture), (picture[1:], picture[1:])).problem
