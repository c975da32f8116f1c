"""Spike counts of any window of a recording, cheaply.

A search asks for hundreds of windows, often half the recording long, and several methods ask for the same
ones: long windows are summed from knots, and those already counted are kept.
"""

from collections import OrderedDict
from collections.abc import Callable
from typing import Protocol

import numpy as np

from saf_gen.benchmark.view.interval_texture import time_texture_from_intervals
from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.errors import BadInput
from saf_gen.parts import wants_halves, wants_intervals
from saf_gen.stream.stream_file import SpikeStream

__all__ = ["WindowCounts", "WindowSource", "measure_input"]

KNOTS = 256
KNOT_BYTES = 128 << 20
WINDOW_BYTES = 256 << 20


class WindowSource(Protocol):
    """What can be seen of a window of frames, on a recording or on a camera that is running.

    ``textures_s``: seconds in which the textures asked for so far were made, reading and counting apart; of
    one that was kept from before as long as it took then.
    """

    textures_s: float

    def window(self, first: int, stop: int) -> np.ndarray: ...

    def halves(self, first: int, stop: int) -> np.ndarray: ...

    def intervals(self, first: int, stop: int) -> np.ndarray: ...


def measure_input(windows: WindowSource, measure: object, first: int, stop: int) -> np.ndarray:
    """What a measure is given of frames ``first <= t < stop``: counts, those of both halves, or intervals."""
    if wants_halves(measure):
        return windows.halves(first, stop)
    return windows.intervals(first, stop) if wants_intervals(measure) else windows.window(first, stop)


class WindowCounts:
    """Spike counts of any window of a stream, in a region of it.

    Memory: 128 MiB of sums and 256 MiB of windows already counted, beside what the stream keeps. One thread
    at a time; the stream stays open meanwhile.

    Parameters
    ----------
    stream : an open stream.
    region : (slice of rows, slice of columns), steps of 1; None is the whole frame.

    Raises
    ------
    BadInput : for a region that is empty or leaves the frame.
    """

    def __init__(self, stream: SpikeStream, region: Region | None = None) -> None:
        self.frames, height, width = stream.shape
        self._stream, self._region = stream, validate_region(region, (height, width))
        self.shape = region_shape(self._region)
        self.readout_hz, self.lens_position = stream.readout_hz, stream.focus_position
        image_bytes = 4 * self.shape[0] * self.shape[1]
        between = max(min(KNOTS, KNOT_BYTES // image_bytes) - 1, 1)
        self._step = 8 * -(-self.frames // (8 * between))
        self._sums: np.ndarray | None = None
        self._kept: OrderedDict[tuple[str, int, int], np.ndarray] = OrderedDict()
        self._held = 0  # bytes of those
        self._made_s: dict[tuple[str, int, int], float] = {}  # of those, the seconds of each texture
        self.textures_s = 0.0

    def window(self, first: int, stop: int) -> np.ndarray:
        """Counts in frames ``first <= t < stop`` (0-based): uint32 (h, w), read-only.

        Raises BadInput unless the window holds at least one frame and lies in the recording.
        """
        window = validate_window(first, stop, self.frames)
        return self._keep("counts", self._count, window)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Texture from intervals of a window of n frames: float64 (h, w), n over the interval, read-only.

        See :func:`saf_gen.benchmark.view.interval_texture.texture`. Raises BadInput as ``window`` does.
        """
        window = validate_window(first, stop, self.frames)
        image = self._keep("intervals", self._texture, window)
        self.textures_s += self._made_s["intervals", window.start, window.stop]
        return image

    def halves(self, first: int, stop: int) -> np.ndarray:
        """Counts in both halves of a window of n frames, n // 2 and the rest: uint32 (2, h, w).

        Raises BadInput as ``window`` does, and for a single frame.
        """
        window = validate_window(first, stop, self.frames)
        if len(window) < 2:
            raise BadInput(
                f"the window of frame {window.start} alone has no halves",
                allowed="windows of 2 frames or more for a measure that compares halves",
            )
        middle = window.start + len(window) // 2
        return np.stack([self.window(window.start, middle), self.window(middle, window.stop)])

    def _keep(self, kind: str, made: Callable[[int, int], np.ndarray], window: range) -> np.ndarray:
        """What was made of a window before, or is made now; the oldest go where they take too much memory."""
        key = kind, window.start, window.stop
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        image = made(window.start, window.stop)
        image.flags.writeable = False  # the next method gets the same array
        self._kept[key] = image
        self._held += image.nbytes
        while self._held > WINDOW_BYTES and len(self._kept) > 1:
            oldest, gone = self._kept.popitem(last=False)
            self._held -= gone.nbytes
            self._made_s.pop(oldest, None)
        return image

    def _count(self, first: int, stop: int) -> np.ndarray:
        after, before = -(-first // self._step), stop // self._step  # the knots just inside the window
        if before - after < 2:
            return self._stream.counts(first, stop, region=self._region)
        if self._sums is None:
            self._sums = self._running_sums()
        counts = self._sums[before] - self._sums[after]
        for a, b in ((first, after * self._step), (before * self._step, stop)):
            if a < b:
                counts += self._stream.counts(a, b, region=self._region)
        return counts

    def _texture(self, first: int, stop: int) -> np.ndarray:
        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._stream.packed(first_byte, stop_byte, region=self._region)

        image, self._made_s["intervals", first, stop] = time_texture_from_intervals(
            read, self._count, first, stop=stop
        )
        return image

    def _running_sums(self) -> np.ndarray:
        """Spikes before each whole multiple of the step: uint32 (knots, h, w)."""
        whole = self.frames // self._step
        sums = np.zeros((whole + 1, *self.shape), dtype=np.uint32)
        for knot in range(whole):
            first = self._step * knot
            sums[knot + 1] = sums[knot] + self._stream.counts(first, first + self._step, region=self._region)
        return sums
