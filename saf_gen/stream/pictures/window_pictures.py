"""Windows of a recording as pictures, read one at a time so that memory does not grow with the recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import index

import numpy as np

from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.region import validate_window
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interval_texture import window_texture
from saf_gen.stream.readable import ReadableStream

KINDS = {
    "tfp": "Texture from playback: the spikes of each pixel in the window",
    "tfi": "Texture from intervals: the rate from the interval between spikes around the middle of the window",
    "spikes": "The readout in the middle of the window; spikes are white",
}
WINDOW = 100
"""Default number of frames per window, as in a block of the methods; in a short view it is a tenth of the view."""
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
    count: int = 6,
    max_count: int = 10_000,
) -> WindowPictures:
    """Return pictures of windows within the view, frames ``first <= t < stop``.

    A window begins every ``every`` frames. If that is not given, ``count`` windows are spread evenly over the view, or
    fewer if some would begin at the same frame. A ``window`` has 100 frames by default, or a tenth of the view if it
    has fewer than 1,000 frames.

    Raises BadInput if the kind is unknown, the view leaves the recording, a window is longer than the view, or there
    would be more than ``max_count`` pictures.
    """
    if kind not in KINDS:
        raise unknown("kind of picture", kind, allowed=KINDS)
    total = stream.shape[0]
    span = validate_window(first, total if stop is None else stop, total=total, where=str(stream.path))
    length = _positive_integer("window", min(WINDOW, -(-len(span) // 10)) if window is None else window)
    if length > len(span):
        raise BadInput(
            f"a window of {length} frames in a view of {len(span)}", allowed=f"1 to {len(span)}", hint="widen the view"
        )
    last = span.stop - length
    if every is None:
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
        return window_texture(stream.packed, stream.counts, first=first, stop=stop)
    return stream.counts(first, stop)


def _positive_integer(name: str, value: int) -> int:
    try:
        number = index(value)
    except TypeError:
        number = 0
    if number < 1:
        raise BadInput(f"{name} is {value!r}", allowed="a whole number of frames, at least 1")
    return number
