"""Closed forms with which several checks compare, written from docs and not from the code under test.

Lengths are in metres, charge in electrons per readout, rates in spikes per readout.
"""

import math

import numpy as np
from scipy.constants import c, h

from saf_gen.camera.sensor import Sensor


def charge_per_radiance(
    sensor: Sensor,
    *,
    f_number: float,
    focal_length_m: float,
    image_distance_m: float | np.ndarray,
    off_axis_m: float | np.ndarray,
) -> np.ndarray:
    """Return the photo-electrons per readout at 1 W m⁻² sr⁻¹: π·R²/v²·cos⁴ϑ·pitch²·FF·QE·λ/(h·c)/F.

    ``off_axis_m`` is the distance of a pixel from the axis; it is broadcast against ``image_distance_m``.
    """
    v, x = np.asarray(image_distance_m, np.float64), np.asarray(off_axis_m, np.float64)
    radius = focal_length_m / (2 * f_number)
    solid_angle = np.pi * radius**2 / v**2 * (v**2 / (v**2 + x**2)) ** 2
    area = sensor.pitch_m**2 * sensor.fill_factor
    return solid_angle * area * sensor.quantum_efficiency * sensor.wavelength_m / (h * c) / sensor.readout_hz


def firing_rate(charge: float | np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the rate of a pixel without fixed pattern, q/(θ + ℓ·q), at most 1; ℓ is the loss after a spike."""
    charge = np.asarray(charge, np.float64)
    lost = 1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss
    return np.minimum(charge / (sensor.threshold_e + lost * charge), 1.0)


def charge_of_rate(rate: float | np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the charge at which a pixel fires at ``rate``: the inverse of :func:`firing_rate`, unsaturated."""
    lost = 1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss
    return np.asarray(rate) * sensor.threshold_e / (1 - lost * np.asarray(rate))


def off_axis(shape: tuple[int, int], pitch_m: float) -> np.ndarray:
    """Return the distance (m) of each pixel of an array (row, col) from the axis through the middle of the array."""
    rows = (np.arange(shape[0]) - (shape[0] - 1) / 2) * pitch_m
    columns = (np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch_m
    return np.hypot(rows[:, None], columns)


def off_axis_columns(shape: tuple[int, int], pitch_m: float) -> np.ndarray:
    """Return the signed distance (m) of each column of an array from the middle of the array."""
    return np.asarray((np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch_m)


def count_variance(mean: float | np.ndarray, variance: float | np.ndarray) -> np.ndarray:
    """Return the variance of a count, or of an interval in readouts, of a pixel with a uniformly distributed phase.

    A continuous quantity X, such as the charge of a window in thresholds, is counted as one of the two nearest
    integers. For a normal X with mean m and variance s², Var N = s² + 1/6 − π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k²
    (docs/spike-camera.md).

    Parameters
    ----------
    mean, variance : float or ndarray
        Mean m, and variance s², above 0; they are broadcast against each other.
    """
    m, damping = np.asarray(mean, np.float64), 2 * np.pi**2 * np.asarray(variance, np.float64)
    total = damping / (2 * np.pi**2) + 1 / 6 + np.zeros_like(m)
    for k in range(1, math.ceil(math.sqrt(40 / damping.min())) + 1):  # later terms are below exp(−40)
        total -= np.cos(2 * np.pi * k * m) * np.exp(-(k**2) * damping) / (np.pi * k) ** 2
    return np.asarray(total)


def autocovariance(frames: int, lags: np.ndarray, *, rate: float, per_spike: float) -> np.ndarray:
    """Return the covariance of the counts of two windows of one pixel, ``lags`` windows apart, under constant light.

    Let V(n) be the variance of a count over n readouts by the exact law, with V(0) = 0. The covariance is half the
    second difference of V over the lags: (V((j + 1)·n) − 2·V(j·n) + V((j − 1)·n))/2.

    Parameters
    ----------
    frames : int
        Readouts per window, n.
    lags : ndarray of int
        Lags j in windows, 0 or more, of any shape.
    rate : float
        Spikes per readout.
    per_spike : float
        Relative variance of one interval, 1/θ + σ².

    Returns
    -------
    ndarray of float64
        Covariance (counts²) for each lag, with the shape of ``lags``.
    """
    lags = np.asarray(lags)

    def variance(windows: np.ndarray) -> np.ndarray:
        mean = np.abs(windows) * frames * rate
        some = np.where(mean > 0, mean, frames * rate)
        return np.where(mean > 0, count_variance(some, some * per_spike), 0.0)

    return (variance(lags + 1) - 2 * variance(lags) + variance(lags - 1)) / 2


def exact_otf(fraction: np.ndarray | float, defocus_waves: float, *, points: int = 4000) -> np.ndarray:
    """Return the optical transfer, 1 at frequency 0.

    It is the overlap of two copies of the pupil that are shifted against each other by the frequency. In units of R,
    with the copies at ±s for the fraction s, a strip at x is 2·√(1 - (|x| + s)²) high, and the two copies differ in
    phase by 2π·W·4·s·x there.

    Parameters
    ----------
    fraction : ndarray or float, any shape
        Frequencies divided by the cut-off, 0 to 1.
    defocus_waves : float
        Wavefront error W at the edge of the aperture, wavelengths.
    points : int, default 4000
        Number of strips of the integral.

    References
    ----------
    H. H. Hopkins, The frequency response of a defocused optical system, Proc. R. Soc. A 231, 1955,
    doi:10.1098/rspa.1955.0158.
    """
    s = np.asarray(fraction, dtype=np.float64)[..., None]
    x = (np.arange(points) + 0.5) / points * (1 - s)
    height = 2 * np.sqrt(np.maximum(0, 1 - (x + s) ** 2))
    return np.asarray(
        np.mean(height * np.cos(8 * np.pi * defocus_waves * s * x), axis=-1) * 2 * (1 - s[..., 0]) / np.pi
    )


def sweep_mean(values: np.ndarray, window: range, *, frames: int) -> np.ndarray:
    """Return the mean over a window of a sweep of what is known at evenly spaced positions, along the first axis.

    Charge is interpolated linearly between positions, so this holds for pictures, and for all that is linear in them.
    """
    last = len(values) - 1
    at = (np.arange(window.start, window.stop) + 0.5) / frames * last
    before = np.minimum(at.astype(int), last - 1)
    weights = np.zeros(len(values))
    np.add.at(weights, before, 1 - (at - before))
    np.add.at(weights, before + 1, at - before)
    return np.asarray(np.tensordot(weights / len(window), np.asarray(values), 1))
