"""Comparison of the statistics of sensors, recordings and published measurements, side by side."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from saf_gen.addons.calibrate.pattern_statistics import BANDS, DEGREES, PatternStatistics, measure_dark, measure_pattern
from saf_gen.addons.calibrate.recordings import BLOCK_FRAMES, EncodedRecording, Recording
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics, flat_areas, measure_spikes, rms_between_halves
from saf_gen.camera import Sensor, knot_weights
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput

Figures = dict[str, float]
"""Statistics by key; a key is the kind of recording, a dot, and the name of the statistic, such as ``flat.rms``."""
Report = Callable[[str, float], None]

FLAT_RATE, FLAT_FRAMES, DARK_FRAMES = 0.2, 4000, 20_000
STREAM_SHAPE, STREAM_RATE = (200, 250, 250), 0.031
"""Shape (frames, rows, columns) and mean rate of the only real stream for which statistics are published."""
_BARS, _KNOTS, _SETTLE = 64, 33, 64

_LABELS = {
    "rate": "mean rate, spikes per readout",
    "cv2": "local variation of intervals, CV2",
    "halves_rms": "rms of a half's rate, flat areas",
    "interval_change": "change between intervals of 20 to 30 readouts",
    "highpass_rms": "rms against the neighbourhood, flat areas",
    "rms": "rms of the response",
    "column_rms": "– profile of columns",
    "row_rms": "– profile of rows",
    "white_rms": "– white rest",
    "white_robust_rms": "white rest, robust rms",
    "white_kurtosis": "white rest, kurtosis",
    "beyond_5": "pixels beyond 5 robust rms",
    "beyond_10": "pixels beyond 10 robust rms",
    "neighbour_correlation": "white rest, correlation with the next pixel",
    "median": "median dark rate, spikes per readout",
    "mean": "mean dark rate, spikes per readout",
    "log_sd": "sd of the dark rate's natural logarithm",
    "hot_fraction": "pixels above 4 times the median dark rate",
    "silent_fraction": "pixels that never fired",
}
_PERCENT = {
    "halves_rms", "highpass_rms", "rms", "column_rms", "row_rms", "white_rms", "white_robust_rms", "beyond_5",
    "beyond_10", "hot_fraction", "silent_fraction",
}  # fmt: skip


@dataclass(frozen=True)
class Compared:
    """One statistic of all compared recordings or sensors.

    Attributes
    ----------
    key : str
        Key of the statistic, such as ``flat.rms``.
    label : str
        Name of the statistic in words.
    values : tuple of float
        One value per column of the comparison, NaN if missing.
    """

    key: str
    label: str
    values: tuple[float, ...]

    def format_value(self, value: float) -> str:
        """Return a value as text: in percent if the statistic is a fraction, '–' if the value is not finite."""
        if not np.isfinite(value):
            return "–"
        return f"{value:.3g}" if self.key.split(".")[1] not in _PERCENT else f"{100 * value:.3g} %"


def compare_statistics(columns: list[Figures]) -> list[Compared]:
    """Return the statistics of all columns side by side, in the order in which their keys first appear.

    Statistics without a finite value in any column are left out.
    """
    keys = list(dict.fromkeys(key for column in columns for key in column))
    values = {key: tuple(column.get(key, float("nan")) for column in columns) for key in keys}
    return [Compared(key, _describe(key), values[key]) for key in keys if np.isfinite(values[key]).any()]


def _describe(key: str) -> str:
    group, name = key.split(".", 1)
    if name.startswith("fano_"):
        words = f"Fano factor of counts in {name[5:]} readouts"
    elif "_band_" in name:
        profile, band = name.split("_band_")
        below = (0.0, *BANDS)[BANDS.index(float(band))]
        words = f"variance of {profile}s at {below:g} to {band} cycles per pixel"
    elif "_degree_" in name:
        profile, degree = name.split("_degree_")
        words = f"variance of {profile}s in a Legendre fit of degree {degree}"
    else:
        words = _LABELS[name]
    return f"{group}: {words}"


def _time_figures(statistics: SpikeStatistics, group: str) -> Figures:
    """Return the temporal statistics of a recording, with ``group`` before each key."""
    return {
        f"{group}.rate": statistics.mean_rate,
        f"{group}.cv2": statistics.cv2,
        f"{group}.halves_rms": rms_between_halves(statistics),
        f"{group}.interval_change": statistics.interval_change,
        **{f"{group}.fano_{window}": value for window, value in statistics.fano.items()},
    }


def _pattern_figures(statistics: PatternStatistics) -> Figures:
    """Return the statistics of a response map."""
    found: Figures = {}
    for field in fields(statistics):
        value = getattr(statistics, field.name)
        if isinstance(value, float):
            if field.name != "mean":
                found[f"flat.{field.name}"] = value
        else:
            found |= _list_figures(f"flat.{field.name}", value)
    return found


def _list_figures(key: str, values: tuple[float, ...]) -> Figures:
    """Return one statistic for each band or degree of a profile."""
    stem, ends = key.rsplit("_", 1)[0], BANDS if key.endswith("_bands") else DEGREES
    kind = "band" if key.endswith("_bands") else "degree"
    return {f"{stem}_{kind}_{end:g}": float(value) for end, value in zip(ends, values, strict=True)}


def sensor_statistics(
    sensor: Sensor,
    *,
    shape: tuple[int, int] | None = None,
    rate: float = FLAT_RATE,
    seed: int = 1,
    report: Report | None = None,
) -> Figures:
    """Return the statistics of simulated recordings by a sensor: a flat field, a dark recording and moving bars.

    The dark rates are subtracted from the rates of the flat field before the fixed pattern is measured. There is no
    dark recording if the sensor has no dark charge.

    Parameters
    ----------
    sensor : Sensor
        The sensor to measure.
    shape : tuple of int, optional
        Rows and columns of the array; by default those of the sensor.
    rate : float, default 0.2
        Mean rate of the flat field and of the moving bars, spikes per readout.
    seed : int, default 1
        Seed of the device's fixed pattern and of its noise.
    report : callable, optional
        Called with the name of the recording and the fraction of it that is done.

    Returns
    -------
    dict of str to float
        Statistics by key.

    Raises
    ------
    BadInput
        If the sensor cannot reach the rate, or the rate is not above its dark rate.
    """
    size = shape or (sensor.rows, sensor.columns)

    def measure(what: str, recording: Recording) -> SpikeStatistics:
        return measure_spikes(recording, report=None if report is None else lambda done: report(what, done))

    light = mean_light(sensor, rate)
    even = np.full((1, *size), light, np.float32)
    flat = measure("flat field", EncodedRecording("flat", sensor, even, frames=FLAT_FRAMES, seed=seed, before=_SETTLE))
    found, response = _time_figures(flat, "flat"), flat.rates
    if sensor.mean_dark_e > 0:
        dark = measure("dark", EncodedRecording("dark", sensor, 0 * even, frames=DARK_FRAMES, seed=seed)).rates
        found |= {f"dark.{key}": value for key, value in vars(measure_dark(dark)).items()}
        response = response - dark
    found |= _pattern_figures(measure_pattern(response))
    moving = EncodedRecording(
        "moving", sensor, light * _moving_bars(size), frames=FLAT_FRAMES, seed=seed, knots=_knots_along(FLAT_FRAMES)
    )
    return found | _time_figures(measure("moving light", moving), "moving")


def mean_light(sensor: Sensor, rate: float) -> float:
    """Return the light, in photo-electrons per readout without the dark charge, that gives a mean rate of spikes.

    Raises BadInput if the rate is 0.9 or more, or not above the dark rate of the sensor.
    """
    light = rate * sensor.threshold_e / (1 - sensor.post_spike_loss * rate) - sensor.mean_dark_e if rate < 0.9 else -1
    if not light > 0:
        raise BadInput(
            f"the rate is {rate:g}",
            where=f"sensor {sensor.name}",
            allowed=f"above the dark rate {sensor.dark_rate:g} and below 0.9 spikes per readout",
        )
    return light


def _moving_bars(size: tuple[int, int]) -> np.ndarray:
    """Return smooth vertical bars of light of mean 1 that move by one period, float32 (knots, H, W)."""
    phase = np.arange(size[1])[None] / _BARS - np.linspace(0, 1, _KNOTS)[:, None]
    bars = 1 + 0.5 * np.sin(2 * np.pi * phase)
    return np.repeat(bars[:, None], size[0], axis=1).astype(np.float32)


def _knots_along(frames: int, knots: int = _KNOTS) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    return lambda readout: knot_weights(2 * (readout + 0.5) / frames % 1, knots)


def recording_statistics(recording: Recording, *, report: Report | None = None) -> Figures:
    """Return the temporal statistics of a recording of any scene, and the spread of its rates about a local mean."""
    name = recording.name
    found = measure_spikes(recording, report=None if report is None else lambda done: report(name, done))
    rates = np.where(np.isfinite(found.rates), found.rates, 0.0)
    smooth = gaussian_filter(rates, 2.0)
    flat = flat_areas(found.rates) & (smooth > 0)
    spread = float(np.std(rates[flat] / smooth[flat])) if flat.any() else float("nan")
    return _time_figures(found, "recording") | {"recording.highpass_rms": spread}


def encode_again(recording: Recording, sensor: Sensor, *, seed: int = 1) -> EncodedRecording:
    """Return a simulated recording of the light that another recording shows.

    The light is estimated from rates in up to 32 time windows of at least 48 readouts, smoothed by Gaussians with
    standard deviations of 2 pixels and 1 window, and converted to charge by the sensor's law of saturation. The two
    recordings therefore differ only in the noise and fixed pattern of their sensors.

    Parameters
    ----------
    recording : Recording
        The recording that shows the light.
    sensor : Sensor
        The sensor that records it again.
    seed : int, default 1
        Seed of the device's fixed pattern and of its noise.
    """
    frames, height, width = recording.shape
    step = max(48, -(-frames // 32)) // 8  # bytes
    rates = np.zeros((-(-frames // (8 * step)), height, width), np.float32)
    start = 0
    for block in recording.blocks():
        for at in range(block.shape[2]):
            rates[(start + at) // step] += np.bitwise_count(block[:, :, at])
        start += block.shape[2]
    lengths = np.full(len(rates), 8.0 * step)
    lengths[-1] = frames - 8 * step * (len(rates) - 1)
    rates /= lengths[:, None, None]
    rates = gaussian_filter1d(gaussian_filter(rates, (0, 2, 2)), 1.0, axis=0, mode="nearest")
    total = rates * sensor.threshold_e / (1 - sensor.post_spike_loss * np.minimum(rates, 0.9))
    charge = np.maximum(total - sensor.mean_dark_e, 0).astype(np.float32)

    def knots(readout: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        position = np.clip((readout + 0.5) / (8 * step) - 0.5, 0, len(rates) - 1)
        return knot_weights(position / max(len(rates) - 1, 1), len(rates))

    return EncodedRecording(f"{sensor.name}", sensor, charge, frames=frames, seed=seed, knots=knots, before=_SETTLE)


def published_statistics() -> tuple[Figures, dict[str, str]]:
    """Return the published statistics of real cameras by key, and the source of each group of keys."""
    data = read_yaml(Path(__file__).with_name("published.yaml")).data
    found: Figures = {}
    for part in data.values():
        for key, value in part["values"].items():
            found |= _list_figures(key, tuple(value)) if isinstance(value, list) else {key: float(value)}
    return found, {name: part["source"] for name, part in data.items()}


def as_published(sensor: Sensor, *, seed: int = 1, report: Report | None = None) -> Figures:
    """Return the statistics of a sensor that are also published for real cameras, measured under equal conditions.

    The simulated stream has 200 readouts of 250 × 250 pixels at a mean rate of 0.031 spikes per readout. Its light is
    constant in time and rises linearly from the first column to the last, from 0.5 to 1.5 times its mean.
    """
    frames, *size = STREAM_SHAPE
    ramp = np.broadcast_to(np.linspace(0.5, 1.5, size[1]), (1, *size)) * mean_light(sensor, STREAM_RATE)
    stream = EncodedRecording("stream", sensor, ramp.astype(np.float32), frames=frames, seed=seed, before=BLOCK_FRAMES)
    found = sensor_statistics(sensor, seed=seed, report=report) | _time_figures(measure_spikes(stream), "stream")
    wanted, _ = published_statistics()
    return {key: found[key] for key in wanted if key in found}
