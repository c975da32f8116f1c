"""Statistics of sensors beside those that are published of real spike cameras (published_sensors.yaml).

    python -m studies.published_sensors [SENSOR...]

A sensor is simulated in even light at 0.2 spikes per readout, in the dark, and as the one published stream: 200
readouts of 250 × 250 pixels at a mean rate of 0.031, whose light rises linearly from the first column to the last, from
0.5 to 1.5 times its mean. The dark rates are subtracted from the rates of the flat field before its pattern is
measured. A table is printed, by default of vidar_400x250 and vidar_400x250_noisy.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.addons.calibrate.flat_checks import ROBUST, split_pattern
from saf_gen.addons.calibrate.recordings import BLOCK_FRAMES
from saf_gen.addons.calibrate.spike_statistics import SpikeStatistics, flat_areas, measure_spikes
from saf_gen.camera import Encoder, Sensor, get_sensor
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput

Figures = dict[str, float]
"""Statistics by key; a key is the kind of recording, a dot, and the name of the statistic, such as ``flat.rms``."""

PUBLISHED = Path(__file__).with_name("published_sensors.yaml")
SENSORS = ("vidar_400x250", "vidar_400x250_noisy")
FLAT_RATE, FLAT_FRAMES, DARK_FRAMES = 0.2, 4000, 20_000
SETTLE = 64  # readouts, so that the phases of pixels do not depend on their initial charge
STREAM_SHAPE, STREAM_RATE = (200, 250, 250), 0.031
"""Shape (frames, rows, columns) and mean rate of the only real stream for which statistics are published."""
WINDOWS = (10, 20, 50)
"""Lengths of the windows (readouts) in which spikes are counted."""
CHANGE_BAND = (20, 30)
"""Shortest and longest interval, in readouts, for which the change to the next interval is averaged."""
BANDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Upper ends of the frequency bands into which the variance of a profile is divided, cycles per pixel."""
DEGREES = (1, 2, 4)
"""Degrees of the Legendre fits for which the explained fraction of a profile's variance is reported."""

_LABELS = {
    "rate": "mean rate, spikes per readout",
    "cv2": "local variation of intervals, CV2",
    "halves_rms": "rms of a half's rate, flat areas",
    "interval_change": "change between intervals of 20 to 30 readouts",
    "rms": "rms of the response",
    "column_rms": "– profile of columns",
    "row_rms": "– profile of rows",
    "white_rms": "– white rest",
    "white_robust_rms": "white rest, robust rms",
    "white_kurtosis": "white rest, kurtosis",
    "beyond_5": "pixels beyond 5 robust rms",
    "beyond_10": "pixels beyond 10 robust rms",
    "neighbour_correlation": "white rest, correlation with the next pixel",
    "mean": "mean dark rate, spikes per readout",
    "log_sd": "sd of the dark rate's natural logarithm",
    "hot_fraction": "pixels above 4 times the median dark rate",
}
_PERCENT = {
    "halves_rms", "rms", "column_rms", "row_rms", "white_rms", "white_robust_rms", "beyond_5",
    "beyond_10", "hot_fraction",
}  # fmt: skip


@dataclass(frozen=True)
class EncodedRecording:
    """A simulated recording, which is encoded while it is read.

    Parameters
    ----------
    name : str
        Name of the recording in messages and tables.
    sensor : Sensor
        The sensor that records.
    charge : ndarray of float32, shape (K, H, W)
        Photo-electrons per readout at K knots of time.
    frames : int
        Readouts of the recording.
    seed : int
        Seed of the noise.
    knots : callable, optional
        Maps readout numbers to the knot before each readout and the fraction of the way to the next knot; by default
        the charge of the first knot holds throughout.
    before : int, default 0
        Readouts to encode and discard first, so that the pixels' phases no longer depend on their initial charge.
    device_seed : int, optional
        Seed of the fixed pattern; by default ``seed``.
    """

    name: str
    sensor: Sensor
    charge: np.ndarray
    frames: int
    seed: int
    knots: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    before: int = 0
    device_seed: int | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows and columns."""
        return self.frames, self.charge.shape[1], self.charge.shape[2]

    @property
    def readout_hz(self) -> float:
        """Readouts per second."""
        return self.sensor.readout_hz

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield packed spikes, as :meth:`Recording.blocks` does; each call encodes the same spikes."""
        encoder = Encoder(self.sensor, self.shape[1:], seed=self.seed, device_seed=self.device_seed)
        stack = np.ascontiguousarray(self.charge[None], np.float32)
        if self.before:
            self._encode(encoder, stack, readout=np.zeros(self.before, np.int64))
        for first in range(0, self.frames, BLOCK_FRAMES):
            yield self._encode(encoder, stack, readout=np.arange(first, min(first + BLOCK_FRAMES, self.frames)))

    def _encode(self, encoder: Encoder, stack: np.ndarray, *, readout: np.ndarray) -> np.ndarray:
        still = np.zeros(readout.size, np.int64), np.zeros(readout.size)
        index, fraction = self.knots(readout) if self.knots is not None else still
        return encoder.encode(stack, index=index, fraction=fraction, gain=np.ones((readout.size, 1)))


