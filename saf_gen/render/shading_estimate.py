"""The kernels that estimate shading, tile by tile: moments added up, sums of larger cells, and how much counts of each.

Arrays are those of :mod:`saf_gen.render.shading_kernels`. Tiles are shared out among the cores; the cells of one are
added in the order in which they came, so that neither the number of cores nor their order changes a bit.
"""

import numba as nb
import numpy as np

from saf_gen.render.shading_kernels import LEVELS, TILES, find_round, find_slot, parent_key, tile_of

MIN_REFLECTANCE = 1e-4  # a cell that reflects less on average is black whatever its light
POOL = 2  # levels up: the neighbourhood that variances are estimated in is four cells wide


@nb.njit(inline="always")
def _table_size(cells):
    """Return the number of slots of a table, a power of two, that is at most half full with so many cells."""
    size = 2
    while size < 2 * cells:
        size *= 2
    return size


@nb.njit(parallel=True, cache=True)
def number_cells(tiles, begins, keys, index):
    """Number the distinct cells of some moments in each tile, as they come, and return how many there are, (tile,).

    Parameters
    ----------
    tiles : the tiles in which there are cells.
    begins, keys : of each moment, as tuples.
    index : int32 (cell of the first, then of the later moments), filled in with the number of each cell in its tile.
    """
    counts = np.zeros(tiles.size, dtype=np.int32)
    for n in nb.prange(tiles.size):
        tile, most = tiles[n], 0
        for m in range(len(keys)):
            most += begins[m][tile + 1] - begins[m][tile]
        slots, found = np.full(_table_size(most), -1, dtype=np.int32), np.empty(most, dtype=np.uint64)
        count, before = 0, 0
        for m in range(len(keys)):
            for i in range(begins[m][tile], begins[m][tile + 1]):
                slot = find_slot(slots, 0, slots.size, found, keys[m][i])
                if slots[slot] < 0:
                    slots[slot] = count
                    found[count] = keys[m][i]
                    count += 1
                index[before + i] = slots[slot]
            before += keys[m].size
        counts[n] = count
    return counts


@nb.njit(parallel=True, cache=True)
def add_moments(tiles, begins, keys, surfaces, lights, index, begin, out_keys, out_surface, out_light):
    """Add the sums of some moments up, whose cells are numbered by ``index`` in each tile."""
    groups = out_light.shape[1]
    for n in nb.prange(tiles.size):
        tile, before = tiles[n], 0
        out_surface[begin[tile] : begin[tile + 1]] = 0
        out_light[begin[tile] : begin[tile + 1]] = 0
        for m in range(len(keys)):
            surface, light = surfaces[m], lights[m]
            for i in range(begins[m][tile], begins[m][tile + 1]):
                cell = begin[tile] + index[before + i]
                out_keys[cell] = keys[m][i]
                for j in range(3):
                    out_surface[cell, j] += surface[i, j]
                for g in range(groups):
                    for j in range(3):
                        out_light[cell, g, j] += light[i, g, j]
            before += keys[m].size


