"""An independent referee: the EMVA 1288 reference implementation judges flat fields, with counts as grey values.

This is the only module that imports the package ``emva1288`` (extra ``validation``). It uses the linear model of EMVA
Standard 1288, release 4.0; the grey value of a pixel is its count in a window.
"""

import importlib
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.camera.counting_law import noise_per_spike
from saf_gen.camera.sensor import Sensor
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, Skipped, compare_estimate
from studies.laws.scenes import even_panel, gain_of_rate
from studies.laws.theory import autocovariance, charge_of_rate, firing_rate
from studies.laws.workload import DatasetMaker, Workload

WINDOW = 200
RATES = (0.05, 0.12, 0.2, 0.28, 0.36, 0.44, 0.52, 0.6, 0.7, 0.8, 0.9)
BRIGHT = 0.44
"""Rate at half of saturation, where the standard measures photo-response non-uniformity."""
EXPOSURE_NS = WINDOW / 20_000 * 1e9


def _judge_flat_fields(
    pairs: dict[float, list[np.ndarray]], stacks: dict[float, list[np.ndarray]], *, saturated: int
) -> dict[str, float]:
    """Return the figures that the EMVA 1288 reference implementation finds in images of integer grey values.

    Parameters
    ----------
    pairs : dict of float to list of ndarray
        Temporal series: two images (row, col) for each number of photons per pixel and exposure, including 0.
    stacks : dict of float to list of ndarray
        Spatial series: many images for 0 photons and for one bright level.
    saturated : int
        Index, among the bright levels, of the level that counts as saturation.

    Returns
    -------
    dict of str to float
        Responsivity (counts per photon), PRNU (as a fraction), DSNU (counts), linearity errors (per cent) and temporal
        variances (counts²).

    Raises
    ------
    Skipped
        If the package is not installed.
    """
    _require_referee()
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288
    from emva1288.process.routines import get_int_imgs

    def summed(images: list[np.ndarray]) -> dict[str, Any]:
        found = get_int_imgs([image.astype(np.int64) for image in images])
        return {**found, "sum": found["sum"].sum(), "pvar": found["pvar"].sum()}

    (height, width) = stacks[0.0][0].shape
    image_data = {
        "temporal": {EXPOSURE_NS: {photons: summed(images) for photons, images in pairs.items()}},
        "spatial": {EXPOSURE_NS: {photons: get_int_imgs(images) for photons, images in stacks.items()}},
        "height": height,
        "width": width,
    }
    with _restored_asfarray():
        found = Results1288(
            Data1288(image_data, loglevel=logging.ERROR).data, index_u_ysat=saturated, loglevel=logging.ERROR
        )
        return {
            "responsivity": float(found.R),
            "prnu": float(found.PRNU1288) / 100,
            "dsnu": float(found.DSNU1288_DN()),
            "linearity_least": float(found.LE_min),
            "linearity_most": float(found.LE_max),
            "temporal_bright": float(found.sigma_2_y_stack),
            "temporal_dark": float(found.sigma_2_y_stack_dark),
        }


def _require_referee() -> None:
    """Raise Skipped if the package cannot be imported."""
    try:
        importlib.import_module("emva1288.process.results")
    except ImportError as error:
        raise Skipped(f"{error}; pip install 'saf-gen[validation]'") from None


@contextmanager
def _restored_asfarray() -> Iterator[None]:
    """Provide ``numpy.asfarray``, which the package needs and numpy 2 has removed, inside a ``with`` block."""
    had = hasattr(np, "asfarray")
    if not had:
        np.asfarray = lambda values: np.asarray(values, np.float64)  # type: ignore[attr-defined]  # noqa: NPY201
    try:
        yield
    finally:
        if not had:
            del np.asfarray  # type: ignore[attr-defined]  # noqa: NPY201


