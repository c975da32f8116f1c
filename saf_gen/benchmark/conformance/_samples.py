"""Reproducible input for checks: counts of all kinds, a small scene, and recordings of it or of a given focus curve."""

from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from saf_gen.benchmark.conformance._check_runner import CheckLimits
from saf_gen.camera import Sensor, charge_of_images, encode, exposure_scale, get_sensor
from saf_gen.core.region import validate_window
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.optics import ImageDistanceDrive
from saf_gen.parts import wants_frames, wants_halves
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_writer import StreamWriter


def sample_counts(*shape: int, highest: int = 50) -> np.ndarray:
    """Return counts drawn uniformly from 0 to ``highest`` - 1: uint32 of the given shape, read-only."""
    counts = make_generator("conformance", *shape).integers(0, highest, shape, dtype=np.uint32)
    counts.flags.writeable = False
    return counts


@lru_cache
def sample_texture(rows: int, columns: int) -> np.ndarray:
    """Return a random image with amplitudes proportional to 1/frequency, as they are on average in natural scenes.

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        Read-only; the mean is about 1, the contrast about 0.4 rms, and the minimum at least 0.05.

    References
    ----------
    D. J. Field, "Relations between the statistics of natural images and the response properties of cortical cells",
    JOSA A 4(12), 1987, doi:10.1364/JOSAA.4.002379.
    """
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns))
    frequency[0, 0] = 1.0
    white = np.fft.fft2(make_generator("conformance", "texture", rows, columns).normal(size=(rows, columns)))
    image = np.fft.ifft2(white / frequency).real
    image = np.maximum(1 + 0.4 * (image - image.mean()) / image.std(), 0.05)
    image.flags.writeable = False
    return image


EDGE_CASE_COUNTS: dict[str, np.ndarray] = {
    "random": sample_counts(37, 52),
    "empty": np.zeros((20, 30), np.uint32),
    "saturated": np.full((20, 30), 20_000, np.uint32),
    "one-pixel": sample_counts(1, 1),
    "one-row": sample_counts(1, 40),
    "one-column": sample_counts(40, 1),
    "one-spike": np.eye(1, 400, 7, dtype=np.uint32).reshape(20, 20),
}
"""Counts that every measure must be able to score."""


ROWS, COLUMNS, POSITIONS = 32, 48, 33
BLUR = 8.0  # sigma in pixels at a distance of one travel from the best focus
BEST_FOCUS = 0.4
TARGET_RATE = 0.2  # spikes per pixel and readout
OVEREXPOSURE = 50.0  # multiple of that light at which every pixel fires at nearly every readout
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))


@dataclass(frozen=True, eq=False)
class ConformanceScene:
    """A focal stack with its best focus at a given position, the lens drive and the sensor.

    The scene is a flat texture with the spectrum of natural scenes. It is blurred by a Gaussian whose sigma grows with
    the distance of the lens from the best focus.

    Attributes
    ----------
    best : float
        Position of best focus, as a fraction of the travel.
    radiance : ndarray of float32, shape (light, focus, row, col)
        Focal stack of each light.
    drive : ImageDistanceDrive
        Drive of the lens.
    sensor : Sensor
        The sensor.
    exposure : float
        Factor that scales the light so that the sensor fires TARGET_RATE spikes per pixel and readout at best focus.
    """

    best: float
    radiance: np.ndarray
    drive: ImageDistanceDrive
    sensor: Sensor
    exposure: float

    def charge(self) -> np.ndarray:
        """Return the charge at the scene's exposure, in electrons per readout, float32 (focus, row, col)."""
        return _charge(self.radiance, self.sensor)[0] * np.float32(self.exposure)


@lru_cache
def make_scene(best: float) -> ConformanceScene:
    """Return the scene with its best focus at the position ``best``, a fraction of the travel."""
    sensor = get_sensor("vidar_400x250", rows=ROWS, columns=COLUMNS)
    sharp = sample_texture(ROWS, COLUMNS)
    distance = np.abs(np.linspace(0, 1, POSITIONS) - best)
    radiance = np.stack([gaussian_filter(sharp, BLUR * d, mode="wrap") for d in distance])[None].astype(np.float32)
    at_best = _charge(radiance, sensor)[0, int(distance.argmin())]
    exposure = exposure_scale(at_best, np.ones((ROWS, COLUMNS), bool), sensor=sensor, mean_rate=TARGET_RATE)
    return ConformanceScene(best, radiance, DRIVE, sensor, exposure)


