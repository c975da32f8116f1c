"""Spike counts of any window of a recording, cheaply.

A search asks for hundreds of windows, often half the recording long, and several methods ask for the same
ones: long windows are summed from knots, and those already counted are kept.
"""

from collections import OrderedDict

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.region import Region, checked_region, checked_window, extent
from saf_gen.stream import SpikeStream

__all__ = ["Counts"]

KNOTS = 256
KNOT_BYTES = 128 << 20
WINDOW_BYTES = 256 << 20


class Counts:
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
        self._stream, self._region = stream, checked_region(region, (height, width))
        self.shape = extent(self._region)
        self.readout_hz, self.lens = stream.readout_hz, stream.focus_position
        image_bytes = 4 * self.shape[0] * self.shape[1]
        between = max(min(KNOTS, KNOT_BYTES // image_bytes) - 1, 1)
        self._step = 8 * -(-self.frames // (8 * between))
        self._sums: np.ndarray | None = None
        self._windows: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        self._windows_kept = max(WINDOW_BYTES // image_bytes, 1)

    def window(self, first: int, stop: int) -> np.ndarray:
        """Counts in frames ``first <= t < stop`` (0-based): uint32 (h, w), read-only.

        Raises BadInput unless the window holds at least one frame and lies in the recording.
        """
        window = checked_window(first, stop, self.frames)
        key = window.start, window.stop
        if key in self._windows:
            self._windows.move_to_end(key)
            return self._windows[key]
        counts = self._count(*key)
        counts.flags.writeable = False  # the next method gets the same array
        self._windows[key] = counts
        if len(self._windows) > self._windows_kept:
            self._windows.popitem(last=False)
        return counts

    def halves(self, first: int, stop: int) -> np.ndarray:
        """Counts in both halves of a window of n frames, n // 2 and the rest: uint32 (2, h, w).

        Raises BadInput as ``window`` does, and for a single frame.
        """
        window = checked_window(first, stop, self.frames)
        if len(window) < 2:
            raise BadInput(
                f"the window of frame {window.start} alone has no halves",
                allowed="windows of 2 frames or more for a measure that compares halves",
            )
        middle = window.start + len(window) // 2
        return np.stack([self.window(window.start, middle), self.window(middle, window.stop)])

    def _count(self, first: int, stop: int) -> np.ndarray:
        after, before = -(-first // self._step), stop // self._step  # the knots just inside the window
        if before - after < 2:
            return self._stream.counts(first, stop, self._region)
        if self._sums is None:
            self._sums = self._running_sums()
        counts = self._sums[before] - self._sums[after]
        for a, b in ((first, after * self._step), (before * self._step, stop)):
            if a < b:
                counts += self._stream.counts(a, b, self._region)
        return counts

    def _running_sums(self) -> np.ndarray:
        """Spikes before each whole multiple of the step: uint32 (knots, h, w)."""
        whole = self.frames // self._step
        sums = np.zeros((whole + 1, *self.shape), dtype=np.uint32)
        for knot in range(whole):
            first = self._step * knot
            sums[knot + 1] = sums[knot] + self._stream.counts(first, first + self._step, self._region)
        return sums