def band_statistics(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance in each frequency band of :data:`BANDS`, from its periodogram."""
    power = np.abs(np.fft.rfft(profile - profile.mean())) ** 2
    if profile.size % 2 == 0:
        power[-1] /= 2  # the full spectrum holds the highest frequency once and all others twice
    frequency = np.fft.rfftfreq(profile.size)
    total = power[1:].sum()
    edges = (0.0, *BANDS)
    inside = [(frequency > low) & (frequency <= high) for low, high in pairwise(edges)]
    return tuple(float(power[band].sum() / total) if total > 0 else float("nan") for band in inside)


def legendre_fractions(profile: np.ndarray) -> tuple[float, ...]:
    """Return the fraction of a profile's variance that a Legendre fit of each degree in :data:`DEGREES` explains."""
    position = np.linspace(-1, 1, profile.size)
    variance = profile.var()
    if not variance > 0:
        return (float("nan"),) * len(DEGREES)
    fits = [np.polynomial.legendre.Legendre.fit(position, profile, min(d, profile.size - 1))(position) for d in DEGREES]
    return tuple(float(1 - (profile - fit).var() / variance) for fit in fits)


def pattern_figures(map_: np.ndarray) -> dict[str, Any]:
    """Return the statistics of a map of shape (H, W), such as the rates of a flat field, relative to its mean.

    The correlation of neighbours is that of a rest clipped to 3 robust rms, so that specks of dust do not dominate it.
    """
    columns, rows, white = split_pattern(map_)
    deviation = white - np.median(white)
    robust = float(ROBUST * np.median(np.abs(deviation)))
    variance, known = white.var(), map_[np.isfinite(map_)]
    held = np.clip(deviation, -3 * robust, 3 * robust)
    held -= held.mean()
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            "rms": float(known.std() / known.mean()),
            "column_rms": float(columns.std()),
            "row_rms": float(rows.std()),
            "white_rms": float(np.sqrt(variance)),
            "white_robust_rms": robust,
            "white_kurtosis": float(np.mean(white**4) / variance**2),
            "beyond_5": float(np.mean(np.abs(deviation) > 5 * robust)),
            "beyond_10": float(np.mean(np.abs(deviation) > 10 * robust)),
            "neighbour_correlation": float(np.mean(held[:, 1:] * held[:, :-1]) / held.var()),
            "column_bands": band_statistics(columns),
            "row_bands": band_statistics(rows),
            "column_degrees": legendre_fractions(columns),
            "row_degrees": legendre_fractions(rows),
        }


def dark_figures(rates: np.ndarray) -> Figures:
    """Return the statistics of the rates (spikes per readout) of a dark recording, (H, W)."""
    median, fired = float(np.median(rates)), rates[rates > 0]
    return {
        "mean": float(rates.mean()),
        "log_sd": float(np.log(fired).std()),
        "hot_fraction": float(np.mean(rates > 4 * median)),
    }


