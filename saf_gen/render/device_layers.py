"""Adds traced paths to the layers of a few focus positions, on the device that traced them.

The sums are those of :class:`saf_gen.render.layered_splat.LayeredSums`, bit for bit, and its images are made of them.
For the rounding of products, quotients and roots see :mod:`saf_gen.render.device_splat`; the root of a float64, rounded
to float32, is that of a float32.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.render.device_splat import fixed_point, product
from saf_gen.render.host_splat import TracedPaths
from saf_gen.render.layered_splat import BLURS, GAUSSIANS, LAYERS, SIDE_LAYERS, LayeredSums
from saf_gen.render.surface_hits import Distances


class DeviceLayeredSums(LayeredSums):
    """Sums of paths in layers, in the device's memory."""

    def _allocate(self, shape: tuple[int, int, int], groups: int) -> None:
        focus, rows, columns = self._shape = shape
        pixels = focus * rows * columns
        self._device = (
            dr.zeros(mi.Int64, pixels * LAYERS * groups),
            dr.zeros(mi.Int32, pixels * LAYERS),
            dr.zeros(mi.Int64, pixels * groups),
        )

    def add(self, line: TracedPaths, radiance: Any, *, lens: tuple[Any, Any], distances: Distances) -> None:
        """Add traced paths to the layers of all positions; the arrays are Dr.Jit's."""
        words = []
        for value, scale, limit in zip(radiance, self._scale, self._max_radiance, strict=True):
            bright = dr.minimum(mi.Float64(value), dr.opaque(mi.Float64, limit))
            words.append(fixed_point(bright, scale))
        times = mi.UInt32(1) if line.weight is None else mi.UInt32(line.weight)
        focus, rows, columns = self._shape
        begin, stop = mi.Int32(0), dr.opaque(mi.Int32, focus)
        if line.begin is not None:
            begin, stop = mi.Int32(line.begin), dr.minimum(line.end, stop)
        stop = dr.select(times > 0, stop, begin)
        has_clear = distances.farthest is not None
        sheets = (distances.nearest, distances.farthest) if has_clear else (mi.Float(0), mi.Float(0))
        paths = (
            self._device,
            tuple(dr.opaque(mi.Int32, n) for n in (rows, columns)),
            (line.first_x, line.first_y, line.step_x, line.step_y),
            ([word * mi.Int64(times) for word in words], mi.Int32(times)),
            (distances.end, *sheets, lens[0], lens[1]),
            tuple(mi.Float(array) for array in self._blur),
            (mi.Float64(BLURS), mi.Float((4 * GAUSSIANS).astype(np.float32))),
        )
        _walk(begin, stop, paths)
        dr.eval(*self._device)

    def mean_radiance(self) -> np.ndarray:
        """Return the mean radiance, float32 (light, focus, row, col); a pixel that no path met is 0."""
        focus, rows, columns = self._shape
        sums, landed, unmoved = (array.numpy() for array in self._device)
        self._sums = sums.reshape(1, focus, LAYERS, rows, columns, -1)
        self._landed = landed.reshape(1, focus, LAYERS, rows, columns)
        self._unmoved = unmoved.reshape(1, focus, rows, columns, -1)
        return super().mean_radiance()


@dr.syntax
def _walk(k: Any, stop: Any, paths: Any) -> None:
    while k < stop:
        _add_at(k, paths)
        k += 1


def _add_at(k: Any, paths: Any) -> None:
    """Add each path at its position ``k``; see ``layered_splat._add_some``."""
    sums, size, line, light, ends, blurs, steps = paths
    layered, landed, unmoved = sums
    rows, columns = size
    first_x, first_y, step_x, step_y = line
    words, times = light
    end, nearest, farthest, lens_x, lens_y = ends
    at = mi.UInt32(k)
    diameter, inverse, shift = (dr.gather(mi.Float, array, at) for array in blurs)
    bounds, fourfold = steps
    x, y = first_x + product(k, step_x), first_y + product(k, step_y)
    near, far = _quotient(1, nearest - shift) - inverse, _quotient(1, farthest - shift) - inverse
    sheet = dr.select((near > 0) & (far < 0), 0, _smaller(near, far))
    blur = _quotient(1, end - shift) - inverse
    blur = product(dr.select(farthest > 0, _smaller(blur, sheet), blur), diameter)
    known = end > 0
    step = mi.Int32(0)
    for n in range(SIDE_LAYERS):
        step += dr.select(known & (mi.Float64(dr.abs(blur)) >= dr.gather(mi.Float64, bounds, n)), mi.Int32(1), 0)
    is_moved = step > 0
    layer = mi.UInt32(SIDE_LAYERS + dr.select(blur > 0, -step, step))

    def add(into: Any, values: Any, layer: Any, x: Any, y: Any, which: Any) -> None:
        column, row = mi.Int32(dr.floor(x)), mi.Int32(dr.floor(y))
        inside = which & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        pixel = mi.UInt32((mi.Int32(layer) * rows + row) * columns + column) * len(values)
        for n, value in enumerate(values):
            dr.scatter_add(into, value, pixel + n, inside, dr.ReduceMode.Direct)

    add(landed, [times], at * LAYERS + layer, x, y, known)
    add(unmoved, words, at, x, y, is_moved)
    ratio = _quotient(dr.gather(mi.Float, fourfold, mi.UInt32(step)), blur)
    r2 = product(lens_x, lens_x) + product(lens_y, lens_y)
    inward = product(product(0.5, blur), _inward(product(ratio, ratio), r2))
    x = dr.select(is_moved, x - product(inward, lens_x), x)
    y = dr.select(is_moved, y - product(inward, lens_y), y)
    add(layered, words, at * LAYERS + layer, x, y, mi.Bool(True))


def _inward(s2: Any, r2: Any) -> Any:
    """See ``layered_splat._inward``."""
    p, q = 1 + product(1.5, s2), product(3, s2)
    mean_square = product(p, p) - product(product(np.float32(4 / 3), p), q) + product(product(0.5, q), q)
    kept = mi.Float(dr.sqrt(mi.Float64(_quotient(1 - s2, mean_square))))
    return 1 - product(kept, p - product(q, r2))


def _quotient(a: Any, b: Any) -> Any:
    return mi.Float(mi.Float64(a) / mi.Float64(b))


def _smaller(one: Any, other: Any) -> Any:
    return dr.select(dr.abs(one) < dr.abs(other), one, other)
