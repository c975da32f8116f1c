"""Fits of flat fields: the response of each pixel, the levels, the loss after a spike, and the parts of its pattern.

At the light λ, a pixel with response g and dark rate D, both in units of its threshold, has the mean interval

    m = 1/(λ·g + D) + ℓ

in readouts, because the charge of ℓ readouts is lost after each spike. ℓ is the reset loss, or 1 if the readout after a
spike is dead. The levels are unknown, but pixels differ in g: their intervals at two levels, plotted against each
other, lie on a line that meets the diagonal at ℓ, the limit of infinite light. Two levels are therefore enough, and the
more the pixels differ, the more precise is ℓ.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from saf_gen.addons.calibrate.estimates import NORMAL_95, Estimate, normal_estimate, root_estimate
from saf_gen.addons.calibrate.flat_checks import ROBUST
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics
from saf_gen.camera.fixed_pattern import legendre_basis

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


# Decomposition of a response map: column and row profiles, edges, twist, part due to dark charge, dust, white rest.
#
# The sensor model builds a map from the same parts (``saf_gen/camera/fixed_pattern.py``). The measurement noise of
# the
# pixels is subtracted from each part. White response and threshold spread cannot be separated, because a rate
# is charge divided by threshold.


DEGREE = 4
"""Highest degree of the Legendre polynomials that separate the smooth part of a profile from its white noise."""
DEEP = 5.0
"""Depth of a shadow, in robust standard deviations of the white rest, beyond which it counts as dust."""
_ROUNDS = 3


@dataclass(frozen=True)
class PatternFit:
    """The parts of a response map, relative to its mean.

    Attributes
    ----------
    estimates : dict of str to Estimate
        Estimates by key of the sensor, and ``white_and_threshold_rms``, the joint rms of white response and threshold
        spread.
    rest : ndarray, shape (H, W)
        Residual after profiles, twist and the part due to dark charge; NaN if the response of a pixel is unknown.
    columns : ndarray, shape (W,)
        Profile of the columns.
    rows : ndarray, shape (H,)
        Profile of the rows.
    """

    estimates: dict[str, Estimate]
    rest: np.ndarray
    columns: np.ndarray
    rows: np.ndarray


def fit_pattern(response: np.ndarray, error: np.ndarray, *, dark: np.ndarray) -> PatternFit:
    """Return the parts of a response map.

    Parameters
    ----------
    response : ndarray, shape (H, W)
        Relative response of each pixel, divided by its threshold; NaN if unknown.
    error : ndarray, shape (H, W)
        Standard error of each response.
    dark : ndarray, shape (H, W)
        Dark rate of each pixel, divided by the mean dark rate of the chip.
    """
    known = np.isfinite(response)
    inner = known.copy()
    inner[0], inner[:, 0] = False, False
    middle = float(response[inner].mean())
    relative = response / middle - 1
    noise = float(np.mean(error[inner] ** 2)) / middle**2
    excess, per_dark, rest = dark - 1, Estimate(0.0, 0.0, 0.0, ""), relative
    profiles = np.zeros(response.shape[1]), np.zeros(response.shape[0])
    shaped, twist_map = np.zeros_like(relative), _twist(response.shape)
    twist = 0.0
    white = float(np.nanstd(relative))
    for _ in range(_ROUNDS):  # dark charge and dust shift the mean of a line, so they are removed first
        usable = inner & (np.abs(relative - shaped - per_dark.value * excess) < DEEP * white)
        bare = np.where(usable, relative - per_dark.value * excess - twist * twist_map, np.nan)
        profiles = _profiles(bare)
        smooth = profiles[0] + profiles[1][:, None]
        twisted = np.where(usable, bare + twist * twist_map - smooth, 0)
        twist = float((twisted * twist_map).sum() / (twist_map[usable] ** 2).sum())
        shaped = smooth + twist * twist_map
        rest = relative - shaped
        per_dark = _slope(rest[usable], excess[usable])
        left = (rest - per_dark.value * excess)[usable]
        white = float(ROBUST * np.median(np.abs(left - np.median(left))))
    left = rest - per_dark.value * excess
    core = inner & (np.abs(left) < DEEP * white)
    estimates = _fit_white(left[core] ** 2, dark[core], noise=noise, size=response.shape)
    pixel_variance = float(np.mean(left[core] ** 2))  # variance of a pixel: white, spread with dark charge, and noise
    estimates["white_and_threshold_rms"] = _correct_for_dark_part(estimates["white_and_threshold_rms"], per_dark)
    for name, profile, length in (
        ("column", profiles[0], response.shape[0]), ("row", profiles[1], response.shape[1])
    ):  # fmt: skip
        estimates |= _fit_profile(
            name, profile[1:], noise=pixel_variance / max(length - 1, 1), full_length=profile.size
        )
    estimates["response_twist_rms"] = normal_estimate(
        abs(twist), sqrt(pixel_variance / core.sum()), how="product of the two tilts in the response map", minimum=0
    )
    if per_dark.how:
        estimates["response_per_dark"] = _subtract_threshold_part(
            per_dark, estimates["white_and_threshold_rms"], variance=float(np.var(excess[core & (excess < 9)]))
        )
    edges = {"response_first_column": (profiles[0], left[1:, 0]), "response_first_row": (profiles[1], left[0, 1:])}
    for key, (profile, edge) in edges.items():
        off = edge[np.isfinite(edge)] - profile[0] + _edge(profile)
        estimates[key] = normal_estimate(
            float(np.median(off)) if off.size else 0.0,
            1.2533 * sqrt(pixel_variance / max(off.size, 1) + _white_noise_rms(profile) ** 2),
            how="edge compared with the extrapolated profile",
        )
    estimates |= _fit_dust(left[inner] / white, white)
    return PatternFit(estimates, np.where(known, left, np.nan), profiles[0], profiles[1])


def _twist(shape: tuple[int, ...]) -> np.ndarray:
    return legendre_basis(shape[0], 1) * legendre_basis(shape[1], 1).T


def _profiles(map_: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the additive profiles of columns and rows of a map with NaNs; a line without any value gets 0."""
    columns, rows = np.zeros(map_.shape[1]), np.zeros(map_.shape[0])
    held = np.isfinite(map_)
    values = np.where(held, map_, 0.0)
    per_column, per_row = np.maximum(held.sum(axis=0), 1), np.maximum(held.sum(axis=1), 1)
    for _ in range(8):
        columns = np.where(held, values - rows[:, None], 0.0).sum(axis=0) / per_column
        rows = np.where(held, values - columns, 0.0).sum(axis=1) / per_row
    rows_mean = rows[held.any(axis=1)].mean()
    return columns + np.where(held.any(axis=0), rows_mean, 0.0), np.where(held.any(axis=1), rows - rows_mean, 0.0)


