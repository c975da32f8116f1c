"""Fit of flat fields at several levels: the response of each pixel, the levels, and the loss after a spike.

At the light λ, a pixel with response g and dark rate D, both in units of its threshold, has the mean interval

    m = 1/(λ·g + D) + ℓ

in readouts, because the charge of ℓ readouts is lost after each spike. ℓ is the reset loss, or 1 if the readout after a
spike is dead. The levels are unknown, but pixels differ in g: their intervals at two levels, plotted against each
other, lie on a line that meets the diagonal at ℓ, the limit of infinite light. Two levels are therefore enough, and the
more the pixels differ, the more precise is ℓ.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from saf_gen.calibration.estimates import Estimate, normal_estimate
from saf_gen.calibration.spike_statistics import SpikeStatistics

_NEWTON = 3
_MIN_RELIABILITY = 0.9


@dataclass(frozen=True)
class ResponseFit:
    """The joint fit of flat fields at K levels.

    Maps are NaN for pixels that fired fewer than 16 times in one of the flat fields, or whose dark rate is half or more
    of their rate there.

    Attributes
    ----------
    response : ndarray, shape (H, W)
        Relative response divided by threshold, mean 1.
    error : ndarray, shape (H, W)
        Standard error of each response.
    levels : ndarray, shape (K,)
        Light of each level, spikes per readout of a mean pixel without dark charge.
    loss : Estimate or None
        Readouts lost after a spike, ℓ; None with one level.
    misfit : float
        χ² of the pixels about the law per degree of freedom, 1 if the law holds; NaN with one level.
    misfit_rms : float
        Relative rms of the residuals beyond noise; NaN with one level.
    """

    response: np.ndarray
    error: np.ndarray
    levels: np.ndarray
    loss: Estimate | None
    misfit: float
    misfit_rms: float


def fit_response(
    flats: list[SpikeStatistics], dark: np.ndarray, *, dark_error: np.ndarray, noise: float, loss: float = 0.0
) -> ResponseFit:
    """Return the response of the pixels, the levels, and the loss after a spike.

    The fit is by maximum likelihood, and the response of each pixel is an unknown. The interval of ℓ comes from the
    scatter of the pixels (sandwich estimator, Huber 1967), so that it remains valid if the noise of the pixels differs
    somewhat from the law.

    Parameters
    ----------
    flats : list of SpikeStatistics
        Statistics of the flat fields.
    dark : ndarray, shape (H, W)
        Dark rate of each pixel, spikes per readout.
    dark_error : ndarray, shape (H, W)
        Standard error of each dark rate.
    noise : float
        Relative variance of an interval, v = 1/θ + σ², for the weights of the pixels; it need not be exact.
    loss : float, default 0
        ℓ to start from, and to assume if there is only one level or the pixels differ too little.
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
        found = normal_estimate(float(fit.x[-1]), error, how="intervals at one level against intervals at another")
        if _reliability(m, variance) < _MIN_RELIABILITY:
            found = Estimate(loss, -np.inf, np.inf, "the pixels differ too little from each other", measured=False)
        else:
            loss = found.value
        levels = np.mean(1 / (m[0] - float(fit.x[-1])) - d) * np.exp(np.concatenate([[0.0], fit.x[:-1]]))
        freedom = off.shape[1] * (len(flats) - 1) - fit.x.size
        misfit = float((off**2).sum() / freedom)
        relative_noise = np.sqrt(variance) / m
        misfit_rms = float(np.sqrt(max(misfit - 1, 0) * np.mean(relative_noise**2) / max(len(flats) - 1, 1)))
    slope = levels[:, None] * (m - loss) ** 2  # change of an interval with the response
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
    """Return the fraction of the variance of intervals over the pixels that is not noise, at the worst level."""
    return float(np.min(1 - variance.mean(axis=1) / np.maximum(m.var(axis=1), 1e-300)))


def _profile(
    unknown: np.ndarray, m: np.ndarray, *, dark: np.ndarray, variance: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals of K·P intervals, in standard deviations, and the P responses that minimise them.

    ``unknown`` holds the logarithms of the levels 2 to K, each divided by level 1, and the loss ℓ. Level 1 is the mean
    rate without dark charge, so that responses are relative to it.
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


def infer_saturation(loss: Estimate | None) -> tuple[str, Estimate] | None:
    """Return the law of saturation and the reset loss that follow from a loss after a spike.

    Returns None if the loss is unknown or its interval is wider than 0.6 readouts.
    """
    if loss is None or loss.high - loss.low > 0.6:
        return None
    if loss.value > 0.9:  # nearly a full readout is lost
        return "dead_readout", Estimate(0.0, 0.0, 1.0, "no effect: the readout after a spike is dead", measured=False)
    cut = [min(max(x, 0.0), 1.0) for x in (loss.value, loss.low, loss.high)]
    return "subtract", Estimate(cut[0], cut[1], cut[2], loss.how)
