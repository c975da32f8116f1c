"""Statistics of the fixed pattern: profiles of columns and rows, the white rest, and dark rates."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

BANDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Upper ends of the frequency bands into which the variance of a profile is divided, cycles per pixel."""
DEGREES = (1, 2, 4)
"""Degrees of the Legendre fits for which the explained fraction of a profile's variance is reported."""
ROBUST = 1.482602218505602
"""Standard deviation of a normal distribution divided by its median absolute deviation."""


@dataclass(frozen=True)
class PatternStatistics:
    """The fixed pattern of a map, relative to its mean.

    Attributes
    ----------
    mean : float
        Mean of the map, in the unit of the map.
    rms : float
        Rms of the map about its mean.
    column_rms, row_rms, white_rms : float
        Rms of the profile of columns, of the profile of rows, and of the white rest.
    white_robust_rms : float
        1.4826 times the median absolute deviation of the rest.
    white_kurtosis : float
        Fourth moment of the rest divided by its squared variance, 3 for a normal distribution.
    beyond_5, beyond_10 : float
        Fraction of the pixels whose rest is more than 5 or 10 robust rms away from its median.
    neighbour_correlation : float
        Correlation of the rest between neighbouring pixels of a row, clipped to 3 robust rms about the median, so that
        a few specks of dust do not dominate it.
    column_bands, row_bands : tuple of float
        Fraction of a profile's variance in each frequency band of :data:`BANDS`.
    column_degrees, row_degrees : tuple of float
        Fraction of a profile's variance that a Legendre fit of each degree in :data:`DEGREES` explains.
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
    """Statistics of the rates of a dark recording.

    Attributes
    ----------
    median, mean : float
        Median and mean over the pixels, spikes per readout.
    log_sd : float
        Standard deviation of the natural logarithm of the rate, over the pixels that fired.
    hot_fraction : float
        Fraction of the pixels above four times the median.
    silent_fraction : float
        Fraction of the pixels that never fired.
    """

    median: float
    mean: float
    log_sd: float
    hot_fraction: float
    silent_fraction: float


def split_pattern(map_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the column profile (W,), row profile (H,) and rest (H, W) of a map divided by its mean, each of mean 0.

    Pixels that are not finite count as equal to the mean of the map.
    """
    relative = map_ / np.nanmean(map_[np.isfinite(map_)])
    relative = np.where(np.isfinite(relative), relative, 1.0)
    columns, rows = relative.mean(axis=0) - relative.mean(), relative.mean(axis=1) - relative.mean()
    return columns, rows, relative - relative.mean() - columns - rows[:, None]


def band_statistics(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance in each frequency band of :data:`BANDS`, from its periodogram."""
    power = np.abs(np.fft.rfft(profile - profile.mean())) ** 2
    if profile.size % 2 == 0:
        power[-1] /= 2  # the full spectrum holds the highest frequency once and all others twice
    frequency = np.fft.rfftfreq(profile.size)
    total = power[1:].sum()
    edges = (0.0, *BANDS)
    inside = [(frequency > low) & (frequency <= high) for low, high in pairwise(edges)]
    return tuple(float(power[band].sum() / total) if total > 0 else float("nan") for band in inside)


def legendre_fractions(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance that a Legendre fit of each degree in :data:`DEGREES` explains."""
    position = np.linspace(-1, 1, profile.size)
    variance = profile.var()
    if not variance > 0:
        return (float("nan"),) * len(DEGREES)
    fits = [np.polynomial.legendre.Legendre.fit(position, profile, min(d, profile.size - 1))(position) for d in DEGREES]
    return tuple(float(1 - (profile - fit).var() / variance) for fit in fits)


def measure_pattern(map_: np.ndarray) -> PatternStatistics:
    """Return the pattern statistics of a map of shape (H, W), such as the rates of a flat field."""
    columns, rows, white = split_pattern(map_)
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
        column_bands=band_statistics(columns),
        row_bands=band_statistics(rows),
        column_degrees=legendre_fractions(columns),
        row_degrees=legendre_fractions(rows),
    )


def measure_dark(rates: np.ndarray) -> DarkStatistics:
    """Return the statistics of the rates of a dark recording, given in spikes per readout with shape (H, W)."""
    median = float(np.median(rates))
    fired = rates[rates > 0]
    return DarkStatistics(
        median=median,
        mean=float(rates.mean()),
        log_sd=float(np.log(fired).std()) if fired.size else float("nan"),
        hot_fraction=float(np.mean(rates > 4 * median)) if median > 0 else float("nan"),
        silent_fraction=1 - fired.size / rates.size,
    )
