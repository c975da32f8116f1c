"""Checks that recordings can serve as the flat fields of one camera."""

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from scipy import stats

from saf_gen.addons.calibrate.spike_statistics import SERIES_FRAMES, SpikeStatistics
from saf_gen.camera.fixed_pattern import legendre_basis
from saf_gen.errors import BadInput

SATURATED_RATE, SATURATED_PIXELS = 0.9, 0.01
MIN_SPIKES = 50
MIN_LEVEL_RATIO = 1.2
MIN_DARK_RATIO = 2.0
PICTURE_CORRELATION, PICTURE_RMS, PICTURE_PROFILE = 0.2, 0.004, 0.2
MAX_VARIATION = 0.2
_SIGNIFICANCE = 1e-4
_SLOW = 4
ROBUST = 1.482602218505602
"""Standard deviation of a normal distribution divided by its median absolute deviation."""


@dataclass(frozen=True)
class LightVariation:
    """Variation of the light of a flat field in time.

    Attributes
    ----------
    light : ndarray, shape (T div 8,), or None
        Light of each run of 8 readouts, divided by its mean; None if it did not vary beyond noise.
    rms : float
        Rms of the relative light, after subtraction of noise.
    hz : float
        Frequency of the strongest line, in hertz; 0 if it has at most 4 periods in the recording.
    """

    light: np.ndarray | None
    rms: float
    hz: float

    @property
    def stretch(self) -> float:
        """Mean square of the relative light, weighted by the number of spikes; 1 in steady light."""
        return 1.0 if self.light is None else float(np.mean(self.light**3))


def check_camera(named: dict[str, tuple[tuple[int, int, int], float]]) -> None:
    """Raise BadInput unless all recordings have the same rows, columns and readout rate.

    Parameters
    ----------
    named : dict of str to tuple
        Shape (T, H, W) and readouts per second of each recording, by its name.
    """
    (first, (shape, readout_hz)), *others = named.items()
    for name, (other, hz) in others:
        if other[1:] != shape[1:]:
            raise BadInput(
                f"has {other[2]}×{other[1]} pixels, and {first} has {shape[2]}×{shape[1]}",
                where=name,
                allowed="recordings of one camera, all of one size",
            )
        if hz != readout_hz:
            raise BadInput(
                f"has {hz:g} readouts per second, and {first} has {readout_hz:g}",
                where=name,
                allowed="recordings of one camera at one readout rate",
            )


