"""Looks up shared shading on the device that traced the rays, with the arithmetic of the kernels for cores.

:mod:`saf_gen.render.shading_kernels` holds the same look-up for the processor's cores; both give the same bits. As in
:mod:`saf_gen.render.device_splat`, nothing is added to a product of float32, so that no compiler may fuse the two.
"""

from typing import Any

import drjit as dr
import mitsuba as mi

from saf_gen.render.device_splat import product
from saf_gen.render.shading_cells import ShadingField, SurfaceHits
from saf_gen.render.shading_kernels import LEVELS, NORMAL_BINS, OUTSIDE

# Where a key holds its parts; see shading_kernels.
_ROW, _SHAPE, _NORMAL, _DEPTH, _LEVEL = 14, 28, 40, 46, 59
_COORDINATE, _DEPTHS, _KEPT = (1 << 14) - 1, (1 << 13) - 1, ((1 << 12) - 1) << _SHAPE | ((1 << 6) - 1) << _NORMAL
_USED = 1 << 63
_TILE_BITS = 14 - (LEVELS - 1)


class DeviceField:
    """A shading field in the device's memory."""

    def __init__(self, field: ShadingField) -> None:
        self.groups = field.shading.shape[1]
        self._has_cells = field.keys.size > 0  # a scene that shares nothing has none
        self._tables: Any = mi.Int32(field.tables)
        self._slots: Any = mi.Int32(field.slots)
        self._keys: Any = mi.UInt64(field.keys)
        self._shading: Any = mi.Float(field.shading.ravel())

    def reflect(self, hits: SurfaceHits, *, first: int, seed: int) -> list[Any]:
        """Return the radiance that surfaces reflect to rays, a Float (ray,) for each light group.

        ``hits`` are Dr.Jit arrays; for the other parameters see :meth:`ShadingField.reflect`, which gives the same.
        """
        if not self._has_cells:
            return [dr.zeros(mi.Float, dr.width(hits.shape)) for _ in range(self.groups)]
        met = hits.shape > 0
        number = mi.UInt64(dr.arange(mi.UInt32, dr.width(hits.shape))) + dr.opaque(mi.UInt64, first)
        word = _mix(_mix(number) ^ dr.opaque(mi.UInt64, seed & 0xFFFFFFFF))
        x, y, z = (mi.Float((word >> shift) & 0xFFFFF) * 2.0**-20 - 0.5 for shift in (0, 20, 40))
        there = (mi.Float64(hits.column) + 0.5 * mi.Float64(x), mi.Float64(hits.row) + 0.5 * mi.Float64(y))
        cell = self._find(_cell_key(hits, (*there, hits.depth + z)), met, coarsest=0)
        here = (mi.Float64(hits.column), mi.Float64(hits.row))
        around = self._find(_cell_key(hits, (*here, hits.depth)), met & (cell < 0), coarsest=LEVELS - 1)
        cell = dr.select(cell < 0, around, cell)
        known = met & (cell >= 0)
        at = mi.UInt32(dr.maximum(cell, 0)) * self.groups
        values = []
        for g in range(self.groups):
            matt = dr.gather(mi.Float, self._shading, 2 * (at + g), known)
            gloss = dr.gather(mi.Float, self._shading, 2 * (at + g) + 1, known)
            values.append(dr.select(known, product(hits.reflectance, matt) + gloss, 0))
        dr.eval(*values)
        return values

    def _find(self, key: Any, active: Any, *, coarsest: int) -> Any:
        """Return the index of each cell, Int32 (ray,), or of the smallest known one around it; -1 if none is known.

        Cells above level ``coarsest`` do not count.
        """
        column, row = key & _COORDINATE, (key >> _ROW) & _COORDINATE
        tile = mi.UInt32(((row >> (LEVELS - 1)) << _TILE_BITS) | (column >> (LEVELS - 1)))
        start = dr.gather(mi.Int32, self._tables, tile, active)
        size = dr.gather(mi.Int32, self._tables, tile + 1, active) - start
        return _probe(self._slots, self._keys, key, (start, size), active & (size > 0), dr.opaque(mi.UInt64, coarsest))


@dr.syntax
def _probe(slots: Any, keys: Any, key: Any, table: Any, searching: Any, coarsest: Any) -> Any:
    start, size = table
    mask = mi.UInt64(dr.maximum(size, 1) - 1)
    offset = _mix(key) & mask
    found = mi.Int32(-1)
    while searching:
        cell = dr.gather(mi.Int32, slots, mi.UInt32(start) + mi.UInt32(offset), searching)
        is_empty = cell < 0
        is_found = ~is_empty & (dr.gather(mi.UInt64, keys, mi.UInt32(dr.maximum(cell, 0)), searching) == key)
        found = dr.select(searching & is_found, cell, found)
        goes_up = is_empty & (((key >> _LEVEL) & 7) < coarsest)
        key = dr.select(goes_up, _parent(key), key)
        offset = dr.select(goes_up, _mix(key), offset + 1) & mask
        searching &= ~is_found & (~is_empty | goes_up)
    return found


def _mix(word: Any) -> Any:
    word = (word ^ (word >> 30)) * mi.UInt64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> 27)) * mi.UInt64(0x94D049BB133111EB)
    return word ^ (word >> 31)


def _cell_key(hits: SurfaceHits, place: tuple[Any, Any, Any]) -> Any:
    """Return the keys of the smallest cells, of half a pixel, at a column, row and depth."""
    column, row, depth = place
    c, r = (mi.UInt64(dr.clip(mi.Int32(dr.floor(2 * at)) + OUTSIDE, 0, _COORDINATE)) for at in (column, row))
    u, v = (dr.minimum(mi.Int32(part * NORMAL_BINS), NORMAL_BINS - 1) for part in (hits.normal_u, hits.normal_v))
    d = mi.UInt64(mi.Int32(dr.floor(depth)) + (1 << 20)) & _DEPTHS
    shape = mi.UInt64(hits.shape & ((1 << 12) - 1))
    normal = mi.UInt64(u * NORMAL_BINS + v)
    return mi.UInt64(_USED) | c | (r << _ROW) | (shape << _SHAPE) | (normal << _NORMAL) | (d << _DEPTH)


def _parent(key: Any) -> Any:
    """Return the keys of the next larger cells."""
    c, r, d = (key & _COORDINATE) >> 1, ((key >> _ROW) & _COORDINATE) >> 1, ((key >> _DEPTH) & _DEPTHS) >> 1
    level = ((key >> _LEVEL) & 7) + 1
    return mi.UInt64(_USED) | c | (r << _ROW) | (key & _KEPT) | (d << _DEPTH) | (level << _LEVEL)