def _check_emva1288(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the referee's figures with ours, which come from long recordings and from the exact law."""
    _require_referee()
    size: dict[str, Any] = {"rows": 40, "columns": 64} if quick else {"rows": 125, "columns": 200}
    images = 20 if quick else 50
    sensor = get_sensor("vidar_400x250", **size)
    levels = {f"rate_{round(1000 * rate):03d}": gain_of_rate(rate, sensor) for rate in RATES}
    lights = {name: {"kind": "constant", "level": level} for name, level in levels.items()}
    lights["dark"] = {"kind": "constant", "level": 0.0}
    series = Workload((even_panel(),), sensor, 2 * WINDOW, lights)
    bright = f"rate_{round(1000 * BRIGHT):03d}"
    stack_lights = {name: lights[name] for name in (bright, "dark")}
    stack = Workload((even_panel(),), sensor, images * WINDOW, stack_lights, seed=16)
    efficiency = sensor.quantum_efficiency * sensor.fill_factor
    photons = {
        name: float(charge_of_rate(rate, sensor)) * WINDOW / efficiency
        for name, rate in zip(levels, RATES, strict=True)
    }
    photons["dark"] = 0.0

    def windows(workload: Workload) -> dict[float, list[np.ndarray]]:
        dataset, found = maker.make(workload), {}
        for name in workload.lights:
            with dataset.open(light=name) as stream:
                found[photons[name]] = [stream.counts(k, k + WINDOW) for k in range(0, workload.frames, WINDOW)]
        return found

    pairs, stacks = windows(series), windows(stack)
    theirs = _judge_flat_fields(pairs, stacks, saturated=len(RATES) - 1)
    # The two workloads have different devices, which follow from the seeds of their recipes, so each is compared with
    # our figures from the same windows.
    ours = _our_figures(stacks[photons[bright]], stacks[0.0], per_spike=noise_per_spike(sensor))
    seen = np.array([np.mean(pairs[photons[name]]) for name in levels]) - np.mean(pairs[0.0])
    law = _law_of_series(np.array([np.mean(pairs[photons[name]]) for name in (bright, "dark")]), photons, sensor=sensor)
    used = seen <= 0.7 * seen[-1]  # up to 70 % of saturation, as in the standard
    x = np.array([photons[name] for name in levels])
    slope = float((x[used] * law[used]).sum() / (x[used] ** 2).sum())
    noise = np.sqrt(1 / 6 / 2 / np.prod(list(size.values())))  # upper bound for the mean of two images of counts
    figures = 7
    comparisons: list[Comparison] = [
        compare_estimate(
            "responsivity, counts per 1,000 photons",
            1000 * theirs["responsivity"],
            standard_error=1000 * float(np.sqrt((x[used] ** 2).sum()) / (x[used] ** 2).sum() * noise * 2),
            expected=1000 * slope,
            figures=figures,
        ),
        *(
            _compare_figure(name, theirs[name], ours=ours[name], figures=figures)
            for name in ("prnu", "dsnu", "temporal_bright", "temporal_dark")
        ),
    ]
    deviations = _linearity(x, law)
    for name, expected in (("linearity_least", deviations.min()), ("linearity_most", deviations.max())):
        comparisons.append(
            compare_estimate(
                f"{name.replace('_', ' ')}, per cent",
                theirs[name],
                standard_error=100 * float(np.max(2 * noise / seen)),
                expected=float(expected),
                figures=figures,
            )
        )
    curves = (
        Curve("law", tuple((x / 1e3).tolist()), tuple(law.tolist())),
        Curve("counts", tuple((x / 1e3).tolist()), tuple(seen.tolist()), "points"),
    )
    return Finding(
        tuple(comparisons),
        Plot("thousand photons per pixel and window", "counts above dark", curves),
        (
            "DSNU: the standard assumes that the mean of L images has 1/L of the noise variance of one image. "
            "Neighbouring windows share the charge that is left over at their border, so the mean of L windows has "
            "little more than 1/L² of it, and the standard subtracts too much. The law column shows our spread minus "
            "the amount that the standard subtracts.",
            "The standard's gain K, in counts per electron, is the slope of variance against mean. The variance of "
            "counts comes mostly from counting whole spikes and hardly grows with light, so K, and every figure that "
            "is divided by it, is meaningless here.",
        ),
    )


def _law_of_series(anchors: np.ndarray, photons: dict[str, float], *, sensor: Sensor) -> np.ndarray:
    """Return the counts above dark at every bright level, by the law of rates, fitted to one bright level and dark."""
    bright = f"rate_{round(1000 * BRIGHT):03d}"
    efficiency = sensor.quantum_efficiency * sensor.fill_factor
    dark, bright_charge = charge_of_rate(anchors[::-1] / WINDOW, sensor)
    response = (bright_charge - dark) / (photons[bright] * efficiency / WINDOW)
    light = np.array([n * efficiency / WINDOW for name, n in photons.items() if name != "dark"])
    rates = firing_rate(response * light + dark, sensor) - firing_rate(dark, sensor)
    return np.asarray(WINDOW * rates)


def _linearity(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the deviations (per cent) from the standard's line, which is fitted from 5 to 95 % of the highest level.

    The line minimises the sum of squared relative residuals.
    """
    used = (y >= 0.05 * y[-1]) & (y <= 0.95 * y[-1])
    slope, offset = np.polyfit(x[used], y[used], 1, w=1 / y[used])
    line = slope * x[used] + offset
    return np.asarray(100 * (y[used] - line) / line)


def _our_figures(
    bright: list[np.ndarray], dark: list[np.ndarray], *, per_spike: float
) -> dict[str, tuple[float, float]]:
    """Return our figures and their standard errors: spreads of the mean image, and temporal noise by the exact law."""
    bright_mean, dark_mean = (np.asarray(np.mean(images, axis=0)) for images in (bright, dark))
    count = len(bright)
    found = {}
    for name, images, mean in (("bright", bright, bright_mean), ("dark", dark, dark_mean)):
        found[f"temporal_{name}"] = _temporal_noise(images, mean, per_spike=per_spike)
    subtracted = [found[f"temporal_{name}"][0] / count for name in ("bright", "dark")]
    spreads = [float(image.var(ddof=1)) for image in (bright_mean, dark_mean)]
    light = float(bright_mean.mean() - dark_mean.mean())
    prnu = np.sqrt(spreads[0] - subtracted[0] - spreads[1] + subtracted[1]) / light
    dsnu = np.sqrt(max(spreads[1] - subtracted[1], 0.0))
    # The referee has the same images; the difference is the temporal noise that is subtracted.
    errors = [found[f"temporal_{name}"][1] / count for name in ("bright", "dark")]
    found["prnu"] = float(prnu), float(np.hypot(errors[0], errors[1]) / (2 * prnu * light**2))
    found["dsnu"] = float(dsnu), float(errors[1] / (2 * max(dsnu, 1e-9)))
    return found


def _temporal_noise(images: list[np.ndarray], mean: np.ndarray, *, per_spike: float) -> tuple[float, float]:
    """Return the expected sample variance among a pixel's windows, as a mean over pixels, and its standard error.

    Windows of one pixel are correlated: the sample variance of L windows with the autocovariance γ(j) has the mean
    γ(0) − 2/(L(L − 1))·Σ (L − j)·γ(j).
    """
    count = len(images)
    lags = np.arange(count)
    weights = np.where(lags == 0, 1.0, -2 * (count - lags) / (count * (count - 1)))
    # Pixels of similar rate have a similar law, so 200 rates represent all pixels.
    rates = np.quantile(mean, (np.arange(200) + 0.5) / 200) / WINDOW
    law = [
        float(weights @ autocovariance(WINDOW, lags, rate=max(float(rate), 1e-6), per_spike=per_spike))
        for rate in rates
    ]
    scatter = np.var(images, axis=0, ddof=1).std() / np.sqrt(mean.size)
    return float(np.mean(law)), float(scatter)


def _compare_figure(name: str, found: float, *, ours: tuple[float, float], figures: int) -> Comparison:
    words = {
        "prnu": "photo-response non-uniformity, relative to the mean",
        "dsnu": "dark-signal non-uniformity, counts",
        "temporal_bright": "temporal variance at half saturation, counts²",
        "temporal_dark": "temporal variance in the dark, counts²",
    }
    expected, error = ours
    return compare_estimate(words[name], found, standard_error=error, expected=expected, figures=figures)


LAWS = (
    Law(
        "referee_emva1288",
        "In our flat fields, with the counts of a window as grey values, the EMVA 1288 reference implementation finds "
        "the figures that we expect.",
        "R = Σ x·y/Σ x²; PRNU² = (s²(bright) − s²(dark))/(y(bright) − y(dark))²; DSNU² = s²(dark)",
        "EMVA Standard 1288, release 4.0; package emva1288 1.0.2, https://github.com/EMVA1288/emva1288",
        "vidar_400x250 with all its noise, in even light at eleven levels and in the dark; windows of 200 frames, in "
        "pairs and in stacks of 50.",
        "The scatter between pixels in the referee's means (one false alarm in 10,000 runs); our figures come from the "
        "exact law and from the spread of the mean of all frames.",
        _check_emva1288,
    ),
)