def light_variation(statistics: SpikeStatistics, *, noise: float, readout_hz: float) -> LightVariation:
    """Return the variation in time of the light of a flat field.

    The light is estimated from the mean over all pixels, because the pixels share the light but not the noise. Two
    tests at a significance of 1e-4 decide whether it varied: the variance of means over 8 readouts shows flicker, and
    the variance of 16 long means shows drift.

    Parameters
    ----------
    statistics : SpikeStatistics
        Statistics of the recording.
    noise : float
        Relative variance of an interval, v = 1/θ + σ², or an upper bound of it.
    readout_hz : float
        Readouts per second.
    """
    series, mean = statistics.series, float(statistics.series.mean())
    pixels = statistics.counts.size
    if mean == 0 or statistics.series_variance == 0:
        return LightVariation(None, 0.0, 0.0)
    freedom = max(series.size // 4, 1)
    flickers = series.var() > statistics.series_variance * stats.chi2.isf(_SIGNIFICANCE, freedom) / freedom
    drifts, run = False, series.size // 16
    if run >= 2:
        parts = series[: 16 * run].reshape(16, run).mean(axis=1)
        count = mean * run * SERIES_FRAMES
        expected = (1 / 4 + noise * count) / pixels / (run * SERIES_FRAMES) ** 2
        drifts = parts.var(ddof=1) > expected * stats.chi2.isf(_SIGNIFICANCE, 15) / 15
    if not (flickers or drifts):
        return LightVariation(None, 0.0, 0.0)
    power = np.abs(np.fft.rfft(series / mean - 1)) ** 2
    strongest = int(power[1:].argmax()) + 1
    hz = strongest / series.size * readout_hz / SERIES_FRAMES
    rms = sqrt(max(float(series.var()) - statistics.series_variance * (not drifts or flickers), 0.0)) / mean
    return LightVariation(series / mean, rms, hz if strongest > _SLOW else 0.0)


def check_flat(name: str, statistics: SpikeStatistics, *, dark: np.ndarray, variation: LightVariation) -> None:
    """Raise BadInput unless a recording can serve as a flat field.

    Parameters
    ----------
    name : str
        Name of the recording in error messages.
    statistics : SpikeStatistics
        Statistics of the recording.
    dark : ndarray, shape (H, W)
        Dark rate of each pixel, spikes per readout.
    variation : LightVariation
        Variation of the light in time.
    """
    frames, rates = statistics.shape[0], statistics.rates
    saturated = float(np.mean(statistics.counts / frames > SATURATED_RATE))
    if saturated > SATURATED_PIXELS:
        raise BadInput(
            f"is saturated: {saturated:.1%} of the pixels fire at more than {SATURATED_RATE:g} of the readouts",
            where=name,
            allowed=f"at most {SATURATED_PIXELS:.0%}",
            hint="record it again with less light",
        )
    level, floor = statistics.mean_rate, float(dark.mean())
    if level <= floor:
        raise BadInput(
            f"fires at {level:.3g} spikes per readout, and the dark recording at {floor:.3g}",
            where=name,
            allowed="a flat field brighter than the dark recording",
            hint="check whether the two recordings were swapped",
        )
    if level < MIN_DARK_RATIO * floor:
        raise BadInput(
            f"fires at {level:.3g} spikes per readout, only {level / floor:.2g} times the dark rate",
            where=name,
            allowed=f"at least {MIN_DARK_RATIO:g} times the dark rate",
            hint="record it with more light",
        )
    middle = float(np.median(statistics.counts))
    if middle < MIN_SPIKES:
        needed = int(np.ceil(MIN_SPIKES / max(level, 1e-9)))
        raise BadInput(
            f"has {middle:.0f} spikes per pixel in {frames} readouts",
            where=name,
            allowed=f"at least {MIN_SPIKES}",
            hint=f"at this light record at least {needed} readouts",
        )
    if variation.rms > MAX_VARIATION:
        raise BadInput(
            f"its light varies by {variation.rms:.0%} rms in time",
            where=name,
            allowed=f"steady light, within {MAX_VARIATION:.0%}",
            hint="use a lamp on direct current",
        )
    _check_even(name, np.where(rates > 0, rates - dark, np.nan))
    _check_still(name, statistics)
    _check_steps(name, statistics)


def split_pattern(map_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the column profile (W,), row profile (H,) and rest (H, W) of a map divided by its mean, each of mean 0.

    Pixels that are not finite count as equal to the mean of the map.
    """
    relative = map_ / np.nanmean(map_[np.isfinite(map_)])
    relative = np.where(np.isfinite(relative), relative, 1.0)
    columns, rows = relative.mean(axis=0) - relative.mean(), relative.mean(axis=1) - relative.mean()
    return columns, rows, relative - relative.mean() - columns - rows[:, None]


def _check_even(name: str, response: np.ndarray) -> None:
    columns, rows, rest = split_pattern(response)
    for words, profile in (("columns", columns), ("rows", rows)):
        if profile[1:].std() > PICTURE_PROFILE:
            raise BadInput(
                f"its {words} differ by {profile[1:].std():.0%} rms: a picture, or uneven light",
                where=name,
                allowed=f"even light, within {PICTURE_PROFILE:.0%}",
            )
    correlation, rms = _neighbour_correlation(_without_bow(rest))
    if correlation > max(PICTURE_CORRELATION, 6 / sqrt(response.size)) and rms * sqrt(correlation) > PICTURE_RMS:
        raise BadInput(
            f"shows a picture, or uneven light: pixels differ from their column and row by {rms:.1%} rms, and "
            f"neighbours have a correlation of {correlation:.2f}",
            where=name,
            allowed=f"a correlation of at most {PICTURE_CORRELATION:g}, as in the fixed pattern of a chip",
            hint="record the flat field without a lens, or of an even surface far out of focus",
        )


def _check_still(name: str, statistics: SpikeStatistics) -> None:
    first, second = statistics.half_rates
    with np.errstate(invalid="ignore"):
        change = 2 * (second - first) / (first + second)
    correlation, rms = _neighbour_correlation(np.where(np.isfinite(change), change, 0.0))
    if correlation > max(PICTURE_CORRELATION, 6 / sqrt(change.size)) and rms * sqrt(correlation) > PICTURE_RMS:
        raise BadInput(
            f"something moves: neighbouring pixels change together by {rms:.1%} rms between the two halves",
            where=name,
            allowed="even light without motion",
        )


def _check_steps(name: str, statistics: SpikeStatistics) -> None:
    """Raise BadInput if most mean intervals are integers, a sign of a reset that loses the charge above threshold."""
    interval = statistics.interval[np.isfinite(statistics.interval)]
    is_integer = np.abs(interval - np.round(interval)) < 0.003
    if interval.mean() < 20 and is_integer.mean() > 0.5 and np.unique(np.round(interval[is_integer])).size > 1:
        raise BadInput(
            f"{is_integer.mean():.0%} of its pixels have intervals of a whole number of readouts: charge above the "
            "threshold is lost (reset: hard)",
            where=name,
            allowed="a camera that keeps it (reset: subtract)",
            hint="use such a camera: with a hard reset, rates rise in steps and say too little about the pixels",
        )


def check_levels(names: list[str], levels: np.ndarray) -> None:
    """Raise BadInput if the levels of two flat fields differ by less than a factor of 1.2."""
    order = np.argsort(levels)
    for a, b in pairwise(order.tolist()):
        if levels[b] < MIN_LEVEL_RATIO * levels[a]:
            raise BadInput(
                f"{names[a]} and {names[b]} have the same level: {levels[a]:.3g} and {levels[b]:.3g} spikes per "
                "readout",
                allowed=f"levels apart by a factor of {MIN_LEVEL_RATIO:g} or more",
                hint="leave one out, or record one with more light",
            )


def _neighbour_correlation(map_: np.ndarray) -> tuple[float, float]:
    """Return the correlation of neighbouring pixels of a map, averaged over both directions, and the rms of the map.

    Values beyond 5 robust standard deviations from the median are clipped to limit the influence of single pixels.
    """
    off = map_ - np.median(map_)
    robust = ROBUST * np.median(np.abs(off))
    off = np.clip(off, -5 * robust, 5 * robust)
    variance = float(np.mean(off**2))
    if variance == 0:
        return 0.0, 0.0
    pairs = [off[:, 1:] * off[:, :-1], off[1:] * off[:-1]]
    return float(np.mean([p.mean() for p in pairs if p.size]) / variance), sqrt(variance)


def _without_bow(rest: np.ndarray) -> np.ndarray:
    """Return a map without the products of tilts and bows of columns and rows, which lenses and lamps cause."""
    rows, columns = (legendre_basis(n, 2) for n in rest.shape)
    for i in range(2):
        for j in range(2):
            shape = rows[:, i : i + 1] * columns[:, j]
            rest = rest - shape * np.mean(rest * shape)
    return rest
