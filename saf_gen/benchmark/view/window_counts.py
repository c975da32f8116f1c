"""Spike counts of any window of a recording, cheaply.

A search looks at hundreds of windows, often half the recording long, and several methods look at the same
ones. So long windows are summed from running sums at knots, and windows already counted are kept.
"""

from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.stream.interval_texture import time_texture_of_stream_window
from saf_gen.stream.stream_file import SpikeStream

KNOTS = 256
"""Frames at which running sums are kept, at most; fewer where they would exceed KNOT_BYTES."""
KNOT_BYTES = 128 << 20
WINDOW_BYTES = 256 << 20
"""Memory for windows that are kept after they were counted."""


class WindowCounts:
    """Spike counts of any window of a stream, in a region of it (by default the whole frame).

    It needs 128 MiB for running sums and 256 MiB for windows already counted, beside what the stream keeps. It serves
    one thread at a time, and the stream must stay open meanwhile. Raises BadInput for a region that is empty or leaves
    the frame.
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
        self._kept_bytes = 0
        self._texture_seconds: dict[tuple[int, int], float] = {}  # of each texture that is kept
        self.textures_s = 0.0

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts in frames ``first <= t < stop`` (0-based): uint32 (h, w), read-only.

        Raises BadInput unless the window holds at least one frame and lies in the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._compute_once("counts", self._count, window=window)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the texture from intervals of a window of n frames: float64 (h, w), 0...n, read-only.

        See texture_of_stream_window. Raises BadInput as ``window`` does.
        """
        window = validate_window(first, stop, total=self.frames)
        image = self._compute_once("intervals", self._compute_texture, window=window)
        self.textures_s += self._texture_seconds[window.start, window.stop]
        return image

    def _compute_once(self, kind: str, compute: Callable[[int, int], np.ndarray], *, window: range) -> np.ndarray:
        """Return what is kept of a window, or compute and keep it; the oldest go beyond WINDOW_BYTES."""
        key = kind, window.start, window.stop
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        image = compute(window.start, window.stop)
        image.flags.writeable = False  # the next method gets the same array
        self._kept[key] = image
        self._kept_bytes += image.nbytes
        while self._kept_bytes > WINDOW_BYTES and len(self._kept) > 1:
            (dropped_kind, *dropped), dropped_image = self._kept.popitem(last=False)
            self._kept_bytes -= dropped_image.nbytes
            if dropped_kind == "intervals":
                del self._texture_seconds[dropped[0], dropped[1]]
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

    def _compute_texture(self, first: int, stop: int) -> np.ndarray:
        def read(first_byte: int, stop_byte: int) -> np.ndarray:
            return self._stream.packed(first_byte, stop_byte, region=self._region)

        image, self._texture_seconds[first, stop] = time_texture_of_stream_window(
            read, self._count, first=first, stop=stop
        )
        return image

    def _running_sums(self) -> np.ndarray:
        """Return the spikes before each whole multiple of the step: uint32 (knots, h, w)."""
        whole = self.frames // self._step
        sums = np.zeros((whole + 1, *self.shape), dtype=np.uint32)
        for knot in range(whole):
            first = self._step * knot
            sums[knot + 1] = sums[knot] + self._stream.counts(first, first + self._step, region=self._region)
        return sums
