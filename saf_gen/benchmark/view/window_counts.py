"""Fast spike counts of any window of a recording.

A search looks at hundreds of windows, which are often half as long as the recording, and several methods look at the
same windows. Long windows are therefore computed from running sums up to some frames (knots), and counted windows kept.
"""

from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from saf_gen.core.region import Region, region_shape, validate_region, validate_window
from saf_gen.stream.interval_texture import window_time_texture
from saf_gen.stream.stream_file import SpikeStream

KNOTS = 256
"""Maximum number of frames at which running sums are kept; there are fewer if they would exceed KNOT_BYTES."""
KNOT_BYTES = 128 << 20
"""Memory for running sums, in bytes."""
WINDOW_BYTES = 256 << 20
"""Memory for windows that are kept after they were counted, in bytes."""


class WindowCounts:
    """Spike counts of any window of a stream, in a region or in the whole frame.

    It needs up to 128 MiB for running sums and 256 MiB for windows already counted, in addition to the memory of the
    stream. It must be used by one thread at a time, and the stream must stay open.

    Parameters
    ----------
    stream : SpikeStream
        Open stream.
    region : Region, optional
        Rows and columns; by default the whole frame.

    Raises
    ------
    BadInput
        If the region is empty or extends beyond the frame.
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
        self._cache: OrderedDict[tuple[str, int, int], np.ndarray] = OrderedDict()
        self._cache_bytes = 0
        self._texture_seconds: dict[tuple[int, int], float] = {}  # computing time of each texture that is kept
        self.textures_s = 0.0

    def window(self, first: int, stop: int) -> np.ndarray:
        """Return the counts of frames ``first <= t < stop``, counted from 0: uint32 (h, w), read-only.

        Raises BadInput if the window is empty or extends beyond the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        return self._compute_once("counts", self._count, window=window)

    def intervals(self, first: int, stop: int) -> np.ndarray:
        """Return the interval texture of a window of n frames: float64 (h, w), 0...n, read-only.

        See window_texture. Raises BadInput if the window is empty or extends beyond the recording.
        """
        window = validate_window(first, stop, total=self.frames)
        image = self._compute_once("intervals", self._compute_texture, window=window)
        self.textures_s += self._texture_seconds[window.start, window.stop]
        return image

    def _compute_once(self, kind: str, compute: Callable[[int, int], np.ndarray], *, window: range) -> np.ndarray:
        """Return the kept image of a window, or compute and keep it; beyond WINDOW_BYTES, drop the longest unused."""
        key = kind, window.start, window.stop
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        image = compute(window.start, window.stop)
        image.flags.writeable = False  # the next method gets the same array
        self._cache[key] = image
        self._cache_bytes += image.nbytes
        while self._cache_bytes > WINDOW_BYTES and len(self._cache) > 1:
            (dropped_kind, *dropped), dropped_image = self._cache.popitem(last=False)
            self._cache_bytes -= dropped_image.nbytes
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

        image, self._texture_seconds[first, stop] = window_time_texture(read, self._count, first=first, stop=stop)
        return image

    def _running_sums(self) -> np.ndarray:
        """Return the number of spikes per pixel before each multiple of the step: uint32 (knots, h, w)."""
        full_steps = self.frames // self._step
        sums = np.zeros((full_steps + 1, *self.shape), dtype=np.uint32)
        for knot in range(full_steps):
            first = self._step * knot
            sums[knot + 1] = sums[knot] + self._stream.counts(first, first + self._step, region=self._region)
        return sums
