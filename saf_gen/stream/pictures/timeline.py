"""What is known and measured over the time of a view: lens, light, truth, and scores of measures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from saf_gen.core.region import Region
from saf_gen.parts import wants_frames
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.interval_texture import texture_of_stream_window
from saf_gen.stream.measure_input import stream_input_for_measure
from saf_gen.stream.readable import ReadableStream

SCORED = 200
"""Most windows in which measures are scored; evenly over the view."""
BINS = 500
"""Most points of a line; of more frames each point tells the extremes of its bin."""
SEPARATOR = " · "


@dataclass(frozen=True, eq=False)
class Extremes:
    """A quantity over the frames, as its smallest and largest value in each of some bins; each float64 (n,)."""

    frames: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Timeline:
    """What is drawn beside pictures; what is not known is None or empty.

    Attributes
    ----------
    first, stop : the frames of the view.
    lens, truth : fractions of the travel; the truth is one position, or moves.
    depth_of_focus : how far its ends are from the truth, near and far, fractions of the travel.
    gains : light groups by name, 1 is nominal.
    centres, rate : the windows that were counted, frames, and their spikes per pixel and readout, each float64 (n,).
    scores : by measure, float64 (n,).
    """

    first: int
    stop: int
    lens: Extremes | None
    truth: Extremes | None
    depth_of_focus: tuple[float, float]
    gains: Mapping[str, Extremes]
    centres: np.ndarray
    rate: np.ndarray
    scores: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class _Windows:
    """Windows of a stream, in a region of it."""

    stream: ReadableStream
    region: Region | None

    def window(self, first: int, stop: int) -> np.ndarray:
        return self.stream.counts(first, stop, region=self.region)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self.stream.packed(first_byte, stop_byte, region=self.region)

        return texture_of_stream_window(read, self.window, first=first, stop=stop)


def read_stream_timeline(
    stream: ReadableStream,
    *,
    first: int,
    stop: int,
    window: int,
    measures: Sequence[str] = (),
    region: Region | None = None,
) -> Timeline:
    """Return what is known over frames ``first <= t < stop``, and scores of ``measures`` in windows of ``region``.

    At most SCORED windows are counted, side by side or evenly spaced. Raises BadInput for an unknown measure, and for a
    window that a measure cannot score.
    """
    scorers = {name: get_measure(name) for name in measures}
    count = min(max((stop - first) // window, 1), SCORED)
    starts = np.unique(np.linspace(first, stop - window, count).astype(np.int64)).tolist()
    source = _Windows(stream, region)
    scores: dict[str, list[float]] = {name: [] for name in scorers}
    for a in starts:
        for name, scorer in scorers.items():
            seen = stream_input_for_measure(source, scorer, first=a, stop=a + window)
            scores[name].append(scorer(seen, **({"frames": window} if wants_frames(scorer) else {})))
    truth, lens, gain = stream.truth, stream.focus_position, stream.gain
    track = np.full(stream.shape[0], truth.position) if truth.track is None else truth.track
    lines = [] if gain is None else list(gain.T)
    names = stream.light_names or [f"light {n + 1}" for n in range(len(lines))]
    names = names if lines else []
    near, far = sorted(truth.depth_of_focus) if all(map(isfinite, truth.depth_of_focus)) else (np.nan, np.nan)
    return Timeline(
        first,
        stop,
        None if lens is None else _find_extremes(lens, first=first, stop=stop),
        _find_extremes(track, first=first, stop=stop) if truth.known else None,
        (near - truth.position, far - truth.position),
        {name: _find_extremes(line, first=first, stop=stop) for name, line in zip(names, lines, strict=True)},
        np.array(starts) + (window - 1) / 2,
        np.array([stream.counts(a, a + window).mean() / window for a in starts]),
        {name: np.array(values) for name, values in scores.items()},
    )


def _find_extremes(values: np.ndarray, *, first: int, stop: int) -> Extremes:
    edges = np.unique(np.linspace(first, stop, min(stop - first, BINS) + 1).astype(np.int64))
    part = np.asarray(values[first:stop], np.float64)
    low = np.minimum.reduceat(part, edges[:-1] - first)
    high = np.maximum.reduceat(part, edges[:-1] - first)
    return Extremes((edges[:-1] + edges[1:] - 1) / 2, low, high)


def describe_moment_of_stream(stream: ReadableStream, *, first: int, window: int) -> str:
    """Return what is known of a window, in a line: its frames, the lens, how far it is from the focus."""
    stop = first + window
    parts = [f"frames {first:,}–{stop - 1:,}" if window > 1 else f"frame {first:,}"]
    lens, truth = stream.focus_position, stream.truth
    if lens is not None:
        at = float(np.mean(lens[first:stop], dtype=np.float64))
        parts.append(f"lens {at:.3f}")
        depth = abs(truth.depth_of_focus[1] - truth.depth_of_focus[0])
        if truth.known and isfinite(depth) and depth > 0:
            best = truth.position if truth.track is None else float(np.mean(truth.track[first:stop], dtype=np.float64))
            parts.append(f"{(at - best) / depth:+.1f} DoF".replace("-", "−"))
    parts.append(f"from {first / stream.readout_hz * 1e3:.1f} ms")
    return " · ".join(parts)
