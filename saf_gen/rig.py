"""What a search sees of a recording: its length, and the score of any window. The rest is the referee's.

A search asks for hundreds of windows, often half the recording long, and several methods ask for the same
ones. :class:`Counts` turns a stream once, from pixel-major bytes into planes of 64 frames, so that a window
reads memory in order, and sums long windows from knots. :class:`Recording` is the view that one method gets;
it keeps the bill.
"""

from collections import OrderedDict
from collections.abc import Callable
from numbers import Integral
from time import perf_counter
from typing import Protocol

import numpy as np
from numba import njit

from saf_gen.errors import BadInput
from saf_gen.region import Region, target_box

__all__ = ["Counts", "PackedStream", "Recording", "Region", "target_box"]

KEPT_BYTES = 1 << 30
"""Spikes up to this size are kept in memory; of larger recordings the needed bytes are read each time."""
KNOTS = 256
KNOT_BYTES = 128 << 20
WINDOW_BYTES = 256 << 20
SLAB_BYTES = 256 << 20
PAIRS, NIBBLES = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333)
BYTES, ONES = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x0101010101010101)
WORD = 64
"""Frames in a word of a plane: bit t mod 64 of word t div 64 is frame t."""


class PackedStream(Protocol):
    """What the rig needs of a stream; saf_gen.stream.SpikeStream is one."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(T, H, W)."""
        ...

    def packed(self, first_byte: int, stop_byte: int, region: Region | None = None) -> np.ndarray:
        """uint8 (h, w, stop_byte - first_byte): frame t is bit t mod 8, least significant first."""
        ...


