"""Closed forms that several checks compare with, written anew from docs/explanation: nothing here calls the product.

Lengths are in metres, charge in electrons per readout, rates in spikes per readout.
"""

import numpy as np
from scipy.constants import c, h

from saf_gen.camera.counting_law import pixel_count_variance
from saf_gen.camera.sensor import Sensor


def charge_per_radiance_by_law(
    sensor: Sensor,
    *,
    f_number: float,
    focal_length_m: float,
    image_distance_m: float | np.ndarray,
    off_axis_m: float | np.ndarray,
) -> np.ndarray:
    """Return photo-electrons per readout for 1 W m⁻² sr⁻¹: π·R²/v²·cos⁴ϑ·pitch²·FF·QE·λ/(h·c)/F.

    ``off_axis_m`` is the distance of a pixel from the axis; it and ``image_distance_m`` fit each other.
    """
    v, x = np.asarray(image_distance_m, np.float64), np.asarray(off_axis_m, np.float64)
    radius = focal_length_m / (2 * f_number)
    solid_angle = np.pi * radius**2 / v**2 * (v**2 / (v**2 + x**2)) ** 2
    area = sensor.pitch_m**2 * sensor.fill_factor
    return solid_angle * area * sensor.quantum_efficiency * sensor.wavelength_m / (h * c) / sensor.readout_hz


def firing_rate_by_law(charge: float | np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the rate of a pixel without fixed pattern, q/(θ + ℓ·q), at most 1; ℓ is lost after a spike."""
    charge = np.asarray(charge, np.float64)
    lost = 1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss
    return np.minimum(charge / (sensor.threshold_e + lost * charge), 1.0)


def charge_of_rate_by_law(rate: float | np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the charge that fires at a rate: the inverse of :func:`firing_rate_by_law` below saturation."""
    lost = 1.0 if sensor.saturation == "dead_readout" else sensor.reset_loss
    return np.asarray(rate) * sensor.threshold_e / (1 - lost * np.asarray(rate))


def off_axis_distances_in_law(shape: tuple[int, int], pitch_m: float) -> np.ndarray:
    """Return the distance (m) of each pixel of an array (row, col) from the axis through its middle."""
    rows = (np.arange(shape[0]) - (shape[0] - 1) / 2) * pitch_m
    columns = (np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch_m
    return np.hypot(rows[:, None], columns)


def off_axis_columns_in_law(shape: tuple[int, int], pitch_m: float) -> np.ndarray:
    """Return how far (m) each column of an array lies from its middle, with its sign."""
    return np.asarray((np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch_m)


def window_autocovariance_by_law(frames: int, lags: np.ndarray, *, rate: float, per_spike: float) -> np.ndarray:
    """Return the covariance of the counts of two windows, ``lags`` windows apart, of one pixel under constant light.

    With V(n) the variance of a count over n readouts, by the exact law, that is half the second difference of V over
    the lags: (V((j + 1)·n) − 2·V(j·n) + V((j − 1)·n))/2, and V(0) = 0.

    Parameters
    ----------
    frames : readouts per window, n.
    lags : whole numbers from 0 on, any shape.
    rate : spikes per readout.
    per_spike : relative variance of one interval, 1/θ + σ².
    """
    lags = np.asarray(lags)

    def variance(windows: np.ndarray) -> np.ndarray:
        mean = np.abs(windows) * frames * rate
        some = np.where(mean > 0, mean, frames * rate)
        return np.where(mean > 0, pixel_count_variance(some, some * per_spike), 0.0)

    return (variance(lags + 1) - 2 * variance(lags) + variance(lags - 1)) / 2
