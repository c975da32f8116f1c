"""Adds traced paths to every focus position at once, on the processor's cores.

The point where a path meets the sensor moves along a straight line with the lens (x and y are linear in the position),
so a pixel holds the path for one run of consecutive positions. Each run needs two writes: the value where it begins,
and its negative where it ends. One running sum over positions at the end gives the complete stack. The cost thus grows
with the number of pixels that a path crosses, not with the number of positions.

The value and the count of a sample share one 64-bit word: the count is in the low COUNT_BITS, the value above them in
fixed point. Integer sums do not depend on the order of threads, so a stack is the same, bit for bit, for any number of
cores. Positions are the innermost axis, so that the pixels of a blur disc occupy few cache lines.
"""

import math
from typing import Any, NamedTuple

import numba as nb
import numpy as np

COUNT_BITS = 20
VALUE_BITS = 63 - COUNT_BITS
ACCUMULATOR_BYTES = 1 << 30
NEVER = np.float32(1e9)  # more positions than any travel has
NO_STEP = np.finfo(np.float32).smallest_normal  # 1/step may be infinite below; on a border, 0·inf = nan would never end


class TracedPaths(NamedTuple):
    """Traced paths, as arrays of Dr.Jit or numpy.

    Attributes
    ----------
    first_x, first_y : float32, shape (path,)
        Point where each path meets the sensor at position 0, in pixels.
    step_x, step_y : float32, shape (path,)
        Step of this point from one position to the next, in pixels.
    radiance : float32, shape (path,)
        Radiance that each path brings.
    begin, end : int32, shape (path,), or None
        Each path counts at positions begin <= k < end; None for all positions.
    weight : uint32, shape (path,), or None
        Number of samples that each path counts for, which may be 0; None for one each.
    """

    first_x: Any
    first_y: Any
    step_x: Any
    step_y: Any
    radiance: Any
    begin: Any = None
    end: Any = None
    weight: Any = None

    def to_host(self) -> "TracedPaths":
        """Return the paths with Dr.Jit arrays as numpy arrays, without a copy if the device is the host (LLVM)."""
        return TracedPaths(*(array if array is None else array.numpy() for array in self))

    def window_and_weight(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``begin``, ``end`` and ``weight`` as numpy arrays, empty if they are None.

        Numba kernels then get the same types for all paths, and are compiled only once, which takes seconds.
        """
        optional = ((self.begin, np.int32), (self.end, np.int32), (self.weight, np.uint32))
        begin, end, weight = (np.empty(0, kind) if array is None else array for array, kind in optional)
        return begin, end, weight


class HostAccumulator:
    """Sums of all rows of a stack, to which all cores add.

    Parameters
    ----------
    shape : tuple of int
        (focus, row, col) of the stack.
    band : tuple of int
        First row, and the row after the last; here always all rows.
    scale, max_radiance : float
        See :func:`splat_paths`.
    stacks : int, default 1
        Number of stacks that share the memory for sums.
    """

    def __init__(
        self, shape: tuple[int, int, int], band: tuple[int, int], *, scale: float, max_radiance: float, stacks: int = 1
    ) -> None:
        self.sums = allocate_sums(nb.get_num_threads(), shape, stacks=stacks)
        self.scale, self.max_radiance = scale, max_radiance

    @staticmethod
    def split_into_bands(shape: tuple[int, int, int]) -> list[tuple[int, int]]:
        """Return one band of all rows; if memory is short, there are fewer accumulators instead."""
        return [(0, shape[1])]

    def add(self, paths: TracedPaths) -> int:
        """Add paths (Dr.Jit arrays), and return the number of clipped samples."""
        return splat_paths(self.sums, paths.to_host(), scale=self.scale, max_radiance=self.max_radiance)

    def mean_radiance(self) -> np.ndarray:
        """Return the mean radiance, float32 (focus, row, col)."""
        return mean_radiance_of(self.sums, self.scale)


def allocate_sums(workers: int, shape: tuple[int, int, int], *, stacks: int = 1) -> np.ndarray:
    """Return empty accumulators, one per worker: int64 (worker, row, col, focus).

    There are fewer accumulators, but at least one, if those of ``stacks`` stacks would take more than
    ACCUMULATOR_BYTES.
    """
    focus, rows, columns = shape
    workers = max(1, min(workers, ACCUMULATOR_BYTES // (8 * stacks * focus * rows * columns)))
    return np.zeros((workers, rows, columns, focus), dtype=np.int64)


@nb.njit(nogil=True, cache=True)
def _axis(first, step):
    """Return a path's cell and direction along one axis, and the positions to its first border and between borders."""
    cell = np.int32(math.floor(first))
    if step > NO_STEP:
        pace = np.float32(1) / step
        return cell, np.int32(1), (np.float32(cell + 1) - first) * pace, pace
    if step < -NO_STEP:
        pace = np.float32(-1) / step
        return cell, np.int32(-1), (first - np.float32(cell)) * pace, pace
    return cell, np.int32(0), NEVER, NEVER


@nb.njit(nogil=True, cache=True)
def _splat_some(sums, a, b, first_x, first_y, step_x, step_y, value, scale, max_radiance, begin, end, weight):
    rows, columns, focus = sums.shape
    clipped = 0
    for i in range(a, b):
        times = np.int64(weight[i]) if weight.size else np.int64(1)
        if times == 0:
            continue
        radiance = value[i]
        if radiance > max_radiance:
            radiance = max_radiance
            clipped += 1
        word = ((np.int64(radiance * scale + 0.5) << COUNT_BITS) + 1) * times
        k, stop = 0, focus
        x, y = first_x[i], first_y[i]
        if begin.size:
            k, stop = begin[i], min(end[i], focus)
            x += np.float32(k) * step_x[i]
            y += np.float32(k) * step_y[i]
        # From border to border (Amanatides and Woo 1987): one addition per border, and no division.
        column, right, to_x, pace_x = _axis(x, step_x[i])
        row, down, to_y, pace_y = _axis(y, step_y[i])
        if begin.size:
            to_x += np.float32(k)
            to_y += np.float32(k)
        while k < stop:
            border = min(to_x, to_y)
            run_end = stop if border >= stop else int(border) + 1
            if run_end > k:
                if 0 <= row < rows and 0 <= column < columns:
                    sums[row, column, k] += word
                    if run_end < focus:
                        sums[row, column, run_end] -= word
                k = run_end
            if to_x < to_y:
                column += right
                to_x += pace_x
            else:
                row += down
                to_y += pace_y
    return clipped


@nb.njit(parallel=True, cache=True)
def _splat_paths(sums, first_x, first_y, step_x, step_y, value, scale, max_radiance, begin, end, weight):
    workers = sums.shape[0]
    clipped = np.zeros(workers, dtype=np.int64)
    for worker in nb.prange(workers):
        a = value.size * worker // workers
        b = value.size * (worker + 1) // workers
        clipped[worker] = _splat_some(
            sums[worker], a, b, first_x, first_y, step_x, step_y, value, scale, max_radiance, begin, end, weight
        )
    return clipped.sum()


def splat_paths(sums: np.ndarray, paths: TracedPaths, *, scale: float, max_radiance: float) -> int:
    """Add paths to the accumulators, and return the number of clipped samples.

    Parameters
    ----------
    sums : ndarray of int64, shape (worker, row, col, focus)
        Accumulators, changed in place.
    paths : TracedPaths
        Paths, as numpy arrays.
    scale : float
        Fixed-point units per unit of radiance.
    max_radiance : float
        Radiance at which a sample is clipped.
    """
    line = (paths.first_x, paths.first_y, paths.step_x, paths.step_y)
    return int(_splat_paths(sums, *line, paths.radiance, scale, max_radiance, *paths.window_and_weight()))


@nb.njit(parallel=True, cache=True)
def mean_radiance_of(sums, scale):
    """Return the mean radiance of the accumulators, float32 (focus, row, col).

    The sum of a pixel is divided by the number of samples that fell into it, not by the number that was sent to it, so
    that the scatter of this number cancels. A pixel without samples, which may occur with few samples per pixel,
    repeats the value at the previous position.
    """
    workers, rows, columns, focus = sums.shape
    out = np.empty((focus, rows, columns), dtype=np.float32)
    mask = (np.int64(1) << COUNT_BITS) - 1
    for row in nb.prange(rows):
        for column in range(columns):
            total = np.int64(0)
            last = 0.0
            for k in range(focus):
                for worker in range(workers):
                    total += sums[worker, row, column, k]
                count = total & mask
                if count > 0:
                    last = (total >> COUNT_BITS) / (scale * count)
                out[k, row, column] = last
    return out
