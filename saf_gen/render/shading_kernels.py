"""The kernels of shared shading: a table of cells by their keys, sums over cells, and estimates of their shading.

:mod:`saf_gen.render.shading_cells` says what they are for. Arrays of cells are ``surface``, float64 (cell, 3): paths,
Σρ and Σρ²; and ``light``, float64 (cell, light, 3): ΣL, ΣL² and ΣL·ρ.
"""

import math

import numba as nb
import numpy as np

FINEST = 0.5  # width of the smallest cells, in pixels
LEVELS = 6  # widths of cells: 1/2, 1, 2, 4, 8 and 16 pixels
NORMAL_BINS = 8  # along each side of the octahedral map of directions
OUTSIDE = 4096  # cells beside the picture
MIN_REFLECTANCE = 1e-4  # a cell that reflects less on average is black whatever its light

U = np.uint64
# A key holds column, row (14 bits each), shape (12), normal (6), depth (13) and level (3); 0 is no key. Shapes whose
# numbers differ by 4,096 share cells where they meet in all else, and so do depths that differ by 8,192 cells.
_COLUMN, _ROW, _SHAPE, _NORMAL, _DEPTH, _LEVEL = (U(shift) for shift in (0, 14, 28, 40, 46, 59))
_USED = U(1 << 63)
_14, _13, _12, _6 = (U((1 << bits) - 1) for bits in (14, 13, 12, 6))


@nb.njit(inline="always")
def _mix(word):
    """Return a word whose bits all depend on all bits of the argument (the finalizer of SplitMix64)."""
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
def _parent_key(key):
    c, r, d = (key >> _COLUMN) & _14, (key >> _ROW) & _14, (key >> _DEPTH) & _13
    level = ((key >> _LEVEL) & U(7)) + U(1)
    kept = key & ((_12 << _SHAPE) | (_6 << _NORMAL))
    return _USED | ((c >> U(1)) << _COLUMN) | ((r >> U(1)) << _ROW) | kept | ((d >> U(1)) << _DEPTH) | (level << _LEVEL)


@nb.njit(parallel=True, cache=True)
def cell_keys(shape, column, row, depth, u, v):
    """Return the key of each hit's finest cell, 0 for a hit without a shape."""
    keys = np.zeros(shape.size, dtype=np.uint64)
    for i in nb.prange(shape.size):
        if shape[i] > 0:
            keys[i] = _cell_key(shape[i], column[i], row[i], depth[i], u[i], v[i])
    return keys


@nb.njit(cache=True)
def parent_keys(keys):
    """Return the key of the next larger cell round each."""
    parents = np.empty_like(keys)
    for i in range(keys.size):
        parents[i] = _parent_key(keys[i])
    return parents


@nb.njit(inline="always")
def _find(slots, keys, key):
    """Return the slot of a key, or the empty slot where it belongs."""
    mask = U(slots.size - 1)
    slot = _mix(key) & mask
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + U(1)) & mask
    return slot


@nb.njit(inline="always")
def _find_or_add(slots, keys, key, count):
    """Return the index of a key among ``keys``, where it is the next of ``count`` if it is new, and the new count."""
    slot = _find(slots, keys, key)
    if slots[slot] < 0:
        slots[slot] = count
        keys[count] = key
        count += 1
    return slots[slot], count


@nb.njit(inline="always")
def _find_round(slots, keys, key):
    """Return the index of a key, or of the smallest known cell round it; -1 where nothing is known."""
    slot = _find(slots, keys, key)
    while slots[slot] < 0 and (key >> _LEVEL) & U(7) < U(LEVELS - 1):
        key = _parent_key(key)
        slot = _find(slots, keys, key)
    return slots[slot]


@nb.njit(cache=True)
def add_paths(slots, keys, surface, light, count, path_keys, reflectance, radiance):
    """Add paths to the sums of their cells, and return the number of cells."""
    for i in range(path_keys.size):
        if path_keys[i] == 0:
            continue
        cell, count = _find_or_add(slots, keys, path_keys[i], count)
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
def add_cells(slots, keys, surface, light, count, more_keys, more_surface, more_light):
    """Add the sums of other cells, and return the number of cells."""
    for i in range(more_keys.size):
        cell, count = _find_or_add(slots, keys, more_keys[i], count)
        surface[cell] += more_surface[i]
        light[cell] += more_light[i]
    return count


@nb.njit(parallel=True, cache=True)
def find_shading(slots, keys, shading, wanted):
    """Return the shading of the wanted cells, or of the smallest known one round each, else 0: (cell, light)."""
    out = np.zeros((wanted.size, shading.shape[1]), dtype=np.float32)
    for i in nb.prange(wanted.size):
        cell = _find_round(slots, keys, wanted[i])
        if cell >= 0:
            out[i] = shading[cell]
    return out


@nb.njit(cache=True)
def light_beside(surface, light, shading):
    """Return the sums of cells for the radiance L - shading·ρ in place of L."""
    out = np.empty_like(light)
    for i in range(light.shape[0]):
        for g in range(light.shape[1]):
            e = np.float64(shading[i, g])
            out[i, g, 0] = light[i, g, 0] - e * surface[i, 1]
            out[i, g, 1] = light[i, g, 1] - 2 * e * light[i, g, 2] + e * e * surface[i, 2]
            out[i, g, 2] = light[i, g, 2] - e * surface[i, 2]
    return out


def index_keys(keys: np.ndarray, *, room: int = 0) -> np.ndarray:
    """Return a table of slots, at most half full with ``room`` keys, that finds these keys."""
    size = 1 << int(2 * max(keys.size, room, 1) - 1).bit_length()
    return _fill_slots(np.full(size, -1, dtype=np.int32), keys)