def _slope(rest: np.ndarray, excess: np.ndarray) -> Estimate:
    """Return the slope of the rest against ``excess``, the relative dark rate minus 1.

    The fit is by least squares with a heteroscedasticity-robust standard error, and leaves out pixels with more than
    10 times the mean dark rate. If all pixels have the same dark rate, the estimate is 0 and its ``how`` is empty.
    """
    use = excess < 9
    x = excess[use] - excess[use].mean()
    total = float(x @ x)
    if total == 0:
        return Estimate(0.0, 0.0, 0.0, "")
    slope = float(x @ rest[use] / total)
    off = rest[use] - rest[use].mean() - slope * x
    return normal_estimate(
        slope, sqrt(float((x * off) @ (x * off))) / total, how="regression of the response on the dark rate"
    )


def _correct_for_dark_part(rest: Estimate, per_dark: Estimate) -> Estimate:
    """Return the joint rms of white response and threshold spread, corrected for the fitted dependence on dark charge.

    The dark rate of a pixel is its dark charge divided by its threshold. The response (1 + … + c·(d − 1))/θ is
    (1 − c + …)/θ + c·d/θ, so the fit against the measured dark rate d/θ leaves only the fraction 1 − c of the threshold
    spread in the rest. How much of the rest is threshold spread is unknown: the value assumes half of the variance,
    and the bounds assume none and all of it.
    """
    c = min(max(per_dark.value, 0.0), 0.5)
    return Estimate(rest.value / sqrt(1 - c), rest.low, rest.high / (1 - c), rest.how)


