"""The parts of a response map: profiles of columns and rows, edges, twist, what goes with the dark, dust, white noise.

The map is taken apart as the sensor puts it together (``saf_gen/camera/fixed_pattern.py``), and the noise of its
pixels is taken off each part. White response and threshold spread are one: a rate is charge over threshold.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.polynomial import legendre
from scipy import stats

from saf_gen.calibration.estimates import NORMAL_95, Estimate, normal_estimate_of_fit, root_estimate_of_fit
from saf_gen.calibration.pattern_statistics import ROBUST

DEGREE = 4
"""Legendre polynomials up to this degree are told from the white noise of a profile."""
DEEP = 5.0
"""Robust standard deviations below the rest from which a pixel is taken to lie under dust."""
_ROUNDS = 3


@dataclass(frozen=True)
class PatternFit:
    """Estimates by key of the sensor, with ``white_and_threshold_rms``, the spread that response and threshold share.

    rest : what profiles, edges, twist and dark leave, (H, W), NaN where a pixel is dead.
    columns, rows : the profiles, (W,) and (H,).
    """

    estimates: dict[str, Estimate]
    rest: np.ndarray
    columns: np.ndarray
    rows: np.ndarray


def fit_sensor_pattern(response: np.ndarray, error: np.ndarray, *, dark: np.ndarray) -> PatternFit:
    """Return the parts of a response map.

    Parameters
    ----------
    response : relative response over threshold, (H, W), NaN where it is unknown.
    error : its standard error, pixel by pixel.
    dark : dark rate of each pixel over the mean of the chip, (H, W).
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
    for _ in range(_ROUNDS):  # dark and dust stand in the mean of a line: they are taken off first
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
    whole = float(np.mean(left[core] ** 2))  # of a pixel: white, what goes with its dark charge, and noise
    estimates["white_and_threshold_rms"] = _with_dark_part(estimates["white_and_threshold_rms"], per_dark)
    for name, profile, length in (
        ("column", profiles[0], response.shape[0]), ("row", profiles[1], response.shape[1])
    ):  # fmt: skip
        estimates |= _fit_profile(name, profile[1:], noise=whole / max(length - 1, 1), whole=profile.size)
    estimates["response_twist_rms"] = normal_estimate_of_fit(
        abs(twist), sqrt(whole / core.sum()), how="the product of both tilts in the response map", least=0
    )
    if per_dark.how:
        estimates["response_per_dark"] = _less_threshold(
            per_dark, estimates["white_and_threshold_rms"], variance=float(np.var(excess[core & (excess < 9)]))
        )
    edges = {"response_first_column": (profiles[0], left[1:, 0]), "response_first_row": (profiles[1], left[0, 1:])}
    for key, (profile, edge) in edges.items():
        off = edge[np.isfinite(edge)] - profile[0] + _edge(profile)
        estimates[key] = normal_estimate_of_fit(
            float(np.median(off)) if off.size else 0.0,
            1.2533 * sqrt(whole / max(off.size, 1) + _white_of(profile) ** 2),
            how="the edge against the profile beside it",
        )
    estimates |= _fit_dust(left[inner] / white, white)
    return PatternFit(estimates, np.where(known, left, np.nan), profiles[0], profiles[1])


def legendre_basis_to_fit(length: int, degree: int) -> np.ndarray:
    """Return Legendre polynomials of degree 1 to ``degree`` at pixel centres, of mean square 1 (length, degree)."""
    centre = (2 * np.arange(length) + 1) / length - 1
    return legendre.legvander(centre, degree)[:, 1:] * np.sqrt(2 * np.arange(1, degree + 1) + 1)


def _twist(shape: tuple[int, ...]) -> np.ndarray:
    return legendre_basis_to_fit(shape[0], 1) * legendre_basis_to_fit(shape[1], 1).T


