"""A sensor fitted to flat fields and a dark recording.

What each parameter is known from, and what cannot be told apart, is worked out in docs/explanation/sensors.md.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from math import floor, inf, sqrt

import numpy as np
from scipy import stats

from saf_gen.calibration.dark_rates import DarkFit, fit_dark_recording
from saf_gen.calibration.estimates import Estimate, root_estimate_of_fit
from saf_gen.calibration.fit_pattern import DEGREE, PatternFit, fit_sensor_pattern
from saf_gen.calibration.flat_checks import (
    LightVariation,
    check_calibration_camera,
    check_flat_recording,
    check_levels_of_flats,
    find_light_variation_of_flat,
)
from saf_gen.calibration.interval_noise import START_NOISE, NoiseOfLevels, combine_fitted_noise, fit_interval_noise
from saf_gen.calibration.linearity import ResponseFit, fit_sensor_response, tell_fitted_saturation
from saf_gen.calibration.recordings import Recording
from saf_gen.calibration.spike_statistics import SpikeStatistics, measure_spike_statistics
from saf_gen.camera import Sensor
from saf_gen.core.config.presets import change_preset_fields
from saf_gen.errors import BadInput

Report = Callable[[str, float], None]
_MISFIT_RMS = 0.005
_FITTED_NOISE = ("shot", "dark", "response", "threshold_spread", "threshold_noise", "dust", "dead")


@dataclass(frozen=True)
class SensorFit:
    """A fitted sensor, and how well each of its numbers is known.

    sensor : the sensor, as its YAML file describes it.
    estimates : by key of the sensor, and of numbers that are none (``interval_noise``, ``white_and_threshold_rms``,
        ``loss``); keys of the sensor that are not here are those of ``base``.
    base : name of the sensor that lent what flat fields cannot tell.
    notes : what could not be told, and what was found odd, one sentence each.
    flats, dark : statistics of the recordings, by name.
    variations : how the light of each flat field varied.
    response, pattern, dark_fit : what the numbers were taken from.
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
    flats : recordings of even light, at levels that differ by a factor of 1.2 or more; the levels need not be known.
    dark : a recording without light.
    base : lends what cannot be measured so: pitch, quantum efficiency, wavelength and the like.
    name : of the fitted sensor.
    threshold_e : electrons a spike, where they are known; without them shot noise and threshold noise are one.
    report : receives what is read, and the fraction that is done.

    Raises
    ------
    BadInput : recordings of several cameras; a flat field that is saturated, too dark, too short, not even or not
    still,
        or as bright as another; a dark recording that is too short.
    """
    recordings = [*flats, dark]
    if len({r.name for r in recordings}) < len(recordings):
        raise BadInput("a recording is given twice", allowed="flat fields and a dark recording of different files")
    check_calibration_camera({r.name: (r.shape, r.readout_hz) for r in recordings})

    def measure(recording: Recording, light: np.ndarray | None = None) -> SpikeStatistics:
        name, again = recording.name, "" if light is None else ", its light divided out"
        told = None if report is None else lambda done: report(f"{name}{again}", done)
        return measure_spike_statistics(recording, light=light, report=told)

    unlit = measure(dark)
    measured, variations = {}, {}
    for flat in flats:
        found = measure(flat)
        rough, _ = fit_interval_noise(found)
        variation = find_light_variation_of_flat(
            found, noise=rough if np.isfinite(rough) else START_NOISE, readout_hz=flat.readout_hz
        )
        check_flat_recording(flat.name, found, dark=unlit.rates, variation=variation)
        if variation.light is not None:
            found = measure(flat, variation.light)
        measured[flat.name], variations[flat.name] = found, variation
    names = list(measured)
    check_levels_of_flats(names, np.array([measured[n].mean_rate - unlit.mean_rate for n in names]))
    return _fit(
        measured, unlit, variations=variations, base=base, name=name, threshold_e=threshold_e,
        dark_name=dark.name, readout_hz=dark.readout_hz,
    )  # fmt: skip


def _fit(
    flats: dict[str, SpikeStatistics],
    unlit: SpikeStatistics,
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
    dark_error = np.full(dead.shape, sqrt(1 / 6) / unlit.shape[0])
    loss, noise = base.post_spike_loss if len(lit) == 1 else 0.0, START_NOISE
    for _ in range(3):
        dark_rates = unlit.rates / (1 - loss * np.minimum(unlit.rates, 0.5))
        response = fit_sensor_response(lit, dark_rates, dark_error=dark_error, noise=noise, loss=loss)
        told = response.loss is not None and response.loss.measured
        loss = response.loss.value if told and response.loss is not None else base.post_spike_loss
        joint = _noise_of_levels(flats, variations, loss=loss)
        noise = joint.value
    dark_fit = fit_dark_recording(
        _counts_without_loss(unlit.counts[~dead], unlit.shape[0], loss=loss),
        unlit.shape[0],
        factor=base.dark_hot_factor,
        exponent=base.dark_hot_exponent,
        where=dark_name,
    )
    how = "second differences of spike times in the flat fields"
    estimates: dict[str, Estimate] = {"interval_noise": root_estimate_of_fit(noise, joint.error, how=how)}
    if joint.jitter is not None:
        estimates["reset_jitter"] = joint.jitter
    if not joint.agree:
        notes.append("the noise of intervals differs between levels: it is not that of thresholds and resets alone")
    changes: dict[str, object] = {"name": name, "rows": dead.shape[0], "columns": dead.shape[1]}
    changes["readout_hz"] = readout_hz
    changes |= _saturation(response, estimates, notes=notes, base=base)
    changes |= _threshold(estimates, notes, noise=(noise, joint.error), base=base, threshold_e=threshold_e)
    pattern = fit_sensor_pattern(response.response, response.error, dark=dark_rates / dark_fit.rate.value)
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
            notes.append(f"the light of {key} varies by {varied.rms:.2%} rms, {line}: divided out by the frame mean")
    known = {f.name for f in fields(Sensor)}
    changes |= {key: e.value for key, e in estimates.items() if key in known}
    changes |= _legendre(estimates)
    return SensorFit(
        sensor=_build(base, changes),
        estimates=estimates,
        base=base.name,
        notes=tuple(notes),
        flats=flats,
        dark=unlit,
        variations=variations,
        response=response,
        pattern=pattern,
        dark_fit=dark_fit,
        levels=dict(zip(flats, response.levels.tolist(), strict=True)),
    )


def _build(base: Sensor, changes: dict[str, object]) -> Sensor:
    """Return the base with what was fitted, that noise switched on, within the ranges that a sensor may have."""
    plain = {key: [float(x) for x in v] if isinstance(v, list) else v for key, v in changes.items()}
    noise = {**asdict(base.noise), **dict.fromkeys(_FITTED_NOISE, True)}
    noise["reset_jitter"] = bool(plain.get("reset_jitter"))
    sources = ("fitted by saf-gen sensors fit", f"what flat fields do not tell: as {base.name}")
    return change_preset_fields(
        replace(base, sources=sources), {**plain, "noise": noise}, where=f"sensor {changes['name']}"
    )


def _noise_of_levels(
    flats: dict[str, SpikeStatistics], variations: dict[str, LightVariation], *, loss: float
) -> NoiseOfLevels:
    found = [fit_interval_noise(f, loss=loss, stretch=variations[n].stretch) for n, f in flats.items()]
    lengths = [float(np.nanmedian(f.interval)) - loss for f in flats.values()]
    return combine_fitted_noise(found, lengths)


def _saturation(
    response: ResponseFit, estimates: dict[str, Estimate], *, notes: list[str], base: Sensor
) -> dict[str, object]:
    if response.loss is not None:
        estimates["loss"] = response.loss
    told = tell_fitted_saturation(response.loss)
    if told is None:
        why = "with one level" if response.loss is None else "at these levels"
        notes.append(
            f"{why} the law of saturation and the reset loss cannot be told: {base.saturation} and {base.reset_loss:g} "
            "are assumed"
        )
        return {"saturation": base.saturation, "reset_loss": base.reset_loss}
    if response.misfit_rms > _MISFIT_RMS:
        notes.append(
            f"the levels disagree by {response.misfit_rms:.2%} rms beyond noise: the light fell differently, or the "
            "law of saturation is another"
        )
    saturation, reset_loss = told
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
    """Return θ and the threshold noise: of 1/θ + σ² either θ is given, or σ is bounded."""
    value, error = noise
    how = "second differences of spike times, less the shot noise of threshold_e"
    highest = sqrt(value + 2 * error)
    if threshold_e is not None:
        if 1 / threshold_e > value + 5 * error:
            raise BadInput(
                f"--threshold-e {threshold_e:g} has more shot noise than the intervals have noise",
                allowed=f"at least {1 / value:.4g} electrons",
            )
        estimates["threshold_noise_rms"] = root_estimate_of_fit(value - 1 / threshold_e, error, how=how)
        estimates["threshold_e"] = Estimate(threshold_e, threshold_e, threshold_e, "given", measured=False)
        return {}
    theta = float(base.threshold_e) if 1 / base.threshold_e < value else 2 / value
    sigma = sqrt(value - 1 / theta)
    estimates["threshold_noise_rms"] = Estimate(sigma, 0.0, highest, f"{how}, which is assumed", measured=False)
    estimates["threshold_e"] = Estimate(
        theta, 1 / highest**2, inf, "assumed; the noise of intervals bounds it from below", measured=False
    )
    notes.append(
        f"shot noise and threshold noise cannot be told apart without --threshold-e: together {sqrt(value):.3%} of an "
        f"interval, so threshold noise is at most {highest:.3%} and a spike at least {1 / highest**2:,.0f} electrons"
    )
    return {}


def _shared_white(estimates: dict[str, Estimate], notes: list[str]) -> dict[str, Estimate]:
    """Return white response and threshold spread: half of their joint variance each, and the bounds."""
    joint = estimates["white_and_threshold_rms"]
    notes.append(
        f"white response and threshold spread cannot be told apart by rates: together {joint.value:.3%} rms, half of "
        "the variance is put into each"
    )
    half = Estimate(
        joint.value / sqrt(2), 0.0, joint.high, "half of the variance that response and threshold share", measured=False
    )
    return {"response_white_rms": half, "threshold_spread_rms": half}


def _counts_without_loss(counts: np.ndarray, frames: int, *, loss: float) -> np.ndarray:
    """Return the counts that dark charge would give if nothing were lost after a spike: n/(1 − ℓ·n/T).

    They are made whole as counts are, by an even phase: that of the golden ratio's multiples, without randomness.
    """
    phase = np.arange(counts.size) * ((sqrt(5) - 1) / 2) % 1
    return np.floor(counts / (1 - loss * np.minimum(counts / frames, 0.5)) + phase).astype(np.int64)


def _spread_per_dark(estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    per, spread = estimates.get("response_per_dark"), estimates.get("per_dark_rms")
    if per is None or spread is None or not per.value > 0:
        return {}
    ends = [min(x / per.value, 1.0) for x in (spread.value, spread.low, spread.high)]
    return {"response_per_dark_spread": Estimate(ends[0], ends[1], ends[2], spread.how)}


def _dead_fraction(dead: np.ndarray) -> Estimate:
    hits, trials = int(dead.sum()), dead.size
    low = float(stats.beta.ppf(0.025, hits, trials - hits + 1)) if hits else 0.0
    high = float(stats.beta.ppf(0.975, hits + 1, trials - hits))
    return Estimate(hits / trials, low, high, "pixels that never fire in a flat field")


def _legendre(estimates: dict[str, Estimate]) -> dict[str, object]:
    """Return the fractions of the profiles' variance by degree, as the sensor lists them."""
    out: dict[str, object] = {}
    for name in ("column", "row"):
        keys = [f"response_{name}_legendre_{degree}" for degree in range(1, DEGREE + 1)]
        parts = [estimates[key].value for key in keys if key in estimates]
        total = max(sum(parts), 1.0)
        out[f"response_{name}_legendre"] = [floor(1e4 * part / total) / 1e4 for part in parts]
    return out


def _fitted_values(fit: SensorFit) -> dict[str, object]:
    """Return the keys of the fitted sensor and their values, in the order of a sensor file."""
    return asdict(fit.sensor)
