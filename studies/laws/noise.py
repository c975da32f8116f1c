"""Noise in time: photon transfer, intervals, the spectrum of spikes per frame, and independence of pixels and windows.

Light is constant and even, and only shot noise and threshold noise are on, so that one exact law holds for every pixel
(:mod:`saf_gen.camera.counting_law`).
"""

from collections.abc import Sequence

import numpy as np

from saf_gen.camera.counting_law import count_chi_squared, count_probabilities, noise_per_spike
from saf_gen.camera.encoder_kernel import LANES
from saf_gen.stream.stream_file import SpikeStream
from saf_gen.stream.time_blocks import TIME_BLOCK_BYTES
from studies.laws.law import (
    FALSE_ALARM,
    Comparison,
    Curve,
    Finding,
    Law,
    Plot,
    compare_chi_squared,
    compare_estimate,
    compare_mean,
)
from studies.laws.scenes import even_panel, gain_of_rate
from studies.laws.theory import autocovariance, count_variance
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

WINDOWS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
RATES = (0.03, 0.2, 0.613)
INTERVAL_RATES = (0.03, 0.05, 0.13, 0.21, 0.37, 0.5, 0.61, 0.77)
PAIRS = 16
BLOCK_FRAMES = 8 * TIME_BLOCK_BYTES  # of a time block, the unit of storage
COX = "D. R. Cox, Renewal Theory, 1962; the series: https://dlmf.nist.gov/24.8.E1"


def _even_light(rates: Sequence[float], *, frames: int, shape: tuple[int, int]) -> Workload:
    """Return the workload of an even field at several rates (spikes per readout), with one light for each rate."""
    sensor = sensor_with_noise("shot", "threshold_noise", rows=shape[0], columns=shape[1])
    levels = {_light_name(rate): gain_of_rate(rate, sensor) for rate in rates}
    lights = {name: {"kind": "constant", "level": level} for name, level in levels.items()}
    return Workload((even_panel(),), sensor, frames, lights)


def _light_name(rate: float) -> str:
    """Return the name of the light under which pixels fire at this rate."""
    return f"rate_{round(rate * 1e6):06d}"


def _size(quick: bool) -> tuple[int, tuple[int, int]]:
    return (2000, (100, 160)) if quick else (20_000, (250, 400))


