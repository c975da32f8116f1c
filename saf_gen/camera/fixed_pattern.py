"""The fixed pattern of a device: constant differences between its pixels."""

from dataclasses import dataclass
from math import exp, log

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from saf_gen.camera.sensor import Sensor
from saf_gen.core.seeds import make_generator

# exp, log and sin differ in the last digit between processors: maps are rounded to this fraction of their
# mean, far above such differences and far below any noise, so that they cannot change a spike.
_GRID = 2.0**-16

# Fraction of the array's side over which a profile varies; calibrations show a few waves across it.
_SMOOTH = 1 / 16


@dataclass(frozen=True)
class FixedPattern:
    """The maps of a device, float32 (row, col).

    response : relative photo-response, mean 1.
    dark : dark charge, e- per readout.
    threshold : mean firing threshold, e-.
    """

    response: np.ndarray
    dark: np.ndarray
    threshold: np.ndarray


def draw_fixed_pattern(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> FixedPattern:
    """Return the maps of the device ``seed`` for any array shape; noise that is switched off is flat."""
    return FixedPattern(
        response=_draw_response(sensor, shape, seed=seed) if sensor.noise.response else np.ones(shape, np.float32),
        dark=_draw_dark(sensor, shape, seed=seed) if sensor.noise.dark else np.zeros(shape, np.float32),
        threshold=_draw_threshold(sensor, shape, seed=seed),
    )


def _round_to_grid(map_: np.ndarray, unit: float) -> np.ndarray:
    return (np.rint(map_ / (unit * _GRID)) * (unit * _GRID)).astype(np.float32)


def _draw_profile(length: int, rms: float, *, random: np.random.Generator) -> np.ndarray:
    """Return a smooth profile of mean 0 and exactly this rms."""
    smooth = gaussian_filter1d(random.standard_normal(length), max(1.0, length * _SMOOTH), mode="reflect")
    smooth -= smooth.mean()
    spread = smooth.std()
    return smooth * (rms / spread) if spread > 0 else smooth  # a single pixel has no profile


def _draw_response(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    column_random, row_random, white_random = (
        make_generator("device", seed, f"response {kind}") for kind in ("columns", "rows", "white")
    )
    columns = _draw_profile(shape[1], sensor.response_column_rms, random=column_random)
    rows = _draw_profile(shape[0], sensor.response_row_rms, random=row_random)
    white = white_random.standard_normal(shape) * sensor.response_white_rms
    return _round_to_grid(np.maximum(1.0 + columns + rows[:, None] + (white - white.mean()), 0.0), 1.0)


def _draw_dark(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    """Return log-normal dark charge with hot pixels, whose excess over the hot level is a folded log-normal.

    The scale is set by the expectation, not by the mean of this array: a device may well be darker.
    """
    sd, factor = sensor.dark_log_sd, sensor.dark_hot_factor
    tail = float(ndtr(-log(factor) / sd)) if sd > 0 else 0.0
    extra = max(0.0, (sensor.dark_hot_fraction - tail) / (1.0 - tail)) if tail < 1 else 0.0
    cold_mean = exp(sd * sd / 2)
    hot_mean = factor * 2 * cold_mean * float(ndtr(sd))
    median = sensor.dark_rate * sensor.threshold_e / ((1 - extra) * cold_mean + extra * hot_mean)
    spread = make_generator("device", seed, "dark spread").standard_normal(shape) * sd
    hot = make_generator("device", seed, "dark hot").random(shape) < extra
    dark = median * np.where(hot, factor * np.exp(np.abs(spread)), np.exp(spread))
    return _round_to_grid(dark, sensor.dark_rate * sensor.threshold_e) if median > 0 else np.zeros(shape, np.float32)


def _draw_threshold(sensor: Sensor, shape: tuple[int, int], *, seed: int) -> np.ndarray:
    spread = np.zeros(shape)
    if sensor.noise.threshold_spread:
        spread = make_generator("device", seed, "threshold").standard_normal(shape) * sensor.threshold_spread_rms
    # At the widest allowed spread (0.2), five standard deviations would reach a threshold of 0.
    return _round_to_grid(sensor.threshold_e * np.maximum(1.0 + spread, 0.25), sensor.threshold_e)
