"""The dark rates of a chip, fitted to the counts of a dark recording by maximum likelihood.

The dark rates of most pixels are log-normal. Those of hot pixels, a few in a thousand, follow a Pareto law that starts
at a given multiple of the median. Dark rates are low: many pixels fire only a few times in a recording, and some never.
A count n over T readouts is ⌊X + u⌋, where X = rate·T is the charge in thresholds and the phase u is uniform over 0 to
1, so it only says that X is between n − 1 and n + 1. Hence

    P(n) = E max(0, 1 − |X − n|) = G(n + 1) − 2·G(n) + G(n − 1),    G(x) = E max(0, x − X)

and G has a closed form for both laws. The likelihood treats a pixel that never fired as censored.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from saf_gen.addons.calibrate.estimates import Estimate, binomial_interval, normal_estimate
from saf_gen.errors import BadInput

_MIN_SPIKES = 2.0
_MIN_HOT = 12
_EXPONENTS = (1.5, 20.0)
_STEP = 1e-3


@dataclass(frozen=True)
class DarkFit:
    """The fitted distribution of a chip's dark rates.

    Attributes
    ----------
    rate : Estimate
        Expected mean rate over the pixels, spikes per readout.
    log_sd : Estimate
        Standard deviation of the natural logarithm of the log-normal law.
    hot_fraction : Estimate
        Fraction of the pixels above ``factor`` times the median.
    hot_exponent : Estimate or None
        Exponent of the Pareto law; None if too few pixels are hot to fit it.
    median : float
        Median of the log-normal law, spikes per readout.
    silent : float
        Fraction of the pixels that did not fire.
    """

    rate: Estimate
    log_sd: Estimate
    hot_fraction: Estimate
    hot_exponent: Estimate | None
    median: float
    silent: float


def dark_probabilities(
    counts: np.ndarray, *, median: float, log_sd: float, extra: float, factor: float, exponent: float
) -> np.ndarray:
    """Return the probability of each count under the fitted law of dark rates.

    Parameters
    ----------
    counts : ndarray of int, any shape
        Spikes of a pixel in the recording.
    median : float
        Median of the log-normal law, spikes per recording.
    log_sd : float
        Standard deviation of the natural logarithm of the log-normal law.
    extra : float
        Fraction of the pixels that follow the Pareto law.
    factor : float
        Start of the Pareto law, in medians.
    exponent : float
        Exponent of the Pareto law.
    """

    def shortfall(x: np.ndarray) -> np.ndarray:
        at = np.maximum(x, 1e-12)
        z = np.log(at / median) / log_sd
        cold = at * ndtr(z) - median * np.exp(log_sd**2 / 2) * ndtr(z - log_sd)
        start = factor * median
        ratio = start / np.maximum(at, start)
        hot = np.maximum(at, start) - start - start / (exponent - 1) * (1 - ratio ** (exponent - 1))
        return np.where(x > 0, (1 - extra) * cold + extra * hot, 0.0)

    n = np.asarray(counts, np.float64)
    return shortfall(n + 1) - 2 * shortfall(n) + shortfall(n - 1)


def fit_dark(counts: np.ndarray, frames: int, *, factor: float, exponent: float, where: str = "") -> DarkFit:
    """Return the distribution of a chip's dark rates from the counts of its pixels in a dark recording.

    Parameters
    ----------
    counts : ndarray of int, any shape
        Spikes of each pixel that is not dead.
    frames : int
        Readouts of the recording.
    factor : float
        Multiple of the median above which a pixel counts as hot.
    exponent : float
        Exponent of the Pareto law to assume if too few pixels are hot to fit it.
    where : str, optional
        Name of the recording in error messages.

    Raises
    ------
    BadInput
        If the recording has fewer than 2 spikes per pixel on average; the message says how long it must be.
    """
    counts = np.asarray(counts).ravel()
    if counts.mean() < _MIN_SPIKES:
        needed = int(np.ceil(frames * _MIN_SPIKES / max(counts.mean(), 1 / counts.size)))
        raise BadInput(
            f"the dark recording has {counts.mean():.2g} spikes per pixel in {frames} readouts",
            where=where,
            allowed=f"at least {_MIN_SPIKES:g}",
            hint=f"record at least {needed} readouts",
        )
    seen, number = np.unique(counts, return_counts=True)
    middle = float(np.median(counts))
    fired = np.log(counts[counts > 0])
    sd = float(np.clip((np.quantile(fired, 0.84) - np.quantile(fired, 0.16)) / 2, 0.02, 1.5))
    many = int((counts > factor * max(middle, 1)).sum()) >= _MIN_HOT
    start = [np.log(max(middle, 1.0)), np.log(sd), np.log(2e-3)] + ([np.log(exponent - 1)] if many else [])

    def unpack(unknown: np.ndarray) -> dict[str, float]:
        tail = np.clip(np.exp(unknown[3]) + 1, *_EXPONENTS) if many else exponent
        return {
            "median": float(np.exp(unknown[0])),
            "log_sd": float(np.exp(unknown[1])),
            "extra": float(min(np.exp(unknown[2]), 0.5)),
            "factor": factor,
            "exponent": float(tail),
        }

    def loss(unknown: np.ndarray) -> float:
        p = dark_probabilities(seen, **unpack(unknown))
        return -float(number @ np.log(np.maximum(p, 1e-300)))

    fit = minimize(loss, start, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-6, "maxiter": 4000})
    cov = _covariance(loss, fit.x)
    here = unpack(fit.x)

    def delta(of: Callable[[dict[str, float]], float]) -> float:
        slopes = np.array([(of(unpack(fit.x + e)) - of(unpack(fit.x - e))) / (2 * _STEP) for e in _steps(fit.x.size)])
        return float(np.sqrt(max(slopes @ cov @ slopes, 0.0)))

    def rate(p: dict[str, float]) -> float:
        hot = p["factor"] * p["exponent"] / (p["exponent"] - 1)
        return p["median"] * ((1 - p["extra"]) * np.exp(p["log_sd"] ** 2 / 2) + p["extra"] * hot) / frames

    def hot_fraction(p: dict[str, float]) -> float:
        tail = float(ndtr(-np.log(p["factor"]) / p["log_sd"]))
        return p["extra"] + (1 - p["extra"]) * tail

    how = "maximum likelihood of the counts in the dark, including pixels that never fired"
    found = hot_fraction(here)
    tail = normal_estimate(here["exponent"], delta(lambda p: p["exponent"]), how=how, minimum=1)
    low, high = binomial_interval(round(found * counts.size), counts.size)
    return DarkFit(
        rate=normal_estimate(rate(here), delta(rate), how=how, minimum=0),
        log_sd=normal_estimate(here["log_sd"], delta(lambda p: p["log_sd"]), how=how, minimum=0),
        hot_fraction=Estimate(found, low, high, how),
        hot_exponent=tail if many else None,
        median=here["median"] / frames,
        silent=float(np.mean(counts == 0)),
    )


def _steps(size: int) -> np.ndarray:
    return np.eye(size) * _STEP


def _covariance(loss: Callable[[np.ndarray], float], at: np.ndarray) -> np.ndarray:
    """Return the inverse of a likelihood's curvature.

    Parameters on which the likelihood does not depend, such as the hot fraction if no pixel is hot, get 0.
    """
    steps = _steps(at.size) * 10
    curvature = np.empty((at.size, at.size))
    for i, a in enumerate(steps):
        for j, b in enumerate(steps):
            corners = loss(at + a + b) - loss(at + a - b) - loss(at - a + b) + loss(at - a - b)
            curvature[i, j] = corners / (4 * (10 * _STEP) ** 2)
    known = np.diag(curvature) > 1e-2
    out = np.zeros_like(curvature)
    out[np.ix_(known, known)] = np.linalg.pinv(curvature[np.ix_(known, known)])
    return out
