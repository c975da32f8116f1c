"""Pictures of windows of a recording, and the quantities over its frames: lens, light, truth, scores of measures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from operator import index

import numpy as np

from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.region import Region, validate_window
from saf_gen.core.user_code import named_user_code
from saf_gen.errors import BadInput, unknown
from saf_gen.parts import wants_frames
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import measure_input, wanted_form
from saf_gen.stream.metadata import ReadableStream

KINDS = {
    "tfp": "Texture from playback: the spikes, events or levels of each pixel in the window",
    "tfi": "Texture from intervals: the rate from the interval between spikes around the middle of the window",
    "spikes": "The readout in the middle of the window; spikes are white",
}
WINDOW = 100
"""Default number of frames per window, as in a block of the methods; in a short view it is a tenth of the view. Of a
frame camera it is one."""
WHITE_QUANTILE, WHITE_WINDOWS = 0.998, 12
"""Fraction of pixels below white, and number of windows that determine white, which all pictures share."""


@dataclass(frozen=True, eq=False)
class WindowPictures:
    """Pictures of windows of a recording, evenly spaced.

    Attributes
    ----------
    stream : ReadableStream
        The open recording.
    kind : str
        A key of KINDS.
    window : int
        Frames per window.
    starts : ndarray of int64, shape (n,)
        First frame of each window.
    white : float
        Light that is shown as white, in counts per window.
    """

    stream: ReadableStream
    kind: str
    window: int
    starts: np.ndarray
    white: float

    @property
    def centres(self) -> np.ndarray:
        """The middle of each window in frames, float64 (n,)."""
        centres: np.ndarray = self.starts + (self.window - 1) / 2
        return centres

    def linear(self, number: int) -> np.ndarray:
        """Return the light of a picture (H, W) in counts per window; for the kind ``spikes``, values are 0 and 1."""
        return _read_picture(self.stream, self.kind, first=int(self.starts[number]), window=self.window)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield the pictures as grey values for a screen, uint8 (H, W)."""
        for number in range(len(self.starts)):
            grey = display_gamma(self.linear(number), self.white)
            yield (255 * grey).round().astype(np.uint8)


