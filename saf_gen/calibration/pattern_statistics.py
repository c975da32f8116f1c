"""Statistics of the fixed pattern: profiles of columns and rows, the white rest, and the dark."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

BANDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Upper ends of the bands of frequency in which a profile's variance is stated, cycles per pixel."""
DEGREES = (1, 2, 4)
"""Degrees of the Legendre fits whose fraction of a profile's variance is stated."""
ROBUST = 1.482602218505602
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class PatternStatistics:
    """The pattern of a map, relative to its mean.

    mean : mean of the map, in its own unit.
    rms, column_rms, row_rms, white_rms : of the whole, of the profile of columns and of rows, and of the rest.
    white_robust_rms : 1.4826 times the median absolute deviation of the rest.
    white_kurtosis : fourth moment over squared variance, 3 for a normal distribution.
    beyond_5, beyond_10 : fraction of pixels whose rest is more than so many robust rms away from its median.
    neighbour_correlation : of the rest with that of the next pixel in its row, both held within 3 robust rms of the
        median, so that a few specks of dust do not decide it.
    column_bands, row_bands : fraction of a profile's variance by band of frequency, as :data:`BANDS`.
    column_degrees, row_degrees : fraction of a profile's variance in Legendre fits of the :data:`DEGREES`.
    """

    mean: float
    rms: float
    column_rms: float
    row_rms: float
    white_rms: float
    white_robust_rms: float
    white_kurtosis: float
    beyond_5: float
    beyond_10: float
    neighbour_correlation: float
    column_bands: tuple[float, ...]
    row_bands: tuple[float, ...]
    column_degrees: tuple[float, ...]
    row_degrees: tuple[float, ...]


@dataclass(frozen=True)
class DarkStatistics:
    """The rates of a dark recording.

    median, mean : over the pixels, spikes per readout.
    log_sd : standard deviation of the natural logarithm, over the pixels that fired.
    hot_fraction : pixels above four times the median.
    silent_fraction : pixels that never fired.
    """

    median: float
    mean: float
    log_sd: float
    hot_fraction: float
    silent_fraction: float


def split_pattern_for_statistics(map_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the profile of columns (W,), that of rows (H,) and the rest (H, W) of a map over its mean, each of mean 0.

    Pixels that are not finite count as 1.
    """
    relative = map_ / np.nanmean(map_[np.isfinite(map_)])
    relative = np.where(np.isfinite(relative), relative, 1.0)
    columns, rows = relative.mean(axis=0) - relative.mean(), relative.mean(axis=1) - relative.mean()
    return columns, rows, relative - relative.mean() - columns - rows[:, None]


def band_statistics_of_pattern(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance in each of :data:`BANDS`, from its periodogram."""
    power = np.abs(np.fft.rfft(profile - profile.mean())) ** 2
    if profile.size % 2 == 0:
        power[-1] /= 2  # the highest frequency stands once among the two halves of the spectrum, all others twice
    frequency = np.fft.rfftfreq(profile.size)
    total = power[1:].sum()
    edges = (0.0, *BANDS)
    inside = [(frequency > low) & (frequency <= high) for low, high in pairwise(edges)]
    return tuple(float(power[band].sum() / total) if total > 0 else float("nan") for band in inside)


def legendre_statistics_of_pattern(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance that Legendre fits of each of :data:`DEGREES` hold."""
    place = np.linspace(-1, 1, profile.size)
    variance = profile.var()
    if not variance > 0:
        return (float("nan"),) * len(DEGREES)
    fits = [np.polynomial.legendre.Legendre.fit(place, profile, min(d, profile.size - 1))(place) for d in DEGREES]
    return tuple(float(1 - (profile - fit).var() / variance) for fit in fits)


def measure_pattern_statistics(map_: np.ndarray) -> PatternStatistics:
    """Return the statistics of a map (H, W), such as the rates of a flat field."""
    columns, rows, white = split_pattern_for_statistics(map_)
    deviation = white - np.median(white)
    robust = float(ROBUST * np.median(np.abs(deviation)))
    beyond = [float(np.mean(np.abs(deviation) > n * robust)) if robust > 0 else float("nan") for n in (5, 10)]
    variance = white.var()
    held = np.clip(deviation, -3 * robust, 3 * robust)
    held -= held.mean()
    pairs = float(np.mean(held[:, 1:] * held[:, :-1])) if white.shape[1] > 1 else 0.0
    known = map_[np.isfinite(map_)]
    return PatternStatistics(
        mean=float(known.mean()),
        rms=float(known.std() / known.mean()),
        column_rms=float(columns.std()),
        row_rms=float(rows.std()),
        white_rms=float(np.sqrt(variance)),
        white_robust_rms=robust,
        white_kurtosis=float(np.mean(white**4) / variance**2) if variance > 0 else float("nan"),
        beyond_5=beyond[0],
        beyond_10=beyond[1],
        neighbour_correlation=float(pairs / held.var()) if robust > 0 else float("nan"),
        column_bands=band_statistics_of_pattern(columns),
        row_bands=band_statistics_of_pattern(rows),
        column_degrees=legendre_statistics_of_pattern(columns),
        row_degrees=legendre_statistics_of_pattern(rows),
    )


def measure_dark_statistics(rates: np.ndarray) -> DarkStatistics:
    """Return the statistics of the rates of a dark recording, (H, W), spikes per readout."""
    median = float(np.median(rates))
    fired = rates[rates > 0]
    return DarkStatistics(
        median=median,
        mean=float(rates.mean()),
        log_sd=float(np.log(fired).std()) if fired.size else float("nan"),
        hot_fraction=float(np.mean(rates > 4 * median)) if median > 0 else float("nan"),
        silent_fraction=1 - fired.size / rates.size,
    )