@nb.njit(cache=True)
def _fill_slots(slots, keys):
    for i in range(keys.size):
        slots[_find(slots, keys, keys[i])] = i
    return slots


@nb.njit(cache=True)
def _unique(slots, keys, found, index):
    count = 0
    for i in range(keys.size):
        index[i], count = _find_or_add(slots, found, keys[i], count)
    return count


def group_keys(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct keys, and the index into them of each key."""
    found, index = np.empty_like(keys), np.empty(keys.size, dtype=np.int64)
    slots = index_keys(keys[:0], room=keys.size)
    count = _unique(slots, keys, found, index)
    return found[:count].copy(), index


def sum_by(index: np.ndarray, values: np.ndarray, *, size: int) -> np.ndarray:
    """Return the sums of ``values`` (cell, ...) over the cells of the same index, (size, ...)."""
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    return _add_rows(index, flat, np.zeros((size, flat.shape[1]))).reshape(size, *values.shape[1:])


@nb.njit(cache=True)
def _add_rows(index, values, out):
    for i in range(index.size):
        for j in range(values.shape[1]):
            out[index[i], j] += values[i, j]
    return out


@nb.njit(inline="always")
def _ratio(surface, radiance):
    """Return the shading of a cell: its radiance over its reflectance."""
    return radiance / surface[1] if surface[1] > MIN_REFLECTANCE * surface[0] else 0.0


@nb.njit(cache=True)
def mean_shading(surface, light):
    """Return each cell's own shading, (cell, light)."""
    out = np.empty(light.shape[:2])
    for i in range(out.shape[0]):
        for g in range(out.shape[1]):
            out[i, g] = _ratio(surface[i], light[i, g, 0])
    return out


@nb.njit(cache=True)
def noise_of_cells(surface, light):
    """Return the sum of squared residuals L - shading·ρ in each cell, and its degrees of freedom: (cell, light, 2)."""
    out = np.empty((light.shape[0], light.shape[1], 2))
    for i in range(out.shape[0]):
        for g in range(out.shape[1]):
            e = _ratio(surface[i], light[i, g, 0])
            out[i, g, 0] = max(light[i, g, 1] - 2 * e * light[i, g, 2] + e * e * surface[i, 2], 0.0)
            out[i, g, 1] = surface[i, 0] - 1
    return out


@nb.njit(cache=True)
def shrink(surface, light, around, pool, pool_surface, pool_residual, sigmas):
    """Return the shading of cells, each between its own mean and the shading ``around`` it, (cell, light).

    Differences count where their excess over the noise is more than ``sigmas`` times its own standard error.

    The mean of a cell has the noise variance v; the true shadings differ from those around them by τ². In a
    neighbourhood (``pool``) the squared differences average τ² + v, which gives τ². The mean then counts τ²/(τ² + v).
    """
    cells, groups = around.shape
    excess, weight = np.zeros(pool_residual.shape[:2]), np.zeros(pool_residual.shape[0])
    scatter = np.zeros(pool_residual.shape[:2])
    out, noise = np.empty((cells, groups)), np.empty((cells, groups))
    for i in range(cells):
        p = pool[i]
        weight[p] += surface[i, 1]
        for g in range(groups):
            mean = _ratio(surface[i], light[i, g, 0])
            # The residual of one path per unit of ρ², times Σρ²/(Σρ)² for the noise of a ratio of sums.
            per_path = pool_residual[p, g, 0] / max(pool_residual[p, g, 1], 1.0)
            per_rho = per_path * pool_surface[p, 0] / max(pool_surface[p, 2], 1e-30)
            noise[i, g] = per_rho * surface[i, 2] / max(surface[i, 1], MIN_REFLECTANCE * surface[i, 0]) ** 2
            beyond = surface[i, 1] * ((mean - around[i, g]) ** 2 - noise[i, g])
            excess[p, g] += beyond
            scatter[p, g] += beyond**2
    for i in range(cells):
        p = pool[i]
        for g in range(groups):
            kept = 0.0
            if (
                surface[i, 1] > MIN_REFLECTANCE * surface[i, 0]
                and pool_residual[p, g, 1] >= 1
                and excess[p, g] > sigmas * np.sqrt(scatter[p, g])
            ):
                spread = excess[p, g] / weight[p]
                kept = spread / (spread + noise[i, g])
            out[i, g] = around[i, g] + kept * (_ratio(surface[i], light[i, g, 0]) - around[i, g])
    return out


@nb.njit(parallel=True, cache=True)
def reflect(slots, keys, shading, out, first, seed, shape, column, row, depth, u, v, reflectance):
    """Fill in the radiance that surfaces reflect to rays, float32 (light, ray), where shading is known."""
    for i in nb.prange(shape.size):
        if shape[i] == 0:
            continue
        word = _mix(_mix(first + U(i)) ^ seed)
        x = np.float32(word & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        y = np.float32((word >> U(20)) & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        z = np.float32((word >> U(40)) & U(0xFFFFF)) * np.float32(2.0**-20) - np.float32(0.5)
        key = _cell_key(shape[i], column[i] + FINEST * x, row[i] + FINEST * y, depth[i] + z, u[i], v[i])
        cell = slots[_find(slots, keys, key)]
        if cell < 0:  # beside the moved place there is nothing of this kind: take the cell itself, or one round it
            cell = _find_round(slots, keys, _cell_key(shape[i], column[i], row[i], depth[i], u[i], v[i]))
        if cell >= 0:
            for g in range(out.shape[0]):
                out[g, i] = reflectance[i] * shading[cell, g]