def _subtract_threshold_part(slope: Estimate, joint: Estimate, *, variance: float) -> Estimate:
    """Return the slope of the response against dark charge without the contribution of the threshold spread.

    A pixel with a low threshold fires faster both in light and in the dark. A threshold spread of variance w² therefore
    adds w²/v to the slope, where v is the ``variance`` of the relative dark rates. The value assumes that w² is half of
    the joint variance, and the bounds assume none and all of it.
    """
    half, full = joint.value**2 / 2 / variance, joint.high**2 / variance
    ends = [max(x, 0.0) for x in (slope.value - half, slope.low - full, slope.high)]
    return Estimate(ends[0], ends[1], ends[2], f"{slope.how}; threshold spread may contribute")


def _fit_white(squares: np.ndarray, dark: np.ndarray, *, noise: float, size: tuple[int, ...]) -> dict[str, Estimate]:
    """Return the rms of the white rest and the spread per dark rate, from squares = white² + noise + spread²·dark²."""
    freedom = (size[0] - 2) * (size[1] - 2) / ((size[0] - 1) * (size[1] - 1))
    use = dark < 6
    x = np.stack([np.ones(use.sum()), dark[use] ** 2], axis=1)
    y = squares[use] / freedom
    flat = float(np.std(dark)) == 0
    weight = np.ones(use.sum())
    fit = np.array([y.mean(), 0.0])
    for _ in range(1 if flat else 4):
        if flat:
            break
        scaled = x * weight[:, None]
        fit = np.linalg.solve(scaled.T @ x, scaled.T @ y)
        weight = 1 / np.maximum(x @ np.maximum(fit, [1e-8, 0]), 1e-8) ** 2
    if flat:
        error = np.array([y.std() / sqrt(y.size), 0.0])
    else:
        scaled = x * weight[:, None]
        bread = np.linalg.inv(scaled.T @ x)
        score = scaled * (y - x @ fit)[:, None]
        error = np.sqrt(np.diag(bread @ (score.T @ score) @ bread))
    how = "response map without profiles, dark charge and measurement noise"
    found = {"white_and_threshold_rms": root_estimate(float(fit[0]) - noise, float(error[0]), how=how)}
    if not flat:
        found["per_dark_rms"] = root_estimate(
            float(fit[1]), float(error[1]), how="growth of the white rest with the dark rate"
        )
    return found


