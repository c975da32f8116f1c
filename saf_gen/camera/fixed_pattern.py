"""The fixed pattern of a device: constant differences between its pixels.

The response is a smooth surface (Legendre polynomials of columns and rows, and the product of both tilts), a first
column and a first row that differ, white noise of columns, rows and pixels, and a part that goes with dark charge, as
the calibration map of a real chip shows them: docs/explanation/spike-camera.md.
"""

from dataclasses import dataclass
from math import exp, log, sqrt

import numpy as np
from numpy.polynomial import legendre
from scipy.special import ndtr

from saf_gen.camera.sensor import Sensor
from saf_gen.core.seeds import make_generator

# exp, log and sin differ in the last digit between processors: maps are rounded to this fraction of their
# mean, far above such differences and far below any noise, so that they cannot change a spike.
_GRID = 2.0**-16


@dataclass(frozen=True)
class FixedPattern:
    """The maps of a device, float32 (row, col).

    response : relative photo-response, mean 1 before dust and dead pixels.
    dark : dark charge at the sensor's temperature, e- per readout.
    threshold : mean firing threshold, e-.
    """

    response: np.ndarray
    dark: np.ndarray
    threshold: np.ndarray


def draw_sensor_fixed_pattern(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> FixedPattern:
    """Return the maps of the device ``seed`` for any array shape; what is switched off is flat.

    The profiles span the array that is drawn, whatever its size, so that their spread is the sensor's; the first column
    and row are those of that array.
    """
    dark = _draw_relative_dark(sensor, shape, seed=seed)
    response = _draw_response(sensor, dark, seed=seed) if sensor.noise.response else np.ones(shape)
    dead = _draw_dead(sensor, shape, seed=seed)
    response = np.where(dead, 0.0, response * _draw_dust_transmission(sensor, shape, seed=seed))
    return FixedPattern(
        response=_round_to_grid(response, 1.0),
        dark=_round_to_grid(np.where(dead, 0.0, dark * sensor.mean_dark_e), sensor.mean_dark_e),
        threshold=_draw_threshold(sensor, shape, seed=seed),
    )


def _round_to_grid(map_: np.ndarray, unit: float) -> np.ndarray:
    return (np.rint(map_ / (unit * _GRID)) * (unit * _GRID) if unit else map_).astype(np.float32)


def _draw_profile(length: int, rms: float, *, shares: tuple[float, ...], random: np.random.Generator) -> np.ndarray:
    """Return Legendre terms with these shares of the variance and random signs, and white noise for the rest."""
    white = random.standard_normal(length) * sqrt(max(0.0, 1.0 - sum(shares)))
    signs = random.integers(0, 2, len(shares)) * 2 - 1
    return rms * (_unit_legendre(length, len(shares)) @ (signs * np.sqrt(shares)) + white)


def _unit_legendre(length: int, degree: int) -> np.ndarray:
    """Return Legendre polynomials of degree 1 to ``degree`` at pixel centres, of mean square 1: (length, degree)."""
    centre = (2 * np.arange(length) + 1) / length - 1
    return legendre.legvander(centre, degree)[:, 1:] * np.sqrt(2 * np.arange(1, degree + 1) + 1)


def _draw_response(sensor: Sensor, dark: np.ndarray, *, seed: int) -> np.ndarray:
    """Return the response of the chip, mean 1; ``dark`` is relative to its expectation."""
    rows, columns = dark.shape
    column_random, row_random, white_random, twist_random, dark_random = (
        make_generator("device", seed, f"response {kind}") for kind in ("columns", "rows", "white", "twist", "dark")
    )
    per_dark = 1.0 + sensor.response_per_dark_spread * dark_random.standard_normal(dark.shape)
    twist = sensor.response_twist_rms * (2 * int(twist_random.integers(0, 2)) - 1)
    response = (
        1.0
        + _draw_profile(
            columns, sensor.response_column_rms, shares=sensor.response_column_legendre, random=column_random
        )
        + _draw_profile(rows, sensor.response_row_rms, shares=sensor.response_row_legendre, random=row_random)[:, None]
        + twist * _unit_legendre(rows, 1) * _unit_legendre(columns, 1).T
        + sensor.response_white_rms * white_random.standard_normal(dark.shape)
        + sensor.response_per_dark * (per_dark * dark - 1.0)
    )
    response[:, 0] += sensor.response_first_column
    response[0] += sensor.response_first_row
    response = np.maximum(response, 0.0)
    mean = response.mean()
    return response / mean if mean > 0 else np.ones_like(response)


def _draw_dust_transmission(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    """Return the light that specks let through to each pixel, 0 to 1."""
    random = make_generator("device", seed, "dust")
    covered = random.random(shape) < sensor.dust_fraction * sensor.noise.dust
    depth = np.abs(random.standard_normal(shape)) * sensor.dust_depth_rms
    return np.where(covered, np.maximum(1.0 - depth, 0.0), 1.0)


def _draw_dead(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    return make_generator("device", seed, "dead").random(shape) < sensor.dead_fraction * sensor.noise.dead


def _draw_relative_dark(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    """Return dark charge over its expectation: log-normal, and hot pixels by a Pareto law from the hot level on.

    The scale is set by the expectation, not by the mean of this array: a device may well be darker.
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
    # At the widest allowed spread (0.2), five standard deviations would reach a threshold of 0.
    return _round_to_grid(sensor.threshold_e * np.maximum(1.0 + spread, 0.25), sensor.threshold_e)
