"""The fixed pattern of a device: constant differences between its pixels.

The response is the sum of a smooth surface (Legendre polynomials of columns and rows, and the product of both tilts),
an excess of the first column and the first row, white noise of columns, rows and pixels, and a part proportional to
dark charge. The calibration map of a real chip shows these parts: docs/spike-camera.md.
"""

from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from scipy.special import ndtr

from saf_gen.camera.sensor import Sensor
from saf_gen.core.seeds import make_generator

# exp, log and sin differ in the last digit between processors. Maps are rounded to this fraction of their mean, far
# above these differences and far below any noise, so that the differences cannot change a spike.
_GRID = 2.0**-16


@dataclass(frozen=True)
class FixedPattern:
    """The maps of a device, which hold the constant differences between its pixels.

    Attributes
    ----------
    response : ndarray of float32, shape (H, W)
        Relative photo-response, mean 1 before dust and dead pixels.
    dark : ndarray of float32, shape (H, W)
        Dark charge at the temperature of the sensor, electrons per readout.
    threshold : ndarray of float32, shape (H, W)
        Mean threshold, electrons.
    """

    response: np.ndarray
    dark: np.ndarray
    threshold: np.ndarray


def draw_fixed_pattern(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> FixedPattern:
    """Return the maps of a device.

    Imperfections that are switched off give flat maps. The profiles span the array of the given shape, so that their
    rms is the sensor's; the excess of the first column and row is at the edges of this array.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    shape : tuple of int
        Rows and columns of the array, which may differ from those of the sensor.
    seed : int
        Seed that identifies the device.
    """
    dark = draw_relative_dark(sensor, shape, seed=seed)
    response = _draw_response(sensor, dark, seed=seed) if sensor.noise.response else np.ones(shape)
    dead = _draw_dead(sensor, shape, seed=seed)
    response = np.where(dead, 0.0, response * _draw_dust_transmission(sensor, shape, seed=seed))
    return FixedPattern(
        response=_round_to_grid(response, 1.0),
        dark=_round_to_grid(np.where(dead, 0.0, dark * sensor.mean_dark_e), sensor.mean_dark_e),
        threshold=_draw_threshold(sensor, shape, seed=seed),
    )


def legendre_basis(length: int, degree: int) -> np.ndarray:
    """Return Legendre polynomials of degree 1 to ``degree`` at the pixel centres, with mean square 1 over the interval.

    The result has the shape (length, degree).
    """
    centre = (2 * np.arange(length) + 1) / length - 1
    return legendre.legvander(centre, degree)[:, 1:] * np.sqrt(2 * np.arange(1, degree + 1) + 1)


def _round_to_grid(map_: np.ndarray, unit: float) -> np.ndarray:
    return (np.rint(map_ / (unit * _GRID)) * (unit * _GRID) if unit else map_).astype(np.float32)


def _draw_profile(length: int, rms: float, *, fractions: tuple[float, ...], random: np.random.Generator) -> np.ndarray:
    """Return a sum of Legendre terms with random signs and of white noise.

    ``fractions`` are the fractions of the variance by degree, from degree 1; the rest of the variance is white noise.
    """
    white = random.standard_normal(length) * sqrt(max(0.0, 1.0 - sum(fractions)))
    signs = random.integers(0, 2, len(fractions)) * 2 - 1
    return rms * (legendre_basis(length, len(fractions)) @ (signs * np.sqrt(fractions)) + white)


def _draw_response(sensor: Sensor, dark: np.ndarray, *, seed: int) -> np.ndarray:
    """Return the response of the chip, mean 1; ``dark`` is the dark charge divided by its expected value."""
    rows, columns = dark.shape
    column_random, row_random, white_random, twist_random, dark_random = (
        make_generator("device", seed, f"response {kind}") for kind in ("columns", "rows", "white", "twist", "dark")
    )
    per_dark = 1.0 + sensor.response_per_dark_spread * dark_random.standard_normal(dark.shape)
    twist = sensor.response_twist_rms * (2 * int(twist_random.integers(0, 2)) - 1)
    response = (
        1.0
        + _draw_profile(
            columns, sensor.response_column_rms, fractions=sensor.response_column_legendre, random=column_random
        )
        + _draw_profile(rows, sensor.response_row_rms, fractions=sensor.response_row_legendre, random=row_random)[
            :, None
        ]
        + twist * legendre_basis(rows, 1) * legendre_basis(columns, 1).T
        + sensor.response_white_rms * white_random.standard_normal(dark.shape)
        + sensor.response_per_dark * (per_dark * dark - 1.0)
    )
    response[:, 0] += sensor.response_first_column
    response[0] += sensor.response_first_row
    response = np.maximum(response, 0.0)
    mean = response.mean()
    return response / mean if mean > 0 else np.ones_like(response)


def _draw_dust_transmission(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    """Return the fraction of light, 0 to 1, that dust lets through to each pixel."""
    random = make_generator("device", seed, "dust")
    covered = random.random(shape) < sensor.dust_fraction * sensor.noise.dust
    depth = np.abs(random.standard_normal(shape)) * sensor.dust_depth_rms
    return np.where(covered, np.maximum(1.0 - depth, 0.0), 1.0)


def _draw_dead(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    return make_generator("device", seed, "dead").random(shape) < sensor.dead_fraction * sensor.noise.dead


class DarkPixels(Protocol):
    """The numbers of a sensor by which the dark charge of its pixels differs; see :class:`saf_gen.camera.Sensor`."""

    @property
    def dark_log_sd(self) -> float:
        """Standard deviation of the natural logarithm."""
        ...

    @property
    def dark_hot_fraction(self) -> float:
        """Fraction of the pixels that are hot."""
        ...

    @property
    def dark_hot_factor(self) -> float:
        """Multiple of the median above which a pixel is hot."""
        ...

    @property
    def dark_hot_exponent(self) -> float:
        """Exponent of the Pareto law of hot pixels."""
        ...


def draw_relative_dark(sensor: DarkPixels, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    """Return dark charge divided by its expected value: log-normal, with a Pareto law for pixels above the hot level.

    The scale is the expected value and not the mean of this array, because the mean varies between devices.
    """
    sd, factor, exponent = sensor.dark_log_sd, sensor.dark_hot_factor, sensor.dark_hot_exponent
    tail = float(ndtr(-log(factor) / sd)) if sd > 0 else 0.0
    extra = max(0.0, (sensor.dark_hot_fraction - tail) / (1.0 - tail)) if tail < 1 else 0.0
    mean_in_medians = (1 - extra) * exp(sd * sd / 2) + extra * factor * exponent / (exponent - 1)
    spread = np.exp(make_generator("device", seed, "dark spread").standard_normal(shape) * sd)
    hot_random = make_generator("device", seed, "dark hot")
    is_hot = hot_random.random(shape) < extra
    hot = factor * (1.0 - hot_random.random(shape)) ** (-1 / exponent)
    return np.where(is_hot, hot, spread) / mean_in_medians


def _draw_threshold(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    spread = np.zeros(shape)
    if sensor.noise.threshold_spread:
        spread = make_generator("device", seed, "threshold").standard_normal(shape) * sensor.threshold_spread_rms
    # At the largest allowed spread (0.2), a deviation of -5 standard deviations would give a threshold of 0.
    return _round_to_grid(sensor.threshold_e * np.maximum(1.0 + spread, 0.25), sensor.threshold_e)