def _fit_profile(name: str, profile: np.ndarray, *, noise: float, full_length: int) -> dict[str, Estimate]:
    """Return the rms and white rms of a profile, and the fraction of its variance by Legendre degree.

    ``profile`` lacks its first value, which ``full_length`` includes; ``noise`` is the variance that the noise of its
    pixels adds.
    """
    length, degree = profile.size, min(DEGREE, profile.size - 2)
    basis = np.concatenate([np.ones((length, 1)), legendre_basis(full_length, degree)[1:]], axis=1)
    solve = np.linalg.pinv(basis)
    terms = solve @ profile
    off = profile - basis @ terms
    scatter = float(off @ off) / max(length - degree - 1, 1)  # white noise of the profile and of its pixels
    white_variance = max(scatter - noise, 0.0)
    error = np.sqrt(np.diag(solve @ solve.T) * scatter)[1:]
    squares = np.maximum(terms[1:] ** 2 - error**2, 0.0)
    square = float(squares.sum() + white_variance)
    spread = sqrt(float((4 * terms[1:] ** 2 * error**2).sum()) + 2 * scatter**2 / max(length - degree - 1, 1))
    rms = root_estimate(square, spread, how=f"mean of each {name}, minus the noise of its pixels")
    free = max(length - degree - 1, 1)
    seen = (scatter, max(scatter, noise))  # a scatter below the pixels' noise is chance and must not tighten the bound
    ends = [
        max(part * free / float(q) - noise, 0.0)
        for part, q in zip(seen, stats.chi2.ppf([0.975, 0.025], free), strict=True)
    ]
    found = {
        f"response_{name}_rms": rms,
        f"{name}_white_rms": Estimate(
            sqrt(white_variance), sqrt(ends[0]), sqrt(ends[1]), f"residual of a Legendre fit to the {name} profile"
        ),
    }
    for at in range(degree):
        size, wide = abs(float(terms[1 + at])), NORMAL_95 * float(error[at])
        low, high = max(size - wide, 0.0) ** 2, (size + wide) ** 2
        part, low, high = (min(x / square, 1.0) if square > 0 else 0.0 for x in (float(squares[at]), low, high))
        found[f"response_{name}_legendre_{at + 1}"] = Estimate(part, low, high, "Legendre fit to the profile")
    return found


def _edge(profile: np.ndarray) -> float:
    """Return the first value of a profile minus the Legendre fit of the other values, extrapolated to it."""
    degree = min(DEGREE, profile.size - 2)
    basis = np.concatenate([np.ones((profile.size, 1)), legendre_basis(profile.size, degree)], axis=1)
    terms = np.linalg.pinv(basis[1:]) @ profile[1:]
    return float(profile[0] - basis[0] @ terms)


def _white_noise_rms(profile: np.ndarray) -> float:
    return float(np.std(np.diff(profile[1:]))) / sqrt(2)


def _fit_dust(rest: np.ndarray, white: float) -> dict[str, Estimate]:
    """Return the fraction of pixels under dust and the rms fraction of light that it blocks.

    ``rest`` is in robust standard deviations, each equal to the relative response ``white``. The depths of shadows are
    assumed to be half-normal. Only shadows deeper than :data:`DEEP` can be recognised; the law gives the number of the
    others. With fewer than 5 deep pixels the fraction is not corrected, and no depth is returned.
    """
    rest = rest[np.isfinite(rest)]
    deep = -rest[rest < -DEEP] * white
    how = f"pixels more than {DEEP:g} robust standard deviations darker than expected"
    if deep.size < 5:
        high = stats.chi2.ppf(0.975, 2 * (deep.size + 1)) / 2 / rest.size
        return {"dust_fraction": Estimate(deep.size / rest.size, 0.0, float(high), how)}
    start = DEEP * white
    tried = np.geomspace(start / 4, 1.0, 400)
    likelihood = np.array([stats.halfnorm.logpdf(deep, scale=s).sum() - deep.size * stats.halfnorm.logsf(start, scale=s)
                           for s in tried])  # fmt: skip
    inside = tried[likelihood > likelihood.max() - stats.chi2.ppf(0.95, 1) / 2]
    depth = tried[likelihood.argmax()]
    seen = float(stats.halfnorm.sf(start, scale=depth))
    ends = stats.chi2.ppf([0.025, 0.975], [2 * deep.size, 2 * deep.size + 2]) / 2 / rest.size
    ends /= stats.halfnorm.sf(start, scale=np.array([inside[-1], inside[0]]))
    return {
        "dust_fraction": Estimate(deep.size / rest.size / seen, float(ends[0]), float(ends[1]), how),
        "dust_depth_rms": Estimate(float(depth), float(inside[0]), float(inside[-1]), how),
    }
