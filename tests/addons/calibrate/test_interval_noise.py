"""The law of second differences, the noise fitted with it, the law of dark counts, and the line of two levels."""

import numpy as np
import pytest
import synthetic_cameras as cameras
from scipy import stats

from saf_gen.addons.calibrate.dark_rates import dark_probabilities, fit_dark
from saf_gen.addons.calibrate.fit_response import fit_response, infer_saturation
from saf_gen.addons.calibrate.interval_noise import (
    difference_variance,
    fit_interval_noise,
    interpolate_variance,
    phase_oscillation,
)
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics, measure_spikes
from saf_gen.camera import get_sensor
from saf_gen.camera.counting_law import count_oscillation
from saf_gen.core.seeds import make_generator

FAR = stats.norm.isf(0.5e-4)
CASES = [(m, sd, lag) for m in (1.3, 3.0, 4.76) for sd, lag in ((0.002, 1), (0.01, 4), (0.03, 16))]


def drawn(interval, sd, lag):
    """Return second differences of 40,000 pixels by definition: times ⌈S⌉, normal intervals, uniform phase."""
    random = make_generator("second differences", round(100 * interval), lag)
    steps = interval * (lag + sd * np.sqrt(lag) * random.standard_normal((2, 40_000)))
    start = random.random(40_000)
    times = np.ceil(np.stack([start, start + steps[0], start + steps.sum(axis=0)]))
    return times[2] - 2 * times[1] + times[0]


@pytest.mark.parametrize(("interval", "sd", "lag"), CASES)
def test_second_differences_obey_the_exact_law(interval, sd, lag):
    """The mean square of 40,000 differences agrees within its standard error, at a significance of 1e-4."""
    squares = drawn(interval, sd, lag) ** 2
    law = float(difference_variance(np.array([interval]), sd**2, lag=lag)[0])
    assert abs(squares.mean() - law) < FAR * max(squares.std(), 1e-3) / np.sqrt(squares.size) + 1e-12


@pytest.mark.parametrize("variance", [0.0, 1e-3, 0.09, 2.0])
def test_the_oscillation_of_many_pixels_is_that_of_the_law(variance):
    mean = 2 + 500 * make_generator("oscillation").random(300)
    spread = variance * (mean / 2) ** 2
    assert phase_oscillation(mean, spread) == pytest.approx(count_oscillation(mean, spread), rel=0, abs=1e-12)


@pytest.mark.parametrize("noise", [1e-4, 2e-3])
@pytest.mark.parametrize("lag", [1, 16, 256])
def test_the_law_of_many_pixels_is_that_of_each(noise, lag):
    """The interpolated law at 50,000 intervals from 2 to 3 readouts equals the law of each pixel."""
    interval = 2 + make_generator("many pixels").random(50_000)
    law = interpolate_variance(interval, noise, lag=lag)
    assert np.abs(law - difference_variance(interval, noise, lag=lag)).max() < 1e-4


@pytest.mark.parametrize(
    ("rate", "changes"),
    [
        (0.05, {"threshold_noise_rms": 0.03}),
        pytest.param(0.25, {"saturation": "dead_readout", "threshold_noise_rms": 0.01}, marks=pytest.mark.slow),
    ],
)
def test_the_noise_of_intervals_is_found_inside_its_interval(rate, changes):
    """32 × 48 pixels, 6,000 readouts, ten seeds each: standardised errors are normal (mean and square at 1e-4)."""
    sensor = get_sensor("vidar_400x250", **changes)
    truth = 1 / sensor.threshold_e + sensor.threshold_noise_rms**2
    off = []
    for seed in range(10):
        flat = measure_spikes(cameras.flat(sensor, rate, seed=seed, device=seed, shape=(32, 48)))
        noise, error = fit_interval_noise(flat, loss=sensor.post_spike_loss)
        off.append((noise - truth) / error)
        assert error < 0.05 * truth
    assert abs(np.sum(off)) < FAR * np.sqrt(10)
    assert np.square(off).sum() < stats.chi2.isf(1e-4, 10)