def write_recordings(folder: Path, frames: int) -> dict[str, Path]:
    """Write recordings of ``frames`` frames and return their paths by name.

    The names are ``empty``, ``full``, ``saturated`` and ``swept``; the first two have no lens positions.
    """
    scene = make_scene(BEST_FOCUS)
    empty = np.zeros((ROWS, COLUMNS, -(-frames // 8)), np.uint8)
    full = np.broadcast_to(np.packbits(np.arange(frames) >= 0, bitorder="little"), empty.shape)
    swept, saturated = (
        encode(scene.charge() * np.float32(gain), scene.sensor, frames=frames, seed=1) for gain in (1, OVEREXPOSURE)
    )
    lens = ((np.arange(frames) + 0.5) / frames).astype(np.float32)
    known = Metadata(focus_position=lens, truth=Truth(position=BEST_FOCUS, frame=BEST_FOCUS * frames - 0.5))
    paths = {}
    for name, spikes in {"empty": empty, "full": full, "saturated": saturated, "swept": swept}.items():
        metadata = Metadata() if name in ("empty", "full") else known
        paths[name] = folder / f"{name}.h5"
        with StreamWriter(paths[name], shape=(frames, ROWS, COLUMNS), metadata=metadata) as writer:
            writer.write(spikes)
    return paths


def _charge(radiance: np.ndarray, sensor: Sensor) -> np.ndarray:
    return charge_of_images(radiance, sensor, lens=DRIVE, position=np.linspace(0, 1, POSITIONS))


MEAN_RATE = 0.2  # spikes per pixel and readout
SIZE = 16, 24
EVENT_STEP = 0.02  # change of a pixel, in parts of its mean, that makes an event


def bell(frames: int, peak: float, *, width: float = 0.1) -> np.ndarray:
    """Return a Gaussian focus curve of height 1, one value per frame.

    The peak is at the fraction ``peak`` of the recording; at the distance ``width``, also a fraction of the recording,
    the curve has fallen to 1/e.
    """
    return np.exp(-(((np.arange(frames) / frames - peak) / width) ** 2))


class SyntheticRecording:
    """A :class:`saf_gen.parts.View` of a recording in which each score is the mean of ``curve`` over the window.

    Measures that the search names score counts, which are a texture whose contrast follows the curve.

    Parameters
    ----------
    curve : ndarray of float
        Focus curve, one value per frame.
    unit : float, optional
        Factor by which scores of the method's own measure are multiplied.
    light : float, optional
        Mean rate, in spikes per pixel and readout.
    limits : CheckLimits, optional
        Limits on the number of scores.

    Attributes
    ----------
    seen : int
        Number of frames up to the last one that was looked at.
    scores : int
        Number of windows that were scored or looked at.
    """

    readout_hz = 20_000.0
    lag_s = 0.0

    def __init__(
        self, curve: np.ndarray, *, unit: float = 1.0, light: float = MEAN_RATE, limits: CheckLimits | None = None
    ) -> None:
        self.frames, self._unit, self._light = len(curve), unit, light
        self._sums = np.concatenate([[0.0], np.cumsum(curve, dtype=np.float64)])
        self._lowest, self._range = float(curve.min()), float(np.ptp(curve))
        self._limits = limits or CheckLimits()
        self.seen, self.scores = 0, 0

    @property
    def now(self) -> int:
        return self.seen

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        mean, frames = self._look(first, stop)
        if measure is None:
            return self._unit * mean
        scorer, counts = _measure(measure), self._make_texture(mean, frames=frames)
        scored_counts = np.stack([counts, counts]) / 2 if wants_halves(scorer) else counts
        if wants_frames(scorer):
            return scorer(scored_counts, frames=frames)  # type: ignore[call-arg]
        return scorer(scored_counts)

    def counts(self, first: int, stop: int) -> np.ndarray:
        mean, frames = self._look(first, stop)
        return np.rint(self._make_texture(mean, frames=frames)).astype(np.uint32)

    def polarities(self, first: int, stop: int) -> np.ndarray:
        """Return what an event camera would report of the texture, whose contrast follows the curve."""
        self._look(first, stop)
        before, after = (self._level(frame) for frame in (max(first - 1, 0), stop - 1))
        change = after - before
        events = np.stack([np.maximum(-change, 0), np.maximum(change, 0)]).astype(np.uint32)
        events.flags.writeable = False
        return events

    def _level(self, frame: int) -> np.ndarray:
        """Return the number of thresholds that each pixel has passed since it was even, 0 in the dark."""
        value = float(self._sums[frame + 1] - self._sums[frame])
        contrast = (value - self._lowest) / self._range if self._range and self._light else 0.0
        return np.trunc(contrast * (sample_texture(*SIZE) - 1) / EVENT_STEP)

    def position(self, frame: int) -> float:
        validate_window(frame, frame + 1, total=self.frames)
        self.seen = max(self.seen, frame + 1)  # reading a later position looks ahead
        return frame / max(self.frames - 1, 1)

    def move(self, to: float) -> None:
        raise BadInput(f"the lens of a recording cannot be moved to {to}")

    def wait(self, frames: int) -> None:
        raise BadInput(f"the lens of a recording cannot wait for {frames} frames")

    def _look(self, first: int, stop: int) -> tuple[float, int]:
        """Return the mean of the curve over a window, and the number of its frames."""
        window = validate_window(first, stop, total=self.frames)
        self.scores += 1
        self._limits.check_scores(self.scores)
        self.seen = max(self.seen, window.stop)
        return float(self._sums[window.stop] - self._sums[window.start]) / len(window), len(window)

    def _make_texture(self, mean: float, *, frames: int) -> np.ndarray:
        contrast = (mean - self._lowest) / self._range if self._range else 0.0
        return self._light * frames * (1 + contrast * (sample_texture(*SIZE) - 1))


_measure = cache(get_measure)
