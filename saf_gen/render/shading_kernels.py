"""The kernels of shared shading: keys of cells, tables to look them up, sums of paths, and the light that rays bring.

:mod:`saf_gen.render.shading_cells` explains the method. Arrays of cells are ``keys``, uint64 (cell,); ``surface``,
float64 (cell, 3): number of paths, Σρ and Σρ²; and ``light``, float64 (cell, light, 3): ΣL, ΣL² and ΣL·ρ.

A cell is in one tile, the square of the picture that the largest cells cover, and so are all larger cells around it.
Each tile has its own table, small enough for a processor's cache, and kernels process each tile separately. ``begin``,
int32 (TILES + 1,), holds the index at which the cells of each tile begin.
"""

import numba as nb
import numpy as np

FINEST = 0.5  # width of the smallest cells, in pixels
LEVELS = 6  # widths of cells: 1/2, 1, 2, 4, 8 and 16 pixels
NORMAL_BINS = 8  # along each side of the octahedral map of directions
OUTSIDE = 4096  # number of smallest cells that fit into keys above, and to the left of, the picture

U = np.uint64
# A key holds column, row (14 bits each), shape (12), normal (6), depth (13) and level (3); 0 is no key. Shapes whose
# numbers differ by 2,048 share cells if they agree in all else, and so do depths that differ by 8,192 cells.
_COLUMN, _ROW, _SHAPE, _NORMAL, _DEPTH, _LEVEL = (U(shift) for shift in (0, 14, 28, 40, 46, 59))
_USED = U(1 << 63)
_14, _13, _12, _6 = (U((1 << bits) - 1) for bits in (14, 13, 12, 6))
_TILE_BITS = 14 - (LEVELS - 1)
TILES = 1 << (2 * _TILE_BITS)


@nb.njit(inline="always")
def _mix(word):
    """Return a word, each bit of which depends on all bits of the argument (the finalizer of SplitMix64)."""
    word = (word ^ (word >> U(30))) * U(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> U(27))) * U(0x94D049BB133111EB)
    return word ^ (word >> U(31))


@nb.njit(inline="always")
def _cell_key(shape, column, row, depth, u, v):
    c = U(min(max(int(np.floor(column / FINEST)) + OUTSIDE, 0), (1 << 14) - 1))
    r = U(min(max(int(np.floor(row / FINEST)) + OUTSIDE, 0), (1 << 14) - 1))
    normal = U(min(int(u * NORMAL_BINS), NORMAL_BINS - 1) * NORMAL_BINS + min(int(v * NORMAL_BINS), NORMAL_BINS - 1))
    d = U(int(np.floor(depth)) + (1 << 20)) & _13
    return _USED | (c << _COLUMN) | (r << _ROW) | ((U(shape) & _12) << _SHAPE) | (normal << _NORMAL) | (d << _DEPTH)


@nb.njit(inline="always")
def is_glossy(key):
    """Return whether the shape of a cell is glossy: the last bit of the shape's number."""
    return (key >> _SHAPE) & U(1) == U(1)


@nb.njit(inline="always")
def parent_cell(key):
    """Return the key of the next larger cell around a cell."""
    c, r, d = (key >> _COLUMN) & _14, (key >> _ROW) & _14, (key >> _DEPTH) & _13
    level = ((key >> _LEVEL) & U(7)) + U(1)
    kept = key & ((_12 << _SHAPE) | (_6 << _NORMAL))
    return _USED | ((c >> U(1)) << _COLUMN) | ((r >> U(1)) << _ROW) | kept | ((d >> U(1)) << _DEPTH) | (level << _LEVEL)


@nb.njit(inline="always")
def cell_tile(key):
    """Return the number of the tile of one of the smallest cells."""
    c, r = (key >> _COLUMN) & _14, (key >> _ROW) & _14
    return np.int64(((r >> U(LEVELS - 1)) << U(_TILE_BITS)) | (c >> U(LEVELS - 1)))


@nb.njit(parallel=True, cache=True)
def cell_keys(shape, column, row, depth, u, v):
    """Return the key of each hit's smallest cell; 0 for a hit without a shape."""
    keys = np.zeros(shape.size, dtype=np.uint64)
    for i in nb.prange(shape.size):
        if shape[i] > 0:
            keys[i] = _cell_key(shape[i], column[i], row[i], depth[i], u[i], v[i])
    return keys