def _profiles(map_: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return additive profiles of columns and rows of a map with holes; 0 where a whole line is missing."""
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
    """Return how the rest rises with dark charge: least squares with a robust error, without hot pixels beyond 10."""
    use = excess < 9
    x = excess[use] - excess[use].mean()
    total = float(x @ x)
    if total == 0:
        return Estimate(0.0, 0.0, 0.0, "")
    slope = float(x @ rest[use] / total)
    off = rest[use] - rest[use].mean() - slope * x
    return normal_estimate_of_fit(
        slope, sqrt(float((x * off) @ (x * off))) / total, how="the response against the dark rate"
    )


def _with_dark_part(rest: Estimate, per_dark: Estimate) -> Estimate:
    """Return the joint spread of response and threshold from the rest that dark leaves.

    What goes with dark charge goes with that over the threshold too, (1 + … + c·(d − 1))/θ = (1 − c + …)/θ + c·d/θ: of
    the spread of thresholds only the part 1 − c is in the rest. It is not known how much of the rest is that of
    thresholds: half of the variance is put in, and the bounds are nothing and all.
    """
    c = min(max(per_dark.value, 0.0), 0.5)
    return Estimate(rest.value / sqrt(1 - c), rest.low, rest.high / (1 - c), rest.how)


def _less_threshold(slope: Estimate, joint: Estimate, *, variance: float) -> Estimate:
    """Return the rise of response with dark charge without what thresholds add to it.

    A low threshold makes a pixel fast in light and in the dark: a threshold spread of variance w² adds w²/``variance``
    to the slope, ``variance`` that of relative dark rates. Of w² half of the joint variance is put in, and the bounds
    are 0 and all.
    """
    half, most = joint.value**2 / 2 / variance, joint.high**2 / variance
    ends = [max(x, 0.0) for x in (slope.value - half, slope.low - most, slope.high)]
    return Estimate(ends[0], ends[1], ends[2], f"{slope.how}; a threshold spread may be part of it")


def _fit_white(squares: np.ndarray, dark: np.ndarray, *, noise: float, size: tuple[int, ...]) -> dict[str, Estimate]:
    """Return the white rest, and how much of it grows with the dark: squares = white² + noise + spread²·dark²."""
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
    how = "what profiles and dark leave of the response map, its own noise taken off"
    found = {"white_and_threshold_rms": root_estimate_of_fit(float(fit[0]) - noise, float(error[0]), how=how)}
    if not flat:
        found["per_dark_rms"] = root_estimate_of_fit(
            float(fit[1]), float(error[1]), how="how that rest grows with the dark rate"
        )
    return found


def _fit_profile(name: str, profile: np.ndarray, *, noise: float, whole: int) -> dict[str, Estimate]:
    """Return the rms of a profile without its first pixel, and the fraction of its variance by Legendre degree."""
    length, degree = profile.size, min(DEGREE, profile.size - 2)
    basis = np.concatenate([np.ones((length, 1)), legendre_basis_to_fit(whole, degree)[1:]], axis=1)
    solve = np.linalg.pinv(basis)
    terms = solve @ profile
    off = profile - basis @ terms
    scatter = float(off @ off) / max(length - degree - 1, 1)  # white noise of the profile and of its pixels
    own = max(scatter - noise, 0.0)
    error = np.sqrt(np.diag(solve @ solve.T) * scatter)[1:]
    squares = np.maximum(terms[1:] ** 2 - error**2, 0.0)
    square = float(squares.sum() + own)
    spread = sqrt(float((4 * terms[1:] ** 2 * error**2).sum()) + 2 * scatter**2 / max(length - degree - 1, 1))
    rms = root_estimate_of_fit(square, spread, how=f"the mean of every {name}, the noise of its pixels taken off")
    free = max(length - degree - 1, 1)
    seen = (scatter, max(scatter, noise))  # less than the pixels' noise is chance, and bounds no better than none would
    ends = [
        max(part * free / float(q) - noise, 0.0)
        for part, q in zip(seen, stats.chi2.ppf([0.975, 0.025], free), strict=True)
    ]
    found = {
        f"response_{name}_rms": rms,
        f"{name}_white_rms": Estimate(
            sqrt(own), sqrt(ends[0]), sqrt(ends[1]), f"what Legendre fits leave of the {name}s"
        ),
    }
    for at in range(degree):
        size, wide = abs(float(terms[1 + at])), NORMAL_95 * float(error[at])
        low, high = max(size - wide, 0.0) ** 2, (size + wide) ** 2
        part, low, high = (min(x / square, 1.0) if square > 0 else 0.0 for x in (float(squares[at]), low, high))
        found[f"response_{name}_legendre_{at + 1}"] = Estimate(part, low, high, "a Legendre fit of the profile")
    return found


def _edge(profile: np.ndarray) -> float:
    """Return what a profile's Legendre fit is less at its first pixel than the profile there."""
    degree = min(DEGREE, profile.size - 2)
    basis = np.concatenate([np.ones((profile.size, 1)), legendre_basis_to_fit(profile.size, degree)], axis=1)
    terms = np.linalg.pinv(basis[1:]) @ profile[1:]
    return float(profile[0] - basis[0] @ terms)


def _white_of(profile: np.ndarray) -> float:
    return float(np.std(np.diff(profile[1:]))) / sqrt(2)


def _fit_dust(rest: np.ndarray, white: float) -> dict[str, Estimate]:
    """Return the fraction of pixels under dust and the light that it takes, from those far below the rest.

    ``rest`` is in robust standard deviations. Shadows are half-normal; those that are shallower than :data:`DEEP` are
    not seen, and added by the law.
    """
    rest = rest[np.isfinite(rest)]
    deep = -rest[rest < -DEEP] * white
    how = f"pixels more than {DEEP:g} robust standard deviations below the rest"
    if deep.size < 5:
        most = stats.chi2.ppf(0.975, 2 * (deep.size + 1)) / 2 / rest.size
        return {"dust_fraction": Estimate(deep.size / rest.size, 0.0, float(most), how)}
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