@nb.njit(cache=True)
def begin_of_tables(begin):
    """Return where the table of each tile begins, for its cells and all larger ones round them, int32 (TILES + 1,)."""
    tables = np.zeros(TILES + 1, dtype=np.int32)
    for tile in range(TILES):
        cells = begin[tile + 1] - begin[tile]
        # Half full if every cell had a larger one of each width to itself twice; a third of that is usual.
        tables[tile + 1] = tables[tile] + (_table_size(LEVELS * cells // 2 + 1) if cells else 0)
    return tables


@nb.njit(parallel=True, cache=True)
def light_beside(surface, light, keys, tables, slots, known_keys, shading):
    """Return the sums of cells for the radiance L - shading·ρ in place of L, with the shading known there."""
    out = np.empty_like(light)
    for i in nb.prange(light.shape[0]):
        tile = tile_of(keys[i])
        cell = find_round(slots, tables[tile], tables[tile + 1] - tables[tile], known_keys, keys[i])
        for g in range(light.shape[1]):
            e = np.float64(shading[cell, g]) if cell >= 0 else 0.0
            out[i, g, 0] = light[i, g, 0] - e * surface[i, 1]
            out[i, g, 1] = light[i, g, 1] - 2 * e * light[i, g, 2] + e * e * surface[i, 2]
            out[i, g, 2] = light[i, g, 2] - e * surface[i, 2]
    return out


@nb.njit(parallel=True, cache=True)
def add_found(tiles, begin, keys, shading, tables, slots, found_keys, found):
    """Return shading plus what was found for each cell, or for the smallest known one round it, but not below 0."""
    out = np.zeros_like(shading)
    for n in nb.prange(tiles.size):
        tile = tiles[n]
        for i in range(LEVELS * np.int64(begin[tile]), LEVELS * np.int64(begin[tile + 1])):
            if keys[i] == 0:
                break
            cell = find_round(slots, tables[tile], tables[tile + 1] - tables[tile], found_keys, keys[i])
            for g in range(shading.shape[1]):
                out[i, g] = max(shading[i, g] + found[cell, g], np.float32(0)) if cell >= 0 else shading[i, g]
    return out


@nb.njit(parallel=True, cache=True)
def estimate_tiles(tiles, begin, keys, surface, light, tables, slots, out_keys, out_shading, finest, sigmas):
    """Estimate the shading of the cells of each tile and of all larger ones round them.

    Parameters
    ----------
    tables, slots : where the table of each tile begins, and the slots of all tables, filled in.
    out_keys, out_shading : uint64 (cell,) and float32 (cell, light), filled in for each tile from LEVELS times its
        ``begin`` on, at first all 0.
    finest, sigmas : of the smallest cells that tell anything of their own, and by how many standard errors they must.
        With 0 of them the largest cells have their own mean, else nothing.
    """
    for n in nb.prange(tiles.size):
        tile = tiles[n]
        a, b = begin[tile], begin[tile + 1]
        slots[tables[tile] : tables[tile + 1]] = -1
        table = slots, tables[tile], tables[tile + 1] - tables[tile]
        first = LEVELS * np.int64(a)
        _estimate_tile(keys[a:b], surface[a:b], light[a:b], table, first, out_keys, out_shading, finest, sigmas)


@nb.njit(cache=True)
def _estimate_tile(keys, surface, light, table, first, out_keys, out_shading, finest, sigmas):
    slots, begin, size = table
    cells, groups, top = keys.size, light.shape[1], LEVELS - 1
    # Cells of all levels, the smallest first; those of a level end where those of the next begin.
    room = LEVELS * cells
    parent, ends = np.empty(room, dtype=np.int32), np.zeros(LEVELS + 1, dtype=np.int64)
    sums, lights, rest = np.empty((room, 3)), np.empty((room, groups, 3)), np.empty((room, groups, 2))
    shading = np.empty((room, groups))
    ends[1] = cells
    for i in range(cells):
        slots[find_slot(slots, begin, size, out_keys, keys[i])] = first + i
        out_keys[first + i] = keys[i]
        for j in range(3):
            sums[i, j] = surface[i, j]
        for g in range(groups):
            for j in range(3):
                lights[i, g, j] = light[i, g, j]
            # Squared residuals L - shading·ρ, and their degrees of freedom.
            e = _ratio(surface[i], light[i, g, 0])
            rest[i, g, 0] = max(light[i, g, 1] - 2 * e * light[i, g, 2] + e * e * surface[i, 2], 0.0)
            rest[i, g, 1] = surface[i, 0] - 1
    for level in range(1, LEVELS):
        end = ends[level]
        for i in range(ends[level - 1], ends[level]):
            key = parent_key(out_keys[first + i])
            slot = find_slot(slots, begin, size, out_keys, key)
            if slots[slot] < 0:
                slots[slot] = first + end
                out_keys[first + end] = key
                sums[end], lights[end], rest[end] = 0, 0, 0
                end += 1
            p = slots[slot] - first
            parent[i] = p
            for j in range(3):
                sums[p, j] += sums[i, j]
            for g in range(groups):
                for j in range(3):
                    lights[p, g, j] += lights[i, g, j]
                for j in range(2):
                    rest[p, g, j] += rest[i, g, j]
        ends[level + 1] = end
    for i in range(ends[top], ends[LEVELS]):
        for g in range(groups):
            shading[i, g] = 0.0 if sigmas > 0 else _ratio(sums[i], lights[i, g, 0])
    for level in range(top - 1, -1, -1):
        for i in range(ends[level], ends[level + 1]):
            for g in range(groups):
                shading[i, g] = shading[parent[i], g]
        if level >= finest:
            _shrink(level, ends, parent, sums, lights, rest, shading, sigmas)
    if sigmas == 0:
        _conserve(ends, parent, sums, shading)
    for i in range(ends[LEVELS]):
        for g in range(groups):
            out_shading[first + i, g] = shading[i, g]


@nb.njit(inline="always")
def _ratio(surface, radiance):
    """Return the shading of a cell: its radiance over its reflectance."""
    return radiance / surface[1] if surface[1] > MIN_REFLECTANCE * surface[0] else 0.0


@nb.njit(cache=True)
def _shrink(level, ends, parent, sums, lights, rest, shading, sigmas):
    """Move the shading of the cells of a level from what is round them towards their own mean, in place.

    Differences count where their excess over the noise is more than ``sigmas`` times its own standard error.

    The mean of a cell has the noise variance v; the true shadings differ from those around them by τ². In a
    neighbourhood (``pool``) the squared differences average τ² + v, which gives τ². The mean then counts τ²/(τ² + v).
    """
    pool_level = min(level + POOL, LEVELS - 1)
    a, b, base, groups = ends[level], ends[level + 1], ends[pool_level], shading.shape[1]
    pools = ends[pool_level + 1] - base
    weight, excess, scatter = np.zeros(pools), np.zeros((pools, groups)), np.zeros((pools, groups))
    pool, noise = np.empty(b - a, dtype=np.int32), np.empty((b - a, groups))
    for i in range(a, b):
        p = parent[i]
        for _ in range(level + 1, pool_level):
            p = parent[p]
        pool[i - a] = p
        weight[p - base] += sums[i, 1]
        for g in range(groups):
            mean = _ratio(sums[i], lights[i, g, 0])
            # The residual of one path per unit of ρ², times Σρ²/(Σρ)² for the noise of a ratio of sums.
            per_path = rest[p, g, 0] / max(rest[p, g, 1], 1.0)
            per_rho = per_path * sums[p, 0] / max(sums[p, 2], 1e-30)
            noise[i - a, g] = per_rho * sums[i, 2] / max(sums[i, 1], MIN_REFLECTANCE * sums[i, 0]) ** 2
            beyond = sums[i, 1] * ((mean - shading[i, g]) ** 2 - noise[i - a, g])
            excess[p - base, g] += beyond
            scatter[p - base, g] += beyond**2
    for i in range(a, b):
        p = pool[i - a]
        for g in range(groups):
            if (
                sums[i, 1] > MIN_REFLECTANCE * sums[i, 0]
                and rest[p, g, 1] >= 1
                and excess[p - base, g] > sigmas * np.sqrt(scatter[p - base, g])
            ):
                spread = excess[p - base, g] / weight[p - base]
                kept = spread / (spread + noise[i - a, g])
                shading[i, g] += kept * (_ratio(sums[i], lights[i, g, 0]) - shading[i, g])


@nb.njit(cache=True)
def _conserve(ends, parent, sums, shading):
    """Scale the shading in each largest cell, in place, so that its smallest cells reflect together what it does.

    A bright path makes its neighbourhood look noisy, and its cells then count less than the dark ones of another. So
    estimates that weigh cells by their noise lose light. The mean of a largest cell has no such bias.
    """
    groups, top = shading.shape[1], ends[LEVELS - 1]
    reflected, scale = np.zeros((ends[LEVELS] - top, groups)), np.ones((ends[LEVELS], groups))
    for i in range(ends[1]):
        p = parent[i]
        while p < top:
            p = parent[p]
        for g in range(groups):
            reflected[p - top, g] += sums[i, 1] * shading[i, g]
    for p in range(top, ends[LEVELS]):
        for g in range(groups):
            if reflected[p - top, g] > 0:
                scale[p, g] = shading[p, g] * sums[p, 1] / reflected[p - top, g]
    for i in range(top - 1, -1, -1):
        for g in range(groups):
            scale[i, g] = scale[parent[i], g]
            shading[i, g] *= scale[i, g]