@nb.njit(inline="always")
def find_slot(slots, first, size, keys, key):
    """Return the slot of a key, or the empty slot where it belongs, in a table of ``size`` slots from ``first`` on.

    A slot holds the index of a key in ``keys``, or -1 if it is empty. The size is a power of two.
    """
    mask = U(size - 1)
    offset = _mix(key) & mask
    slot = first + np.int64(offset)
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        offset = (offset + U(1)) & mask
        slot = first + np.int64(offset)
    return slot


@nb.njit(inline="always")
def find_cell(slots, first, size, keys, key):
    """Return the index of a cell, or of the smallest known one around it; -1 if none is known.

    The parameters describe a table as in :func:`find_slot`.
    """
    if size == 0:
        return np.int64(-1)
    slot = find_slot(slots, first, size, keys, key)
    while slots[slot] < 0 and (key >> _LEVEL) & U(7) < U(LEVELS - 1):
        key = parent_cell(key)
        slot = find_slot(slots, first, size, keys, key)
    return np.int64(slots[slot])


@nb.njit(cache=True)
def fill_slots(slots, keys):
    """Enter keys into an empty table."""
    for i in range(keys.size):
        slots[find_slot(slots, 0, slots.size, keys, keys[i])] = i


@nb.njit(cache=True)
def add_paths(slots, keys, surface, light, count, path_keys, reflectance, radiance):
    """Add paths to the sums of their cells, in one table for all tiles, and return the new number of cells."""
    for i in range(path_keys.size):
        if path_keys[i] == 0:
            continue
        slot = find_slot(slots, 0, slots.size, keys, path_keys[i])
        if slots[slot] < 0:
            slots[slot] = count
            keys[count] = path_keys[i]
            count += 1
        cell = slots[slot]
        rho = np.float64(reflectance[i])
        surface[cell, 0] += 1
        surface[cell, 1] += rho
        surface[cell, 2] += rho * rho
        for g in range(radiance.shape[0]):
            value = np.float64(radiance[g, i])
            light[cell, g, 0] += value
            light[cell, g, 1] += value * value
            light[cell, g, 2] += value * rho
    return count


@nb.njit(cache=True)
def order_by_tile(keys):
    """Return the order that groups cells by tile (stable within each), and where each tile begins."""
    begin = np.zeros(TILES + 1, dtype=np.int32)
    for i in range(keys.size):
        begin[cell_tile(keys[i]) + 1] += 1
    for tile in range(TILES):
        begin[tile + 1] += begin[tile]
    order, offset = np.empty(keys.size, dtype=np.int32), begin[:-1].copy()
    for i in range(keys.size):
        tile = cell_tile(keys[i])
        order[offset[tile]] = i
        offset[tile] += 1
    return order, begin


@nb.njit(parallel=True, cache=True)
def reflect_shading(begin, slots, keys, shading, out, first, seed, shape, column, row, depth, u, v, reflectance):
    """Fill in the radiance that surfaces reflect to rays, float32 (light, ray), if the shading is known."""
    for i in nb.prange(shape.size):
        if shape[i] == 0:
            continue
        word = _mix(_mix(first + U(i)) ^ seed)
        x = np.float32(word & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        y = np.float32((word >> U(20)) & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        z = np.float32((word >> U(40)) & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        key = _cell_key(shape[i], column[i] + FINEST * x, row[i] + FINEST * y, depth[i] + z, u[i], v[i])
        tile = cell_tile(key)
        start, size = begin[tile], begin[tile + 1] - begin[tile]
        cell = np.int64(slots[find_slot(slots, start, size, keys, key)]) if size else np.int64(-1)
        if cell < 0:  # no cell at the moved position: use the one at the position itself, or around it
            key = _cell_key(shape[i], column[i], row[i], depth[i], u[i], v[i])
            tile = cell_tile(key)
            cell = find_cell(slots, begin[tile], begin[tile + 1] - begin[tile], keys, key)
        if cell >= 0:
            for g in range(out.shape[0]):
                out[g, i] = reflectance[i] * shading[cell, g, 0] + shading[cell, g, 1]
