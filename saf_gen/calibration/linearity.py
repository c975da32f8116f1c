"""Flat fields of several levels: the response of each pixel, the levels, and what is lost after a spike.

At the light λ a pixel of response g and dark rate D has intervals of mean

    m = 1/(λ·g + D) + ℓ

readouts, g and D in units of its own threshold: ℓ readouts' worth of charge are lost after a spike. ℓ is the reset
loss, or 1 where the readout after a spike is dead. No level is known. But pixels differ in g, and the intervals of
one level against those of another lie on a line that meets the diagonal at ℓ, where the light would be infinite. So
two levels are enough, and the steeper the pixels differ, the better ℓ is known.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from saf_gen.calibration.estimates import Estimate, normal_estimate_of_fit
from saf_gen.calibration.spike_statistics import SpikeStatistics

_NEWTON = 3
_LEAST_RELIABILITY = 0.9


@dataclass(frozen=True)
class ResponseFit:
    """What flat fields of K levels say together; maps are (H, W), NaN for pixels that did not fire in all of them.

    response : relative response over threshold, mean 1.
    error : standard error of each pixel's response.
    levels : light of each level, spikes per readout of a mean pixel, dark taken off, (K,).
    loss : ℓ, the readouts lost after a spike; None with one level.
    misfit : χ² of the pixels about the law over its degrees of freedom, 1 where the law holds; NaN with one level.
    misfit_rms : rms, over the response, of what the law leaves beyond noise.
    """

    response: np.ndarray
    error: np.ndarray
    levels: np.ndarray
    loss: Estimate | None
    misfit: float
    misfit_rms: float


def fit_sensor_response(
    flats: list[SpikeStatistics], dark: np.ndarray, *, dark_error: np.ndarray, noise: float, loss: float = 0.0
) -> ResponseFit:
    """Return the response of the pixels, the levels, and the loss after a spike.

    Maximum likelihood with the response of each pixel as an unknown of its own; the interval of ℓ is from the scatter
    of the pixels (a sandwich: Huber 1967), so that it holds where their noise is not quite the law's.

    Parameters
    ----------
    flats : statistics of the flat fields.
    dark : dark rate of each pixel, spikes per readout, (H, W).
    dark_error : its standard error.
    noise : v = 1/θ + σ² of an interval, for the weights of the pixels; it need not be exact.
    loss : ℓ that is taken where there is only one level.
    """
    shape = dark.shape
    interval = np.stack([f.interval.ravel() for f in flats])  # (K, P)
    number = np.stack([f.counts.ravel() - 1 for f in flats])
    use = (number >= 15).all(axis=0) & (dark.ravel() < 0.5 / interval).all(axis=0)
    m, n, d = interval[:, use], number[:, use], dark.ravel()[use]
    phases = np.maximum(noise * n * m**2 + 1 / 6, 1e-6) / n**2
    variance = phases + (m**2 * dark_error.ravel()[use]) ** 2
    gain = 1 / (m - loss) - d
    levels = gain.mean(axis=1)
    relative = np.average(gain / levels[:, None], axis=0, weights=levels**2)
    found, misfit, misfit_rms = None, float("nan"), float("nan")
    if len(flats) > 1:

        def residuals(unknown: np.ndarray) -> np.ndarray:
            return _profile(unknown, m, dark=d, variance=variance, start=relative)[0].ravel()

        start = np.append(np.log(levels / levels[0])[1:], loss)
        fit = least_squares(
            residuals, start, x_scale=np.append(np.full(len(flats) - 1, 1e-3), 1e-2), method="lm", diff_step=1e-5
        )
        off, relative = _profile(fit.x, m, dark=d, variance=variance, start=relative)
        score = np.einsum("kp,kpu->pu", off, fit.jac.reshape(*off.shape, -1))
        bread = np.linalg.inv(fit.jac.T @ fit.jac)
        error = float(np.sqrt((bread @ (score.T @ score) @ bread)[-1, -1]))
        found = normal_estimate_of_fit(
            float(fit.x[-1]), error, how="the line of intervals of one level against another"
        )
        if _reliability(m, variance) < _LEAST_RELIABILITY:
            found = Estimate(loss, -np.inf, np.inf, "pixels differ too little from each other", measured=False)
        else:
            loss = found.value
        levels = np.mean(1 / (m[0] - float(fit.x[-1])) - d) * np.exp(np.concatenate([[0.0], fit.x[:-1]]))
        freedom = off.shape[1] * (len(flats) - 1) - fit.x.size
        misfit = float((off**2).sum() / freedom)
        relative_noise = np.sqrt(variance) / m
        misfit_rms = float(np.sqrt(max(misfit - 1, 0) * np.mean(relative_noise**2) / max(len(flats) - 1, 1)))
    slope = levels[:, None] * (m - loss) ** 2  # of an interval with the response
    error_map = 1 / np.sqrt((slope**2 / variance).sum(axis=0))
    scale = relative.mean()
    return ResponseFit(
        response=_spread(relative / scale, use, shape=shape),
        error=_spread(error_map / scale, use, shape=shape),
        levels=levels * scale,
        loss=found,
        misfit=misfit,
        misfit_rms=misfit_rms,
    )


def _reliability(m: np.ndarray, variance: np.ndarray) -> float:
    """Return the fraction of the intervals' variance over the pixels that is not their noise, at the worst level."""
    return float(np.min(1 - variance.mean(axis=1) / np.maximum(m.var(axis=1), 1e-300)))


def _profile(
    unknown: np.ndarray, m: np.ndarray, *, dark: np.ndarray, variance: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what the law leaves of the intervals, in standard deviations, (K, P), and the response (P,) that leaves
    least.

    The first level is held at 1: the response is in spikes per readout of that level over its mean.
    """
    ratio, loss = np.exp(np.concatenate([[0.0], unknown[:-1]]))[:, None], unknown[-1]
    first = np.mean(1 / (m[0] - loss) - dark)
    g = start
    for _ in range(_NEWTON):
        rate = first * ratio * g + dark
        off, slope = m - loss - 1 / rate, first * ratio / rate**2
        g = g - (off * slope / variance).sum(axis=0) / (slope**2 / variance).sum(axis=0)
    rate = first * ratio * g + dark
    return (m - loss - 1 / rate) / np.sqrt(variance), g


def _spread(values: np.ndarray, use: Any, *, shape: tuple[int, ...]) -> np.ndarray:
    out = np.full(use.size, np.nan)
    out[use] = values
    return out.reshape(shape)


def tell_fitted_saturation(loss: Estimate | None) -> tuple[str, Estimate] | None:
    """Return the law of saturation and the reset loss that a loss after a spike means; None where it tells neither."""
    if loss is None or loss.high - loss.low > 0.6:
        return None
    if loss.value > 0.9:  # a reset that takes nine tenths of a readout is a dead readout
        return "dead_readout", Estimate(0.0, 0.0, 1.0, "no effect: the readout after a spike is dead", measured=False)
    cut = [min(max(x, 0.0), 1.0) for x in (loss.value, loss.low, loss.high)]
    return "subtract", Estimate(cut[0], cut[1], cut[2], loss.how)
