"""Adds traced paths to every focus position at once, on the device that traced them.

The Dr.Jit kernels use the algorithm and the 64-bit words of :mod:`saf_gen.render.host_splat`. The sums are integers, so
the same paths give the same stack, bit for bit, in whatever order threads add them.

This requires care with rounding. CUDA may fuse a product with the addition that follows it into one operation that
rounds once (PTX, ``mul`` and ``add``), and Dr.Jit divides float32 only approximately on CUDA. A product to which
something is added is therefore computed in float64, where the product of two float32 numbers is exact, and the cast to
float32 rounds it. A reciprocal is computed in the same way; rounding it twice gives the same as rounding it once
(Figueroa 1995, doi:10.1145/221332.221334). Nothing is added to a product of float64.
"""

import math
from itertools import pairwise
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.host_splat import COUNT_BITS, NEVER, NO_STEP, TracedPaths

ACCUMULATOR_BYTES = 1 << 31  # the stack needs half as much again


class DeviceAccumulator:
    """Sums of a band of rows of a stack, on the device: int64 (row, col, focus).

    Parameters
    ----------
    shape : tuple of int
        (focus, row, col) of the stack.
    band : tuple of int
        First row, and the row after the last.
    scale : float
        Fixed-point units per unit of radiance.
    max_radiance : float
        Radiance at which a sample is clipped.
    """

    def __init__(
        self, shape: tuple[int, int, int], band: tuple[int, int], *, scale: float, max_radiance: float
    ) -> None:
        self.focus, _, self.columns = shape
        self.top, self.rows = band[0], band[1] - band[0]
        self.scale, self.max_radiance = scale, max_radiance
        self.sums = dr.zeros(mi.Int64, self.focus * self.rows * self.columns)

    @staticmethod
    def split_into_bands(shape: tuple[int, int, int]) -> list[tuple[int, int]]:
        """Return the fewest bands of rows whose sums take at most ACCUMULATOR_BYTES each."""
        focus, rows, columns = shape
        bands = math.ceil(rows / max(1, ACCUMULATOR_BYTES // (8 * focus * columns)))
        edges = [rows * n // bands for n in range(bands + 1)]
        return list(pairwise(edges))

    def add(self, paths: TracedPaths) -> Any:
        """Add paths (Dr.Jit arrays), and return the number of clipped samples, inside and outside the band.

        The number is a UInt32 of one entry, which stays on the device: reading it would wait for the paths.
        """
        max_radiance = dr.opaque(mi.Float64, self.max_radiance)
        radiance = mi.Float64(paths.radiance)
        bright = radiance > max_radiance
        if paths.weight is not None:
            bright &= paths.weight > 0
        word = fixed_point(dr.select(bright, max_radiance, radiance), self.scale)
        if paths.weight is not None:
            word *= mi.Int64(paths.weight)
        # Opaque values, unlike constants of the kernel, can change without a new kernel.
        focus, rows, columns, top = (dr.opaque(mi.Int32, n) for n in (self.focus, self.rows, self.columns, self.top))
        begin, stop = mi.Int32(0), focus
        if paths.begin is not None:
            begin, stop = mi.Int32(paths.begin), dr.minimum(paths.end, focus)
        if paths.weight is not None:
            stop = dr.select(paths.weight > 0, stop, begin)
        x = paths.first_x + product(begin, paths.step_x)
        y = paths.first_y + product(begin, paths.step_y)
        column, right, to_x, pace_x = _axis(x, paths.step_x)
        row, down, to_y, pace_y = _axis(y, paths.step_y)
        start = mi.Float(begin)
        _walk(
            self.sums,
            (focus, rows, columns),
            (begin, stop, word),
            (column, right, to_x + start, pace_x),
            (row - top, down, to_y + start, pace_y),
        )
        clipped: Any = dr.count(bright)
        dr.eval(self.sums, clipped)
        return clipped

    def mean_radiance(self) -> np.ndarray:
        """Return the band's mean radiance, float32 (focus, row, col); see ``host_splat.mean_radiance_of``."""
        shape = (self.focus, self.rows, self.columns)
        means = dr.empty(mi.Float, self.focus * self.rows * self.columns)
        _resolve(self.sums, means, self.focus, self.rows * self.columns, dr.opaque(mi.Float64, self.scale))
        return means.numpy().reshape(shape)


class DeviceBands:
    """Sums of all rows of a stack on the device, in as many accumulators as its size needs.

    Unlike the bands of :func:`saf_gen.render.one_pass.render_stack`, all are filled at once, by the same paths. A stack
    for which the device has too little memory ends with the error of Dr.Jit, and not on the host in silence.
    """

    def __init__(self, shape: tuple[int, int, int], *, scale: float, max_radiance: float) -> None:
        bands = DeviceAccumulator.split_into_bands(shape)
        self._bands = [DeviceAccumulator(shape, band, scale=scale, max_radiance=max_radiance) for band in bands]

    def add(self, paths: TracedPaths) -> Any:
        """Add paths; see :meth:`DeviceAccumulator.add`."""
        counts = [sums.add(paths) for sums in self._bands]
        return counts[0]  # each band saw the same paths

    def mean_radiance(self) -> np.ndarray:
        """Return the mean radiance, float32 (focus, row, col)."""
        return np.concatenate([sums.mean_radiance() for sums in self._bands], axis=1)


def fixed_point(radiance: Any, scale: float) -> Any:
    """Return the words of samples of this radiance (Float64), Int64: the value in fixed point, and a count of one.

    The value is rounded half up without an addition to the product: all later operations are on integers.
    """
    twice = mi.Int64(radiance * dr.opaque(mi.Float64, 2 * scale))
    return (((twice + 1) >> 1) << COUNT_BITS) + 1


def product(a: Any, b: Any) -> Any:
    """Return a·b rounded to float32, so that no later operation can be fused with the product."""
    return mi.Float(mi.Float64(a) * mi.Float64(b))


def _axis(first: Any, step: Any) -> tuple[Any, Any, Any, Any]:
    """Return a path's cell and direction along one axis, and the positions to its first border and between borders."""
    cell = mi.Int32(dr.floor(first))
    forth, back = step > float(NO_STEP), step < -float(NO_STEP)
    pace = mi.Float(1 / dr.abs(mi.Float64(step)))
    distance = dr.select(forth, mi.Float(cell + 1) - first, first - mi.Float(cell))
    moves, never = forth | back, mi.Float(NEVER)
    towards = dr.select(forth, mi.Int32(1), dr.select(back, mi.Int32(-1), mi.Int32(0)))
    return cell, towards, dr.select(moves, product(distance, pace), never), dr.select(moves, pace, never)


@dr.syntax
def _walk(sums: Any, shape: Any, path: Any, across: Any, along: Any) -> None:
    """Walk each path from border to border, with two writes per run of positions; see ``host_splat.splat_paths``."""
    focus, rows, columns = shape
    k, stop, word = path
    column, right, to_x, pace_x = across
    row, down, to_y, pace_y = along
    while k < stop:
        border = dr.minimum(to_x, to_y)  # never nan: see NO_STEP
        run_end = dr.select(border >= mi.Float(stop), stop, mi.Int32(border) + 1)
        runs = run_end > k
        inside = runs & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        pixel = (row * columns + column) * focus
        dr.scatter_add(sums, word, mi.UInt32(pixel + k), inside, dr.ReduceMode.Direct)
        dr.scatter_add(sums, -word, mi.UInt32(pixel + run_end), inside & (run_end < focus), dr.ReduceMode.Direct)
        k = dr.select(runs, run_end, k)
        first = to_x < to_y
        column = dr.select(first, column + right, column)
        row = dr.select(first, row, row + down)
        to_x, to_y = dr.select(first, to_x + pace_x, to_x), dr.select(first, to_y, to_y + pace_y)


@dr.syntax
def _resolve(sums: Any, means: Any, focus: int, pixels: int, scale: Any) -> None:
    """Sum over positions, one thread per pixel; a pixel without samples repeats the value at the previous position."""
    pixel = dr.arange(mi.UInt32, pixels)
    positions, stride = dr.opaque(mi.UInt32, focus), dr.opaque(mi.UInt32, pixels)
    k, total, last = mi.UInt32(0), mi.Int64(0), mi.Float(0)
    while k < positions:
        total += dr.gather(mi.Int64, sums, pixel * positions + k)
        count = total & ((1 << COUNT_BITS) - 1)
        mean = mi.Float(mi.Float64(total >> COUNT_BITS) / (scale * mi.Float64(count)))
        last = dr.select(count > 0, mean, last)
        dr.scatter(means, last, k * stride + pixel)
        k += 1