def test_the_law_of_dark_counts_is_that_of_its_definition():
    """χ² test of 200,000 counts ⌊X + u⌋ of log-normal and Pareto rates at 1e-4 (seed 1); probabilities add up to 1."""
    random = make_generator("dark law", 1)
    numbers = {"median": 3.3, "log_sd": 0.5, "extra": 0.01, "factor": 4.0, "exponent": 2.5}
    size = 200_000
    x = 3.3 * np.exp(0.5 * random.standard_normal(size))
    hot = random.random(size) < 0.01
    x[hot] = 4 * 3.3 * (1 - random.random(hot.sum())) ** (-1 / 2.5)
    seen = np.floor(x + random.random(size)).astype(int)
    n = np.arange(40)
    p = dark_probabilities(n, **numbers)
    assert dark_probabilities(np.arange(100_000), **numbers).sum() == pytest.approx(1, abs=1e-6)
    found = np.bincount(np.clip(seen, 0, 40), minlength=41)
    expected = np.append(p, 1 - p.sum()) * size
    assert stats.chi2.sf(((found - expected) ** 2 / expected).sum(), 40) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("frames", [500, 20_000])
def test_dark_rates_are_found_although_some_pixels_never_fire(frames):
    """3,000 pixels with log-normal rates of median 0.004, ten seeds; in 500 readouts some never fire.

    The sum and the sum of squares of standardised errors of the mean rate and of the sd of ln are tested at 1e-4.
    """
    off, silent = [], []
    for seed in range(10):
        random = make_generator("censored dark", seed)
        rates = 0.004 * np.exp(0.45 * random.standard_normal(3000))
        found = fit_dark(np.floor(rates * frames + random.random(3000)), frames, factor=4, exponent=2.7)
        silent.append(found.silent)
        for estimate, truth in ((found.rate, 0.004 * np.exp(0.45**2 / 2)), (found.log_sd, 0.45)):
            off.append((estimate.value - truth) / ((estimate.high - estimate.low) / 3.92))
    assert (max(silent) > 0.005) == (frames == 500)
    for part in (off[::2], off[1::2]):
        assert abs(np.sum(part)) < FAR * np.sqrt(10)
        assert np.square(part).sum() < stats.chi2.isf(1e-4, 10)


def regular(rates, frames=20_000, seed=1):
    """Return the statistics of noise-free spike trains at these rates, like measure_spikes."""
    phase = make_generator("regular", seed).random(rates.shape)
    number = np.floor(rates * frames + phase).astype(np.int64)
    first, last = np.ceil((1 - phase) / rates), np.ceil((number - phase) / rates)
    empty = np.zeros((*rates.shape, 11))
    return SpikeStatistics(
        shape=(frames, *rates.shape), counts=number, interval=(last - first) / (number - 1),
        half_rates=np.zeros((2, *rates.shape)), series=np.zeros(1), series_variance=0.0,
        squares=empty, numbers=empty.astype(np.int64),
    )  # fmt: skip


@pytest.mark.parametrize("loss", [0.0, 0.02, 1.0])
def test_pixels_that_differ_tell_what_is_lost_after_a_spike(loss):
    """Three unknown levels, 60 × 60 pixels of 5 %: ℓ in its interval, levels to 10⁻³, responses to 1.3 sd."""
    response = 1 + 0.05 * make_generator("line").standard_normal((60, 60))
    response /= response.mean()
    levels = np.array([0.08, 0.2, 0.5])
    flats = [regular(1 / (1 / (level * response + 0.004) + loss), seed=i) for i, level in enumerate(levels)]
    dark = np.full(response.shape, 0.004)
    fit = fit_response(flats, dark, dark_error=0 * dark, noise=0.0)
    assert fit.loss.holds(loss)
    assert fit.loss.high - fit.loss.low < 0.004
    assert fit.levels == pytest.approx(levels, rel=1e-3)
    assert np.std((fit.response - response) / fit.error) < 1.3
    assert infer_saturation(fit.loss)[0] == ("dead_readout" if loss == 1 else "subtract")
    assert fit.misfit < 1.3


def test_pixels_that_do_not_differ_tell_nothing():
    """With equal pixels any ℓ fits, and its interval shows that."""
    flats = [regular(np.full((30, 30), rate), seed=i) for i, rate in enumerate((0.1, 0.4))]
    dark = np.full((30, 30), 0.004)
    assert infer_saturation(fit_response(flats, dark, dark_error=0 * dark, noise=1e-6).loss) is None
