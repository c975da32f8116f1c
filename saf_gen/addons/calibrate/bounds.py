"""Upper bounds on a sensor's noise, fixed pattern and dark rate from one ordinary recording.

Neither a flat field nor a dark recording is needed.
"""

from dataclasses import replace
from math import sqrt

import numpy as np

from saf_gen.addons.calibrate.estimates import Estimate
from saf_gen.addons.calibrate.interval_noise import fit_interval_noise
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics, flat_areas
from saf_gen.errors import BadInput

_BLOCK = 8
MIN_PIXELS = 500


def noise_bounds(statistics: SpikeStatistics, *, where: str = "") -> dict[str, Estimate]:
    """Return upper bounds on a sensor's parameters, by key, from a recording of any scene.

    The light adds its own variation to the sensor's, so the observed variation is an upper bound. The fixed pattern
    is measured in the flattest quarter of the picture. The loss after a spike is unknown and assumed to be one full
    readout; a smaller loss would only lower the bounds.

    Parameters
    ----------
    statistics : SpikeStatistics
        Statistics of the recording.
    where : str, optional
        Name of the recording in error messages.

    Returns
    -------
    dict of str to Estimate
        Bounds by key, as intervals from 0 to the bound.

    Raises
    ------
    BadInput
        If fewer than 500 pixels fire at least 16 times with a mean interval above 2 readouts.
    """
    usable = (statistics.counts >= 16) & (statistics.interval > 2)
    if usable.sum() < MIN_PIXELS:
        needed = int(np.ceil(16 / max(float(np.median(statistics.counts)) / statistics.shape[0], 1e-9)))
        raise BadInput(
            f"only {usable.sum()} pixels fire 16 times or more in {statistics.shape[0]} readouts",
            where=where,
            allowed=f"at least {MIN_PIXELS} pixels",
            hint=f"record about {needed} readouts, or with more light" if needed < 10**7 else "record with more light",
        )
    noise = _noise_bound(statistics, usable)
    flat = flat_areas(statistics.rates) & usable
    charge = statistics.rates / (1 - np.minimum(statistics.rates, 0.9))
    column_steps, row_steps = np.diff(charge, axis=1), np.diff(charge, axis=0)
    means = (charge[:, 1:] + charge[:, :-1]) / 2
    both = flat[:, 1:] & flat[:, :-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = (column_steps / means)[both]
    white = float(np.sqrt(np.mean(relative**2) / 2)) if relative.size else float("inf")
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = _line_noise(column_steps / means, axis=0)
        rows = _line_noise(row_steps / ((charge[1:] + charge[:-1]) / 2), axis=1)
    rate = statistics.counts / statistics.shape[0]
    height, width = (n // _BLOCK * _BLOCK for n in rate.shape)
    blocks = rate[:height, :width].reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK).mean(axis=(1, 3))
    darkest = float(blocks.min()) if blocks.size else float(rate.min())
    slack = 1 + 2 * 0.6 / _BLOCK
    return {
        "interval_noise": _upper_bound(noise, "smallest noise of second differences in four ranges of lags"),
        "threshold_noise_rms": _upper_bound(noise, "as interval_noise, which includes shot noise"),
        "white_and_threshold_rms": _upper_bound(white, "differences of neighbouring pixels in the flattest quarter"),
        "column_white_rms": _upper_bound(columns, "differences of neighbouring columns, median over rows"),
        "row_white_rms": _upper_bound(rows, "differences of neighbouring rows, median over columns"),
        "dark_rate": _upper_bound(darkest / (1 - min(darkest, 0.9)) * slack, f"the darkest {_BLOCK} × {_BLOCK} pixels"),
    }


def _upper_bound(value: float, how: str) -> Estimate:
    return Estimate(value, 0.0, value, how, measured=False)


def _noise_bound(statistics: SpikeStatistics, usable: np.ndarray) -> float:
    """Return an upper bound on the noise of intervals, √(1/θ + σ²), from the least noisy of four ranges of lags."""
    chosen = replace(statistics, counts=np.where(usable, statistics.counts, 0))
    found = [fit_interval_noise(chosen, loss=1.0, max_lag=lag) for lag in (2, 4, 16, 64)]
    ends = [value + 2 * error for value, error in found if np.isfinite(value) and np.isfinite(error)]
    return sqrt(min(ends)) if ends else float("inf")


def _line_noise(steps: np.ndarray, *, axis: int) -> float:
    """Return the rms of the white noise of columns or rows, from the median steps between neighbours."""
    medians = np.nanmedian(np.where(np.isfinite(steps), steps, np.nan), axis=axis)
    known = medians[np.isfinite(medians)]
    return float(1.4826 * np.median(np.abs(known - np.median(known))) / sqrt(2)) if known.size else float("inf")