def _check_photon_transfer(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the temporal variance of counts, from pairs of windows, with the exact law."""
    frames, shape = _size(quick)
    workload = _even_light(RATES, frames=frames, shape=shape)
    dataset = maker.make(workload)
    per_spike = noise_per_spike(workload.sensor)
    windows = [n for n in WINDOWS if 2 * n <= frames]
    comparisons, curves = [], []
    for rate in RATES:
        seen, law, errors = [], [], []
        with dataset.open(light=_light_name(rate)) as stream:
            for n in windows:
                samples = _half_square_differences(stream, n)
                # Var(A − B) is 2·Var A − 2·cov(A, B), and Var(A + B) is that of a window of 2n frames.
                one, two = (float(count_variance(k * n * rate, k * n * rate * per_spike)) for k in (1, 2))
                found = compare_mean(
                    f"rate {rate:g}, {n:,} frames",
                    samples,
                    expected=2 * one - two / 2,
                    figures=len(windows) * len(RATES),
                )
                comparisons.append(found)
                seen.append(found.measured)
                law.append(found.expected)
                errors.append(found.high - found.measured)
        x = tuple(n * rate for n in windows)
        curves += [
            Curve(f"law, rate {rate:g}", x, tuple(law), "marks"),
            Curve(f"stream, rate {rate:g}", x, tuple(seen), "points", tuple(errors)),
        ]
    light = (windows[0] * RATES[0], windows[-1] * RATES[-1])
    curves.append(Curve("Poisson", light, light))
    plot = Plot("mean count of a window", "half the variance of A − B", tuple(curves), log_x=True, log_y=True)
    return Finding(tuple(comparisons), plot)


def _half_square_differences(stream: SpikeStream, frames: int) -> np.ndarray:
    """Return (A − B)²/2 of adjacent windows per pixel, as a mean over a few pairs; pixels are independent samples."""
    total = stream.shape[0]
    pairs = min(PAIRS, total // (2 * frames))
    starts = np.linspace(0, total - 2 * frames, pairs).astype(int).tolist()
    found = np.zeros(stream.shape[1:])
    for start in starts:
        middle, stop = start + frames, start + 2 * frames
        found += (stream.counts(start, middle).astype(float) - stream.counts(middle, stop)) ** 2 / 2
    return found / pairs


def _check_intervals(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the intervals that follow the spikes of one readout with the exact law, by χ² and by their variance."""
    shape = _size(quick)[1]
    rates = INTERVAL_RATES[::3] if quick else INTERVAL_RATES
    workload = _even_light(rates, frames=400, shape=shape)
    dataset = maker.make(workload)
    per_spike = noise_per_spike(workload.sensor)
    comparisons: list[Comparison] = []
    curves = []
    for rate in rates:
        mean, first = 1 / rate, 200
        with dataset.open(light=_light_name(rate)) as stream:
            spikes = stream.frames(first, min(first + int(1.2 * mean) + 10, 400)).reshape(-1, shape[0] * shape[1])
        fired = spikes[0] == 1
        seen = spikes[1:, fired].argmax(axis=0) + 1
        numbers, probabilities = count_probabilities(mean, per_spike * mean**2)
        chi, freedom = count_chi_squared(seen, (numbers, probabilities))
        name = f"rate {rate:g}, {seen.size:,} intervals"
        if freedom:
            comparisons.append(compare_chi_squared(f"{name}: χ²/dof", chi, freedom=freedom, figures=2 * len(rates)))
        squares = (seen - mean) ** 2.0
        expected = float(count_variance(mean, per_spike * mean**2))
        fourth = float((probabilities * (numbers - mean) ** 4).sum())
        comparisons.append(
            compare_estimate(
                f"{name}: variance",
                float(squares.mean()),
                standard_error=np.sqrt(max(fourth - expected**2, 0) / seen.size),
                expected=expected,
                figures=2 * len(rates),
            )
        )
        shown = probabilities > 1e-4
        found = np.bincount(seen, minlength=int(numbers[-1]) + 1)[numbers[shown]] / seen.size
        x = tuple((numbers[shown] / mean).tolist())
        curves.append(Curve(f"rate {rate:g}", x, tuple(found.tolist()), "points"))
        curves.append(Curve("" if len(curves) > 1 else "law", x, tuple(probabilities[shown].tolist()), "marks"))
    return Finding(tuple(comparisons), Plot("interval / mean", "probability", tuple(curves)))


def _spikes_per_frame(stream: SpikeStream) -> np.ndarray:
    """Return the number of spikes of all pixels in each frame, int64 (T,)."""
    total, size = stream.shape[0], -(-stream.shape[0] // 8)
    out = np.zeros(8 * size, np.int64)
    for first in range(0, size, 250):
        packed = stream.packed(first, min(first + 250, size)).reshape(-1, min(250, size - first))
        for bit in range(8):
            out[8 * first + bit : 8 * (first + packed.shape[1]) : 8] = ((packed >> bit) & 1).sum(axis=0)
    return out[:total]


def _check_spectrum(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the periodogram of spikes per frame with the prediction of the exact law; the quotient must be white."""
    frames, shape = _size(quick)
    workload = _even_light(RATES, frames=frames, shape=shape)
    dataset = maker.make(workload)
    per_spike, pixels = noise_per_spike(workload.sensor), shape[0] * shape[1]
    taper = np.sqrt(8 / 3) * np.sin(np.pi * (np.arange(frames) + 0.5) / frames) ** 2
    bands = 5 if quick else 10
    figures = len(RATES) * (bands + 1)
    comparisons, curves = [], []
    for rate in RATES:
        with dataset.open(light=_light_name(rate)) as stream:
            spikes = _spikes_per_frame(stream) - pixels * rate
        # Every third ordinate, because these are independent under a Hann taper.
        chosen = slice(3, frames // 2, 3)
        seen = np.abs(np.fft.rfft(taper * spikes)[chosen]) ** 2 / frames
        law = pixels * _expected_periodogram(taper, rate=rate, per_spike=per_spike)[chosen]
        quotient = seen / law
        for n, band in enumerate(np.array_split(quotient, bands), start=1):
            name = f"rate {rate:g}, band {n} of {bands}: power / law"
            comparisons.append(compare_chi_squared(name, float(2 * band.sum()), freedom=2 * band.size, figures=figures))
        highest = -np.log1p(-((1 - FALSE_ALARM / figures) ** (1 / quotient.size)))
        name = f"rate {rate:g}: highest ordinate of {quotient.size:,}"
        comparisons.append(Comparison(name, float(quotient.max()), float("nan"), 0.0, float(highest)))
        at = np.fft.rfftfreq(frames)[chosen]
        cells = np.array_split(np.arange(at.size), 60)
        x = tuple(float(at[cell].mean()) for cell in cells)
        curves.append(
            Curve(f"stream, rate {rate:g}", x, tuple(float(seen[c].mean()) / pixels for c in cells), "points")
        )
        curves.append(Curve(f"law, rate {rate:g}", x, tuple(float(law[c].mean()) / pixels for c in cells)))
    plot = Plot("frequency, cycles per readout", "power per pixel", tuple(curves), log_y=True)
    return Finding(tuple(comparisons), plot)


def _expected_periodogram(taper: np.ndarray, *, rate: float, per_spike: float) -> np.ndarray:
    """Return the expected periodogram of the tapered spikes per frame of one pixel, float64 (T // 2 + 1,)."""
    frames = taper.size
    lags = np.arange(frames)
    covariance = np.concatenate(
        [autocovariance(1, part, rate=rate, per_spike=per_spike) for part in np.array_split(lags, 40)]
    )
    padded = np.fft.rfft(taper, 2 * frames)
    overlap = np.fft.irfft(np.abs(padded) ** 2, 2 * frames)[:frames] / frames
    weighted = overlap * covariance
    return 2 * np.fft.rfft(weighted).real - weighted[0]


def _check_independence(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare correlations between pixels with 0, and covariances between windows of a pixel with the exact law."""
    rate, n = RATES[1], 40
    begin, stop = BLOCK_FRAMES - 10 * n, BLOCK_FRAMES + 10 * n
    frames, shape = _size(quick)
    # The streams of the small size end at the first border of time blocks, so this check has a longer one.
    rates, frames = ((rate,), stop) if quick else (RATES, frames)
    workload = _even_light(rates, frames=frames, shape=shape)
    dataset, per_spike = maker.make(workload), noise_per_spike(workload.sensor)
    with dataset.open(light=_light_name(rate)) as stream:
        counts = np.stack([stream.counts(begin + k * n, begin + (k + 1) * n) for k in range(20)]).astype(float)
    counts -= n * rate
    pixel_lags = {"next column": 1, "next row": shape[1], "diagonal": shape[1] + 1, "next noise block": LANES}
    lags = (1, 2, 3, 5, 8)
    figures = len(pixel_lags) + 1 + len(lags) + 1
    comparisons = []
    flat = (counts[0::2] - counts[1::2]).reshape(len(counts) // 2, -1)
    flat = flat / flat.std()
    for what, lag in pixel_lags.items():
        products = (flat[:, lag:] * flat[:, :-lag]).mean(axis=0)
        comparisons.append(
            compare_mean(f"correlation with the pixel in the {what}", products, expected=0.0, figures=figures)
        )
    halves = (flat[:5] * np.roll(flat[:5], flat.shape[1] // 2, axis=1)).mean(axis=0)
    comparisons.append(
        compare_mean("correlation with the pixel half an array away", halves, expected=0.0, figures=figures)
    )
    law = autocovariance(n, np.array([*lags, 1]), rate=rate, per_spike=per_spike)
    for lag, expected in zip(lags, law, strict=False):
        products = (counts[lag:] * counts[:-lag]).mean(axis=0)
        what = f"covariance of windows of {n} frames, {lag} apart"
        comparisons.append(compare_mean(what, products, expected=float(expected), figures=figures))
    middle = counts[9] * counts[10]
    comparisons.append(
        compare_mean(
            "covariance of windows at a border of time blocks", middle, expected=float(law[-1]), figures=figures
        )
    )
    x = tuple(float(lag) for lag in lags)
    seen = comparisons[len(pixel_lags) + 1 : -1]
    error = tuple(one.high - one.measured for one in seen)
    curves = (
        Curve("stream", x, tuple(one.measured for one in seen), "points", error),
        Curve("law", x, tuple(one.expected for one in seen), "marks"),
    )
    return Finding(tuple(comparisons), Plot("windows apart", "covariance of counts", curves))


_EVEN = "A glowing panel in front of a lens with f = 2 m, so that light is even to 10⁻⁵, at rates of "
_BY_CHANCE = (
    f"Only the scatter between pixels: all figures together fail correct code once in {1 / FALSE_ALARM:,.0f} runs."
)
LAWS = (
    Law(
        "noise_photon_transfer",
        "The variance of counts between windows is the variance of shot and threshold noise, plus the variance from "
        "counting whole spikes.",
        "E[(A − B)²]/2 = 2·V(n) − V(2n)/2; V = s² + 1/6 − π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k², m = n·rate, s² = "
        "(1/θ + σ²)·m",
        COX,
        f"{_EVEN}{', '.join(map(str, RATES))}; adjacent windows A and B of n = 1 to 10,000 frames, in 20,000 frames "
        "of 100,000 pixels.",
        _BY_CHANCE,
        _check_photon_transfer,
    ),
    Law(
        "noise_intervals",
        "The interval to the next spike is one of the whole numbers of readouts around θ/q, as often as the exact law "
        "predicts.",
        "P(N = n) = E[max(0, 1 − |X − n|)], X normal with mean 1/rate and variance (1/θ + σ²)/rate²",
        COX,
        f"{_EVEN}{', '.join(map(str, INTERVAL_RATES))}; the interval that follows the spike of every pixel that "
        "fires at readout 200.",
        f"Pearson's χ² and the variance, with the scatter that the law predicts. {_BY_CHANCE}",
        _check_intervals,
    ),
    Law(
        "noise_spectrum",
        "Spikes per frame have the spectrum that follows from the exact law, without further lines: divided by the "
        "law, the spectrum is white.",
        "S(f) = Σⱼ γ(j)·e^(2πifj), γ(j) = (V(j + 1) − 2·V(j) + V(j − 1))/2",
        COX,
        "The streams of noise_photon_transfer: spikes of 100,000 pixels in each of 20,000 frames, with a Hann taper.",
        "Ordinates of a periodogram are exponentially distributed around the law: χ² in each band, and the highest "
        f"ordinate of all. {_BY_CHANCE}",
        _check_spectrum,
    ),
    Law(
        "noise_independence",
        "Pixels are independent; windows of one pixel are correlated only by the charge that is left over at their "
        "borders, also across time blocks.",
        "corr(pixel, pixel) = 0; cov(window 0, window j) = (V((j + 1)·n) − 2·V(j·n) + V((j − 1)·n))/2",
        COX,
        "The stream of noise_photon_transfer at a rate of 0.2: 20 windows of 40 frames around frame 2,000, where a "
        "time block ends.",
        _BY_CHANCE,
        _check_independence,
    ),
)
