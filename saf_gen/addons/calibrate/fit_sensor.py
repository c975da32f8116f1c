"""A sensor fitted to flat fields and a dark recording.

docs/spike-camera.md derives which recording determines each parameter, and which parameters cannot be separated.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from math import floor, inf, sqrt

import numpy as np
from scipy.ndimage import median_filter

from saf_gen.addons.calibrate.dark_rates import DarkFit, fit_dark
from saf_gen.addons.calibrate.estimates import Estimate, binomial_interval, root_estimate
from saf_gen.addons.calibrate.fit_response import (
    DEGREE,
    PatternFit,
    ResponseFit,
    fit_pattern,
    fit_response,
    infer_saturation,
)
from saf_gen.addons.calibrate.flat_checks import LightVariation, check_camera, check_flat, check_levels, light_variation
from saf_gen.addons.calibrate.interval_noise import START_NOISE, NoiseOfLevels, combine_noise, fit_interval_noise
from saf_gen.addons.calibrate.recordings import Recording
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics, measure_spikes
from saf_gen.camera import Sensor
from saf_gen.core.config.presets import change_fields
from saf_gen.errors import BadInput

Report = Callable[[str, float], None]
HOT = 0.5
"""Dark rate, relative to the mean rate of the dimmest flat field, above which a pixel is bad."""
FACTOR = 2.0
"""Response, relative to the pixels around, above which, or below whose inverse, a pixel is bad."""
_MISFIT_RMS = 0.005
_FITTED_NOISE = ("shot", "dark", "response", "threshold_spread", "threshold_noise", "dust", "dead")


@dataclass(frozen=True)
class SensorFit:
    """A fitted sensor, with the uncertainty of each of its numbers.

    Attributes
    ----------
    sensor : Sensor
        The fitted sensor, as written to its YAML file.
    estimates : dict of str to Estimate
        Estimates by key of the sensor, and of numbers that are not keys of a sensor, such as ``interval_noise``,
        ``white_and_threshold_rms`` and ``loss``. All other keys of the sensor have the values of ``base``.
    base : str
        Name of the sensor that supplied the parameters that flat fields cannot determine.
    notes : tuple of str
        Sentences about numbers that could not be determined and about unusual findings.
    flats : dict of str to SpikeStatistics
        Statistics of the flat fields, by the name of the recording.
    dark : SpikeStatistics
        Statistics of the dark recording.
    variations : dict of str to LightVariation
        Variation of the light of each flat field, by name.
    response : ResponseFit
        Fitted response map and levels.
    pattern : PatternFit
        Parts of the response map.
    dark_fit : DarkFit
        Fitted distribution of the dark rates.
    bad : ndarray of bool, shape (H, W)
        Pixels that are no use for pictures: see :func:`bad_pixels`.
    levels : dict of str to float
        Light of each flat field by name, spikes per readout of a mean pixel without dark charge.
    """

    sensor: Sensor
    estimates: dict[str, Estimate]
    base: str
    notes: tuple[str, ...]
    flats: dict[str, SpikeStatistics]
    dark: SpikeStatistics
    variations: dict[str, LightVariation]
    response: ResponseFit
    pattern: PatternFit
    dark_fit: DarkFit
    bad: np.ndarray
    levels: dict[str, float] = field(default_factory=dict)


def fit_sensor(
    flats: list[Recording],
    dark: Recording,
    *,
    base: Sensor,
    name: str = "fitted",
    threshold_e: float | None = None,
    report: Report | None = None,
) -> SensorFit:
    """Return the sensor that flat fields of several levels and a dark recording describe.

    Parameters
    ----------
    flats : list of Recording
        Recordings of even light, at levels that differ by a factor of 1.2 or more. The levels need not be known.
    dark : Recording
        Recording without light.
    base : Sensor
        Sensor that supplies what these recordings cannot determine, such as pitch, quantum efficiency and wavelength.
    name : str, default "fitted"
        Name of the fitted sensor.
    threshold_e : float, optional
        Electrons per spike, if known. Without it, shot noise and threshold noise cannot be separated.
    report : callable, optional
        Called with the name of the recording that is read and the fraction of it that is done.

    Raises
    ------
    BadInput
        If a recording is given twice, or the recordings are not of one camera; if a flat field is saturated, too dark,
        too short, uneven, moving, flickering strongly, as bright as another, or made with a hard reset; if the dark
        recording is too short; if ``threshold_e`` gives more shot noise than the intervals have noise.
    """
    recordings = [*flats, dark]
    if len({r.name for r in recordings}) < len(recordings):
        raise BadInput("a recording is given twice", allowed="flat fields and a dark recording from different files")
    check_camera({r.name: (r.shape, r.readout_hz) for r in recordings})

    def measure(recording: Recording, light: np.ndarray | None = None) -> SpikeStatistics:
        name, again = recording.name, "" if light is None else ", light divided out"
        progress = None if report is None else lambda done: report(f"{name}{again}", done)
        return measure_spikes(recording, light=light, report=progress)

    dark_statistics = measure(dark)
    measured, variations = {}, {}
    for flat in flats:
        found = measure(flat)
        rough, _ = fit_interval_noise(found)
        variation = light_variation(
            found, noise=rough if np.isfinite(rough) else START_NOISE, readout_hz=flat.readout_hz
        )
        check_flat(flat.name, found, dark=dark_statistics.rates, variation=variation)
        if variation.light is not None:
            found = measure(flat, variation.light)
        measured[flat.name], variations[flat.name] = found, variation
    names = list(measured)
    check_levels(names, np.array([measured[n].mean_rate - dark_statistics.mean_rate for n in names]))
    return _fit(
        measured, dark_statistics, variations=variations, base=base, name=name, threshold_e=threshold_e,
        dark_name=dark.name, readout_hz=dark.readout_hz,
    )  # fmt: skip


def _fit(
    flats: dict[str, SpikeStatistics],
    dark_statistics: SpikeStatistics,
    *,
    variations: dict[str, LightVariation],
    base: Sensor,
    name: str,
    threshold_e: float | None,
    dark_name: str,
    readout_hz: float,
) -> SensorFit:
    notes: list[str] = []
    lit = list(flats.values())
    dead = np.min([f.counts for f in lit], axis=0) == 0
    dark_error = np.full(dead.shape, sqrt(1 / 6) / dark_statistics.shape[0])
    loss, noise = base.post_spike_loss if len(lit) == 1 else 0.0, START_NOISE
    for _ in range(3):
        dark_rates = dark_statistics.rates / (1 - loss * np.minimum(dark_statistics.rates, 0.5))
        response = fit_response(lit, dark_rates, dark_error=dark_error, noise=noise, loss=loss)
        is_measured = response.loss is not None and response.loss.measured
        loss = response.loss.value if is_measured and response.loss is not None else base.post_spike_loss
        joint = _noise_of_levels(flats, variations, loss=loss)
        noise = joint.value
    dark_fit = fit_dark(
        _counts_without_loss(dark_statistics.counts[~dead], dark_statistics.shape[0], loss=loss),
        dark_statistics.shape[0],
        factor=base.dark_hot_factor,
        exponent=base.dark_hot_exponent,
        where=dark_name,
    )
    how = "second differences of spike times in the flat fields"
    estimates: dict[str, Estimate] = {"interval_noise": root_estimate(noise, joint.error, how=how)}
    if joint.jitter is not None:
        estimates["reset_jitter"] = joint.jitter
    if not joint.agree:
        notes.append("the noise of intervals differs between levels, so it is not due to thresholds and resets alone")
    changes: dict[str, object] = {"name": name, "rows": dead.shape[0], "columns": dead.shape[1]}
    changes["readout_hz"] = readout_hz
    changes |= _saturation(response, estimates, notes=notes, base=base)
    changes |= _threshold(estimates, notes, noise=(noise, joint.error), base=base, threshold_e=threshold_e)
    pattern = fit_pattern(response.response, response.error, dark=dark_rates / dark_fit.rate.value)
    estimates |= pattern.estimates
    estimates |= _shared_white(estimates, notes)
    estimates |= {
        "dark_rate": dark_fit.rate,
        "dark_log_sd": dark_fit.log_sd,
        "dark_hot_fraction": dark_fit.hot_fraction,
    }
    if dark_fit.hot_exponent is not None:
        estimates["dark_hot_exponent"] = dark_fit.hot_exponent
    estimates["dead_fraction"] = _dead_fraction(dead)
    estimates |= _spread_per_dark(estimates)
    for key, varied in variations.items():
        if varied.light is not None:
            line = f"at {varied.hz:.0f} Hz" if varied.hz else "slowly"
            notes.append(f"the light of {key} varies by {varied.rms:.2%} rms, {line}; the frame mean is divided out")
    bad, kinds = bad_pixels(lit, dark_statistics, response=response.response)
    if kinds:
        notes.append(f"bad pixels: {kinds}")
    known = {f.name for f in fields(Sensor)}
    changes |= {key: e.value for key, e in estimates.items() if key in known}
    changes |= _legendre(estimates)
    return SensorFit(
        sensor=_build(base, changes),
        estimates=estimates,
        base=base.name,
        notes=tuple(notes),
        flats=flats,
        dark=dark_statistics,
        variations=variations,
        response=response,
        pattern=pattern,
        dark_fit=dark_fit,
        bad=bad,
        levels=dict(zip(flats, response.levels.tolist(), strict=True)),
    )


def _build(base: Sensor, changes: dict[str, object]) -> Sensor:
    """Return the base with the fitted values and with the fitted kinds of noise switched on.

    Raises BadInput if a value is outside the range that a sensor allows.
    """
    plain = {key: [float(x) for x in v] if isinstance(v, list) else v for key, v in changes.items()}
    noise = {**asdict(base.noise), **dict.fromkeys(_FITTED_NOISE, True)}
    noise["reset_jitter"] = bool(plain.get("reset_jitter"))
    sources = ("fitted by saf-gen sensors fit", f"numbers that flat fields do not determine: {base.name}")
    return change_fields(replace(base, sources=sources), {**plain, "noise": noise}, where=f"sensor {changes['name']}")


def _noise_of_levels(
    flats: dict[str, SpikeStatistics], variations: dict[str, LightVariation], *, loss: float
) -> NoiseOfLevels:
    found = [fit_interval_noise(f, loss=loss, stretch=variations[n].stretch) for n, f in flats.items()]
    lengths = [float(np.nanmedian(f.interval)) - loss for f in flats.values()]
    return combine_noise(found, lengths)


def _saturation(
    response: ResponseFit, estimates: dict[str, Estimate], *, notes: list[str], base: Sensor
) -> dict[str, object]:
    if response.loss is not None:
        estimates["loss"] = response.loss
    inferred = infer_saturation(response.loss)
    if inferred is None:
        why = "with one level" if response.loss is None else "at these levels"
        notes.append(
            f"{why} the law of saturation and the reset loss cannot be determined: {base.saturation} and "
            f"{base.reset_loss:g} are assumed"
        )
        return {"saturation": base.saturation, "reset_loss": base.reset_loss}
    if response.misfit_rms > _MISFIT_RMS:
        notes.append(
            f"the levels disagree by {response.misfit_rms:.2%} rms beyond noise: the distribution of the light "
            "changed, or the law of saturation is wrong"
        )
    saturation, reset_loss = inferred
    if saturation == "subtract":
        estimates["reset_loss"] = reset_loss
    return {"saturation": saturation, "reset_loss": reset_loss.value}


def _threshold(
    estimates: dict[str, Estimate],
    notes: list[str],
    *,
    noise: tuple[float, float],
    base: Sensor,
    threshold_e: float | None,
) -> dict[str, object]:
    """Add the estimates of the threshold θ and the threshold noise σ, from the measured sum 1/θ + σ².

    If θ is given, σ follows; otherwise only bounds of both are known.
    """
    value, error = noise
    how = "second differences of spike times, minus the shot noise of threshold_e"
    highest = sqrt(value + 2 * error)
    if threshold_e is not None:
        if 1 / threshold_e > value + 5 * error:
            raise BadInput(
                f"--threshold-e {threshold_e:g} gives more shot noise than the measured noise of intervals",
                allowed=f"at least {1 / value:.4g} electrons",
            )
        estimates["threshold_noise_rms"] = root_estimate(value - 1 / threshold_e, error, how=how)
        estimates["threshold_e"] = Estimate(threshold_e, threshold_e, threshold_e, "given", measured=False)
        return {}
    theta = float(base.threshold_e) if 1 / base.threshold_e < value else 2 / value
    sigma = sqrt(value - 1 / theta)
    estimates["threshold_noise_rms"] = Estimate(sigma, 0.0, highest, f"{how}, which is assumed", measured=False)
    estimates["threshold_e"] = Estimate(
        theta, 1 / highest**2, inf, "assumed; the noise of intervals gives the lower bound", measured=False
    )
    notes.append(
        f"shot noise and threshold noise cannot be separated without --threshold-e: together {sqrt(value):.3%} of an "
        f"interval, so threshold noise is at most {highest:.3%} and a spike at least {1 / highest**2:,.0f} electrons"
    )
    return {}


def _shared_white(estimates: dict[str, Estimate], notes: list[str]) -> dict[str, Estimate]:
    """Return the estimates of white response and threshold spread: half of their joint variance each, with bounds."""
    joint = estimates["white_and_threshold_rms"]
    notes.append(
        f"rates cannot separate white response from threshold spread: together {joint.value:.3%} rms, with half of "
        "the variance assigned to each"
    )
    half = Estimate(
        joint.value / sqrt(2), 0.0, joint.high, "half of the joint variance of response and threshold", measured=False
    )
    return {"response_white_rms": half, "threshold_spread_rms": half}


def _counts_without_loss(counts: np.ndarray, frames: int, *, loss: float) -> np.ndarray:
    """Return the counts that the dark charge would give without a loss after a spike, n/(1 − ℓ·n/T), as integers.

    They are rounded down after adding a phase that is uniform over 0 to 1, as the sensor does; the phases are multiples
    of the golden ratio modulo 1, so that the result is deterministic.
    """
    phase = np.arange(counts.size) * ((sqrt(5) - 1) / 2) % 1
    return np.floor(counts / (1 - loss * np.minimum(counts / frames, 0.5)) + phase).astype(np.int64)


def _spread_per_dark(estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    per, spread = estimates.get("response_per_dark"), estimates.get("per_dark_rms")
    if per is None or spread is None or not per.value > 0:
        return {}
    ends = [min(x / per.value, 1.0) for x in (spread.value, spread.low, spread.high)]
    return {"response_per_dark_spread": Estimate(ends[0], ends[1], ends[2], spread.how)}


def bad_pixels(flats: list[SpikeStatistics], dark: SpikeStatistics, *, response: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the pixels that a mask should mark, bool (H, W), and how many there are of each kind in words.

    Dead pixels never fire in a flat field. Hot ones, among them those that fire at every readout, fire in the dark at
    more than HOT times the mean rate of the dimmest flat field. The others respond to light more than FACTOR times as
    much as the pixels around them, or less by that factor.
    """
    dead = np.min([flat.counts for flat in flats], axis=0) == 0
    hot = dark.rates > HOT * min(flat.mean_rate for flat in flats)
    known = np.where(np.isfinite(response) & (response > 0), response, np.nanmedian(response))
    off = np.abs(np.log(known / median_filter(known, 5, mode="mirror"))) > np.log(FACTOR)
    kinds = {
        "never fire": dead,
        "fire in the dark": hot & ~dead,
        "respond otherwise than those around": off & ~dead & ~hot,
    }
    words = [f"{np.count_nonzero(mask)} {kind}" for kind, mask in kinds.items() if mask.any()]
    return dead | hot | off, ", ".join(words)


def _dead_fraction(dead: np.ndarray) -> Estimate:
    hits, trials = int(dead.sum()), dead.size
    low, high = binomial_interval(hits, trials)
    return Estimate(hits / trials, low, high, "pixels that never fire in a flat field")


def _legendre(estimates: dict[str, Estimate]) -> dict[str, object]:
    """Return the fraction of each profile's variance by Legendre degree, under the sensor's keys."""
    out: dict[str, object] = {}
    for name in ("column", "row"):
        keys = [f"response_{name}_legendre_{degree}" for degree in range(1, DEGREE + 1)]
        parts = [estimates[key].value for key in keys if key in estimates]
        total = max(sum(parts), 1.0)
        out[f"response_{name}_legendre"] = [floor(1e4 * part / total) / 1e4 for part in parts]
    return out
