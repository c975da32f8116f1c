"""What makes a recording unfit as a flat field or as a dark one, each in one line."""

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from scipy import stats

from saf_gen.calibration.fit_pattern import legendre_basis_to_fit
from saf_gen.calibration.pattern_statistics import ROBUST, split_pattern_for_statistics
from saf_gen.calibration.spike_statistics import SERIES_FRAMES, SpikeStatistics
from saf_gen.errors import BadInput

SATURATED_RATE, SATURATED_PIXELS = 0.9, 0.01
LEAST_SPIKES = 50
LEVELS_APART = 1.2
FROM_DARK = 2.0
PICTURE_CORRELATION, PICTURE_RMS, PICTURE_PROFILE = 0.2, 0.004, 0.2
MOST_VARIATION = 0.2
_SIGNIFICANCE = 1e-4
_SLOW = 4


@dataclass(frozen=True)
class LightVariation:
    """How the light of a flat field varied in time.

    light : light of each run of 8 readouts over its mean; None where nothing beyond noise was seen.
    rms : of these, noise taken off.
    hz : frequency of the strongest line, 0 where it has at most 4 periods in the recording.
    """

    light: np.ndarray | None
    rms: float
    hz: float

    @property
    def stretch(self) -> float:
        """Mean square of the length of a readout at a spike, in readouts of mean light."""
        return 1.0 if self.light is None else float(np.mean(self.light**3))


def check_calibration_camera(named: dict[str, tuple[tuple[int, int, int], float]]) -> None:
    """Raise BadInput unless all recordings, (T, H, W) and readouts per second by name, can be of one camera."""
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


def find_light_variation_of_flat(statistics: SpikeStatistics, *, noise: float, readout_hz: float) -> LightVariation:
    """Return how the light varied, from the mean of all pixels, which share the light and not the noise.

    Two tests at a significance of 1e-4: flicker by the variance of means over 8 readouts, drift by that of 16 long
    ones. ``noise`` is v = 1/θ + σ² of an interval, or an upper bound of it.
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


def check_flat_recording(
    name: str, statistics: SpikeStatistics, *, dark: np.ndarray, variation: LightVariation
) -> None:
    """Raise BadInput unless a recording can be a flat field; ``dark`` is the dark rate of each pixel (H, W)."""
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
            allowed="a flat field brighter than the dark",
            hint="are the two exchanged?",
        )
    if level < FROM_DARK * floor:
        raise BadInput(
            f"fires at {level:.3g} spikes per readout, only {level / floor:.2g} times the dark",
            where=name,
            allowed=f"at least {FROM_DARK:g} times the dark",
            hint="record it with more light",
        )
    middle = float(np.median(statistics.counts))
    if middle < LEAST_SPIKES:
        needed = int(np.ceil(LEAST_SPIKES / max(level, 1e-9)))
        raise BadInput(
            f"has {middle:.0f} spikes per pixel in {frames} readouts",
            where=name,
            allowed=f"at least {LEAST_SPIKES}",
            hint=f"at this light record at least {needed} readouts",
        )
    if variation.rms > MOST_VARIATION:
        raise BadInput(
            f"its light varies by {variation.rms:.0%} rms in time",
            where=name,
            allowed=f"steady light, within {MOST_VARIATION:.0%}",
            hint="use a lamp on direct current",
        )
    _check_even(name, np.where(rates > 0, rates - dark, np.nan))
    _check_still(name, statistics)
    _check_steps(name, statistics)


def _check_even(name: str, response: np.ndarray) -> None:
    columns, rows, rest = split_pattern_for_statistics(response)
    for words, profile in (("columns", columns), ("rows", rows)):
        if profile[1:].std() > PICTURE_PROFILE:
            raise BadInput(
                f"its {words} differ by {profile[1:].std():.0%} rms: a picture, or uneven light",
                where=name,
                allowed=f"even light, within {PICTURE_PROFILE:.0%}",
            )
    correlation, rms = _neighbourly(_without_bow(rest))
    if correlation > max(PICTURE_CORRELATION, 6 / sqrt(response.size)) and rms * sqrt(correlation) > PICTURE_RMS:
        raise BadInput(
            f"shows a picture, or uneven light: pixels {rms:.1%} rms off their column and row agree with their "
            f"neighbours by {correlation:.2f}",
            where=name,
            allowed=f"an agreement of at most {PICTURE_CORRELATION:g}, as of a chip's own pattern",
            hint="take a flat field without a lens, or of an even surface far out of focus",
        )


def _check_still(name: str, statistics: SpikeStatistics) -> None:
    first, second = statistics.half_rates
    with np.errstate(invalid="ignore"):
        change = 2 * (second - first) / (first + second)
    correlation, rms = _neighbourly(np.where(np.isfinite(change), change, 0.0))
    if correlation > max(PICTURE_CORRELATION, 6 / sqrt(change.size)) and rms * sqrt(correlation) > PICTURE_RMS:
        raise BadInput(
            f"something moves: neighbouring pixels change together by {rms:.1%} rms from one half to the other",
            where=name,
            allowed="even light that stands still",
        )


def _check_steps(name: str, statistics: SpikeStatistics) -> None:
    """Raise BadInput where intervals are whole: the mark of a reset that loses the charge above the threshold."""
    interval = statistics.interval[np.isfinite(statistics.interval)]
    whole = np.abs(interval - np.round(interval)) < 0.003
    if interval.mean() < 20 and whole.mean() > 0.5 and np.unique(np.round(interval[whole])).size > 1:
        raise BadInput(
            f"{whole.mean():.0%} of its pixels have intervals of a whole number of readouts: charge above the "
            "threshold is lost (reset: hard)",
            where=name,
            allowed="a camera that keeps it (reset: subtract)",
            hint="with a hard reset rates rise in steps, and tell too little of the pixels",
        )


def check_levels_of_flats(names: list[str], levels: np.ndarray) -> None:
    """Raise BadInput where two flat fields have about the same level."""
    order = np.argsort(levels)
    for a, b in pairwise(order.tolist()):
        if levels[b] < LEVELS_APART * levels[a]:
            raise BadInput(
                f"{names[a]} and {names[b]} have the same level: {levels[a]:.3g} and {levels[b]:.3g} spikes per "
                "readout",
                allowed=f"levels apart by a factor of {LEVELS_APART:g} or more",
                hint="leave one out, or record one with more light",
            )


def _neighbourly(map_: np.ndarray) -> tuple[float, float]:
    """Return how pixels of a map agree with those next to them, as a correlation over both directions, and their rms.

    Values beyond 5 robust standard deviations are cut to that, so that single pixels do not count.
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
    """Return a map without products of tilts and bows of columns and rows, which lenses and lamps leave."""
    rows, columns = (legendre_basis_to_fit(n, 2) for n in rest.shape)
    for i in range(2):
        for j in range(2):
            shape = rows[:, i : i + 1] * columns[:, j]
            rest = rest - shape * np.mean(rest * shape)
    return rest