class Counts:
    """Spike counts of any window of a stream, in a region of it.

    Memory: up to 1 GiB of spikes (twice that for a moment where one slab holds them all), 128 MiB of sums,
    256 MiB of windows already counted. One thread at a time; the stream stays open meanwhile.

    Parameters
    ----------
    stream : a SpikeStream.
    region : (slice of rows, slice of columns), steps of 1; None is the whole frame.

    Raises
    ------
    BadInput : for a region that holds no pixel of the stream.
    """

    def __init__(self, stream: PackedStream, region: Region | None = None) -> None:
        self.frames, height, width = stream.shape
        sides = zip(region or (slice(None), slice(None)), (height, width), strict=True)
        rows, cols = (_within(part, size) for part, size in sides)
        self.shape = (rows.stop - rows.start, cols.stop - cols.start)
        self._box = None if self.shape == (height, width) else (rows, cols)
        self._stream = stream
        self._words = -(-self.frames // WORD)
        pixels = self.shape[0] * self.shape[1]
        self._slab = max(SLAB_BYTES // (8 * pixels), 1)
        self._kept: np.ndarray | None = None
        if 8 * pixels * self._words <= KEPT_BYTES:
            self._kept = self._planes(0, self._words)
        knots = min(KNOTS, KNOT_BYTES // (4 * pixels))
        self._spacing = -(-self._words // max(knots - 1, 1))
        self._sums: np.ndarray | None = None
        self._windows: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        self._windows_kept = max(WINDOW_BYTES // (4 * pixels), 1)

    def window(self, first: int, stop: int) -> np.ndarray:
        """Counts in frames ``first <= t < stop`` (0-based): uint32 (h, w), read-only.

        Raises BadInput unless the window holds at least one frame and lies in the recording.
        """
        whole = isinstance(first, Integral) and isinstance(stop, Integral)
        if not (whole and 0 <= first < stop <= self.frames):
            raise BadInput(
                f"window of frames {first} to {stop}",
                allowed=f"whole numbers, 0 <= first < stop <= {self.frames}",
            )
        key = (int(first), int(stop))
        if key in self._windows:
            self._windows.move_to_end(key)
            return self._windows[key]
        counts = self._count(*key)
        counts.flags.writeable = False  # the next method gets the same array
        self._windows[key] = counts
        if len(self._windows) > self._windows_kept:
            self._windows.popitem(last=False)
        return counts

    def _count(self, first: int, stop: int) -> np.ndarray:
        counts = np.zeros(self.shape, dtype=np.uint32)
        step = WORD * self._spacing
        after, before = -(-first // step), stop // step  # the knots just inside the window
        if before - after < 2:
            self._add(first, stop, counts)
            return counts
        if self._sums is None:
            self._sums = self._running_sums()
        self._add(first, after * step, counts)
        self._add(before * step, stop, counts)
        counts += self._sums[before] - self._sums[after]
        return counts

    def _add(self, first: int, stop: int, counts: np.ndarray) -> None:
        if first < stop:
            word = first // WORD
            planes = self._planes(word, -(-stop // WORD))
            _add_window(planes, first - WORD * word, stop - WORD * word, counts)

    def _planes(self, first: int, stop: int) -> np.ndarray:
        """Words ``first`` to ``stop``: uint64 (words, h, w); what follows the last frame is 0."""
        if self._kept is not None:
            return self._kept[first:stop]
        planes = np.empty((stop - first, *self.shape), dtype=np.uint64)
        for word in range(first, stop, self._slab):
            last = min(word + self._slab, stop)
            packed = self._stream.packed(8 * word, min(8 * last, -(-self.frames // 8)), self._box)
            _turn(packed, planes[word - first : last - first])
        return planes

    def _running_sums(self) -> np.ndarray:
        """Spikes before each whole multiple of the spacing: uint32 (knots, h, w)."""
        whole = self._words // self._spacing
        sums = np.zeros((whole + 1, *self.shape), dtype=np.uint32)
        for knot in range(whole):
            sums[knot + 1] = sums[knot]
            first = WORD * self._spacing * knot
            self._add(first, first + WORD * self._spacing, sums[knot + 1])
        return sums


class Recording:
    """The view of a recording that one method's search gets: see saf_gen.parts.View.

    ``frames_seen`` is the end of the latest window asked for, ``windows`` the number of scores asked for,
    ``seconds`` the time the measure took. Counting is not in it: how a stream is stored is no merit of a
    method, and windows already counted are shared.
    """

    def __init__(self, counts: Counts, measure: Callable[[np.ndarray], float]) -> None:
        self._counts, self._measure = counts, measure
        self.frames_seen, self.windows, self.seconds = 0, 0, 0.0

    @property
    def frames(self) -> int:
        """Frames in the recording."""
        return self._counts.frames

    def score(self, first: int, stop: int) -> float:
        """The measure's score of frames ``first <= t < stop`` (0-based, at least one).

        Raises BadInput for a window outside the recording, and for a score that is no finite number.
        """
        counts = self._counts.window(first, stop)
        self.windows += 1
        self.frames_seen = max(self.frames_seen, int(stop))
        start = perf_counter()
        score = float(self._measure(counts))
        self.seconds += perf_counter() - start
        if not np.isfinite(score):
            raise BadInput(
                f"{type(self._measure).__name__} scores frames {first} to {stop} with {score}",
                allowed="a finite number for any counts",
                hint="a measure gives 0.0 where there is no spike",
            )
        return score


def _within(part: slice, size: int) -> slice:
    first, stop, step = part.indices(size)
    if step != 1 or stop <= first:
        raise BadInput(f"region {part} of {size} pixels", allowed="at least one pixel, steps of 1")
    return slice(first, stop)


@njit(nogil=True, cache=True)
def _turn(packed: np.ndarray, planes: np.ndarray) -> None:
    """Time-packed bytes (h, w, n) as words (ceil(n/8), h, w), least significant byte first.

    In blocks of pixels: whole lines are written, and the bytes of a block stay in the cache.
    """
    words, rows, cols = planes.shape
    whole = packed.shape[2] // 8
    for y in range(rows):
        for x0 in range(0, cols, 32):
            for k in range(words):
                for x in range(x0, min(x0 + 32, cols)):
                    word = np.uint64(0)
                    if k < whole:
                        for i in range(8):  # a constant count, which compiles to one load
                            word |= np.uint64(packed[y, x, 8 * k + i]) << np.uint64(8 * i)
                    else:
                        for i in range(packed.shape[2] - 8 * k):
                            word |= np.uint64(packed[y, x, 8 * k + i]) << np.uint64(8 * i)
                    planes[k, y, x] = word


@njit(nogil=True, cache=True)
def _add_window(planes: np.ndarray, first: int, stop: int, counts: np.ndarray) -> None:
    """Add the spikes of frames ``first`` to ``stop`` of ``planes`` (words, h, w) to ``counts`` (h, w)."""
    words, rows, cols = planes.shape
    ones = ~np.uint64(0)
    for y in range(rows):
        for k in range(words):
            mask = ones
            if k == 0:
                mask &= ones << np.uint64(first)
            if k == words - 1:
                mask &= ones >> np.uint64(64 * words - stop)
            for x in range(cols):
                # Ones in a word (Warren, Hacker's Delight, 5-1): compilers know the pattern.
                w = planes[k, y, x] & mask
                w = w - ((w >> np.uint64(1)) & PAIRS)
                w = (w & NIBBLES) + ((w >> np.uint64(2)) & NIBBLES)
                w = (w + (w >> np.uint64(4))) & BYTES
                counts[y, x] += np.uint32((w * ONES) >> np.uint64(56))