def choose_windows(
    stream: ReadableStream,
    *,
    kind: str = "tfp",
    window: int | None = None,
    first: int = 0,
    stop: int | None = None,
    every: int | None = None,
    at: Sequence[float] = (),
    count: int = 6,
    max_count: int = 10_000,
) -> WindowPictures:
    """Return pictures of windows within the view, frames ``first <= t < stop``.

    A window begins every ``every`` frames. If that is not given, ``count`` windows are spread evenly over the view, or
    fewer if some would begin at the same frame. Frames ``at`` which windows have their middle, as nearly as the view
    allows, stand in place of both. A ``window`` has 100 frames by default, or a tenth of the view if it
    has fewer than 1,000 frames; one frame of a frame camera.

    Raises BadInput if the kind is unknown or of spikes that the camera has not, the view leaves the recording, a window
    is longer than the view, or there would be more than ``max_count`` pictures.
    """
    if kind not in KINDS:
        raise unknown("kind of picture", kind, allowed=KINDS)
    if kind != "tfp" and stream.form != "bits":
        raise BadInput(
            f"pictures {kind} of a recording of {stream.counted}", where=str(stream.path),
            allowed="tfp, the sum of a window",
        )  # fmt: skip
    total = stream.shape[0]
    span = validate_window(first, total if stop is None else stop, total=total, where=str(stream.path))
    usual = 1 if stream.form == "frames" else min(WINDOW, -(-len(span) // 10))
    length = _positive_integer("window", usual if window is None else window)
    if length > len(span):
        raise BadInput(
            f"a window of {length} frames in a view of {len(span)}", allowed=f"1 to {len(span)}", hint="widen the view"
        )
    last = span.stop - length
    if len(at):
        starts = np.clip(np.round(np.sort(at) - (length - 1) / 2), span.start, last).astype(np.int64)
    elif every is None:
        starts = np.unique(np.linspace(span.start, last, max(count, 1)).astype(np.int64))
    else:
        starts = np.arange(span.start, last + 1, _positive_integer("every", every))
    if len(starts) > max_count:
        raise BadInput(
            f"{len(starts)} pictures",
            allowed=f"at most {max_count}",
            hint=f"use --every {-(-(last - span.start + 1) // max_count)} or a shorter view",
        )
    shown = starts[np.unique(np.linspace(0, len(starts) - 1, WHITE_WINDOWS).astype(int))]
    samples = (_read_picture(stream, kind, first=int(a), window=length) for a in shown)
    white = 1.0 if kind == "spikes" else max(white_level(s, quantile=WHITE_QUANTILE) for s in samples)
    return WindowPictures(stream, kind, length, starts, white)


def _read_picture(stream: ReadableStream, kind: str, *, first: int, window: int) -> np.ndarray:
    stop = first + window
    if kind == "spikes":
        middle = (first + stop - 1) // 2
        return stream.frames(middle, middle + 1)[0]
    if kind == "tfi":
        return stream.texture(first, stop)
    return stream.counts(first, stop)


def _positive_integer(name: str, value: int) -> int:
    try:
        number = index(value)
    except TypeError:
        number = 0
    if number < 1:
        raise BadInput(f"{name} is {value!r}", allowed="a whole number of frames, at least 1")
    return number


SCORED = 200
"""Largest number of windows in which measures are scored, spread evenly over the view."""
BINS = 500
"""Largest number of points in a line; if there are more frames, each point shows the extremes of a bin."""
SEPARATOR = " · "


@dataclass(frozen=True, eq=False)
class Extremes:
    """The smallest and largest value of a quantity in each of n bins of frames; all arrays are float64 (n,)."""

    frames: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Timeline:
    """The quantities that are plotted next to pictures; an unknown quantity is None, NaN or empty.

    Attributes
    ----------
    first, stop : int
        The view, frames ``first <= t < stop``.
    lens : Extremes or None
        Position of the lens, as a fraction of the travel.
    truth : Extremes or None
        Position of true focus, as a fraction of the travel; it is constant unless the scene moves.
    depth_of_focus : tuple of float
        Distances of the lower and the upper end of the depth of focus from the truth, as fractions of the travel.
    whole_target : tuple of float
        Those of the positions between which something of the target is in focus.
    gains : mapping of str to Extremes
        Gain of each light group by name; 1 is nominal.
    centres : ndarray of float64, shape (n,)
        Middle of each counted window, in frames.
    rate : ndarray of float64, shape (n,)
        Spikes, events or levels per pixel and readout in each counted window.
    scores : mapping of str to ndarray of float64, shape (n,)
        Scores of each measure by name.
    counted : str
        What the rate counts: ``spikes``, ``events`` or ``levels``.
    """

    first: int
    stop: int
    lens: Extremes | None
    truth: Extremes | None
    depth_of_focus: tuple[float, float]
    whole_target: tuple[float, float]
    gains: Mapping[str, Extremes]
    centres: np.ndarray
    rate: np.ndarray
    scores: Mapping[str, np.ndarray]
    counted: str


@dataclass(frozen=True)
class _Windows:
    """Windows of a region of a stream, as input of measures."""

    stream: ReadableStream
    region: Region | None

    def window(self, first: int, stop: int) -> np.ndarray:
        return self.stream.counts(first, stop, region=self.region)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        return self.stream.texture(first, stop, region=self.region)


def read_timeline(
    stream: ReadableStream,
    *,
    first: int,
    stop: int,
    window: int,
    measures: Sequence[str] = (),
    find_measure: Callable[[str], Callable[..., float]] = get_measure,
    region: Region | None = None,
) -> Timeline:
    """Return the known quantities in frames ``first <= t < stop``, with scores of ``measures`` in ``region``.

    Windows follow each other directly or, if that would be more than SCORED windows, at even intervals. Raises BadInput
    if a measure is unknown or cannot score a window.
    """
    scorers = {name: find_measure(name) for name in measures}
    count = min(max((stop - first) // window, 1), SCORED)
    starts = np.unique(np.linspace(first, stop - window, count).astype(np.int64)).tolist()
    source = _Windows(stream, region)
    scores: dict[str, list[float]] = {name: [] for name in scorers}
    for a in starts:
        for name, scorer in scorers.items():
            seen = measure_input(source, wanted_form(scorer), first=a, stop=a + window)
            with named_user_code(name, "focus measure"):
                scores[name].append(scorer(seen, **({"frames": window} if wants_frames(scorer) else {})))
    truth, lens, gain = stream.truth, stream.metadata.lens_position, stream.gain
    track = np.full(stream.shape[0], truth.position) if truth.track is None else truth.track
    lines = [] if gain is None else list(gain.T)
    names = stream.light_names or [f"light {n + 1}" for n in range(len(lines))]
    names = names if lines else []
    near, far = sorted(truth.depth_of_focus) if all(map(isfinite, truth.depth_of_focus)) else (np.nan, np.nan)
    first_sharp, last_sharp = truth.whole_target
    return Timeline(
        first,
        stop,
        None if lens is None else _find_extremes(lens, first=first, stop=stop),
        _find_extremes(track, first=first, stop=stop) if truth.known else None,
        (near - truth.position, far - truth.position),
        (first_sharp - truth.position, last_sharp - truth.position),
        {name: _find_extremes(line, first=first, stop=stop) for name, line in zip(names, lines, strict=True)},
        np.array(starts) + (window - 1) / 2,
        np.array([stream.counts(a, a + window).mean() / window for a in starts]),
        {name: np.array(values) for name, values in scores.items()},
        "levels" if stream.form == "frames" else stream.counted,
    )


def _find_extremes(values: np.ndarray, *, first: int, stop: int) -> Extremes:
    edges = np.unique(np.linspace(first, stop, min(stop - first, BINS) + 1).astype(np.int64))
    part = np.asarray(values[first:stop], np.float64)
    low = np.minimum.reduceat(part, edges[:-1] - first)
    high = np.maximum.reduceat(part, edges[:-1] - first)
    return Extremes((edges[:-1] + edges[1:] - 1) / 2, low, high)


def describe_moment(stream: ReadableStream, *, first: int, window: int) -> str:
    """Return one line about a window: frames, lens position, distance from focus in depths of focus, and start time."""
    stop = first + window
    parts = [f"frames {first:,}–{stop - 1:,}" if window > 1 else f"frame {first:,}"]
    lens, truth = stream.metadata.lens_position, stream.truth
    if lens is not None:
        at = float(np.mean(lens[first:stop], dtype=np.float64))
        parts.append(f"lens {at:.3f}")
        depth = abs(truth.depth_of_focus[1] - truth.depth_of_focus[0])
        if truth.known and isfinite(depth) and depth > 0:
            best = truth.position if truth.track is None else float(np.mean(truth.track[first:stop], dtype=np.float64))
            parts.append(f"{(at - best) / depth:+.1f} DoF".replace("-", "−"))
    parts.append(f"from {stream.metadata.readout_of(first) / stream.readout_hz * 1e3:.1f} ms")
    return " · ".join(parts)