def stream_figures(spikes: np.ndarray, measured: SpikeStatistics) -> Figures:
    """Return the temporal statistics of a short recording; ``spikes`` are its frames, (T, H, W)."""
    trains = spikes.reshape(len(spikes), -1)
    pixel, time = np.nonzero(trains.T)
    first, second = np.diff(time)[:-1], np.diff(time)[1:]
    same = pixel[2:] == pixel[:-2]  # two intervals of one pixel
    first, second = first[same], second[same]
    change, (low, high) = np.abs(second - first), CHANGE_BAND
    banded = (np.minimum(first, second) >= low) & (np.maximum(first, second) <= high)
    found = {
        "rate": measured.mean_rate,
        "cv2": float((2 * change / (first + second)).mean()),
        "halves_rms": rms_between_halves(measured),
        "interval_change": float(change[banded].mean()) if banded.any() else float("nan"),
    }
    for window in WINDOWS:
        counts = trains[: len(trains) // window * window].reshape(-1, window, trains.shape[1]).sum(axis=1)
        found[f"fano_{window}"] = float(counts.var(axis=0, ddof=1).mean() / counts.mean())
    return found


def rms_between_halves(statistics: SpikeStatistics) -> float:
    """Return the relative temporal rms of the rate over half a recording, from the two halves, in flat areas.

    The median difference, which is a change of the light between the halves, is subtracted.
    """
    first, second = statistics.half_rates
    with np.errstate(invalid="ignore"):
        relative = 2 * (second - first) / (first + second)
    known = relative[np.isfinite(relative) & flat_areas(statistics.rates)]
    return float(np.std(known - np.median(known)) / np.sqrt(2)) if known.size > 1 else float("nan")


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


def published_statistics() -> tuple[Figures, dict[str, str]]:
    """Return the published statistics of real cameras by key, and the source of each group of keys."""
    data = read_yaml(PUBLISHED).data
    values = {key: value for part in data.values() for key, value in part["values"].items()}
    return _flat(values), {name: part["source"] for name, part in data.items()}


def as_published(sensor: Sensor, *, seed: int = 1) -> Figures:
    """Return the statistics of a sensor that are also published for real cameras, measured under equal conditions."""
    light, size = mean_light(sensor, FLAT_RATE), (sensor.rows, sensor.columns)
    even = np.full((1, *size), light, np.float32)
    flat = EncodedRecording("flat", sensor, even, frames=FLAT_FRAMES, seed=seed, before=SETTLE)
    dark = measure_spikes(EncodedRecording("dark", sensor, 0 * even, frames=DARK_FRAMES, seed=seed)).rates
    frames, *shape = STREAM_SHAPE
    ramp = np.broadcast_to(np.linspace(0.5, 1.5, shape[1]), (1, *shape)) * mean_light(sensor, STREAM_RATE)
    stream = EncodedRecording("stream", sensor, ramp.astype(np.float32), frames=frames, seed=seed, before=BLOCK_FRAMES)
    packed = np.concatenate(list(stream.blocks()), axis=2)
    spikes = np.unpackbits(packed, axis=2, bitorder="little", count=frames).transpose(2, 0, 1)
    groups = {
        "flat": pattern_figures(measure_spikes(flat).rates - dark),
        "dark": dark_figures(dark),
        "stream": stream_figures(spikes, measure_spikes(stream)),
    }
    found = _flat({f"{group}.{name}": value for group, figures in groups.items() for name, value in figures.items()})
    return {key: found[key] for key in published_statistics()[0]}


def _flat(values: dict[str, Any]) -> Figures:
    """Return statistics by key, with one for each band or degree of a profile."""
    found = Figures()
    for key, value in values.items():
        if key.endswith(("_bands", "_degrees")):
            stem, kind = key.rsplit("_", 1)
            ends = BANDS if kind == "bands" else DEGREES
            found |= {f"{stem}_{kind[:-1]}_{end:g}": float(v) for end, v in zip(ends, value, strict=True)}
        else:
            found[key] = float(value)
    return found


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


def format_figure(key: str, value: float) -> str:
    """Return a value as text: in percent if the statistic is a fraction, '–' if the value is not finite."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.3g}" if key.split(".")[1] not in _PERCENT else f"{100 * value:.3g} %"


def main() -> None:
    """Print the table and the sources of what is published."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sensors", nargs="*", default=SENSORS, help="names of sensors, or sensor files")
    names = parser.parse_args().sensors
    real, sources = published_statistics()
    columns = [real, *(as_published(get_sensor(name)) for name in names)]
    print("| statistic | real |", " | ".join(f"`{name}`" for name in names), "|")
    print("|---" * (len(columns) + 1) + "|")
    for key in real:
        print("|", " | ".join([_describe(key), *(format_figure(key, column[key]) for column in columns)]), "|")
    for part, source in sources.items():
        print(f"published, {part}: {source}")


if __name__ == "__main__":
    main()
