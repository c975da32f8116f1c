"""The kernels that estimate shading tile by tile: they add up moments and larger cells, and weigh each estimate.

:mod:`saf_gen.render.shading_kernels` describes the arrays. Tiles are distributed over the cores. The cells of a tile
are added in the order in which they came, so that neither the number of cores nor their order changes a bit.
"""

import numba as nb
import numpy as np

from saf_gen.render.shading_kernels import LEVELS, TILES, cell_tile, find_cell, find_slot, is_glossy, parent_cell

MIN_REFLECTANCE = 1e-4  # a cell that reflects less on average counts as black
SAME_REFLECTANCE = 1e-6  # of the mean square of ρ; a cell in which ρ varies by less does not show its gloss
POOL = 2  # levels up: variances are estimated in a neighbourhood four cells wide


@nb.njit(inline="always")
def _table_size(cells):
    """Return the number of slots, a power of two, of a table that is at most half full with this many cells."""
    size = 2
    while size < 2 * cells:
        size *= 2
    return size


@nb.njit(parallel=True, cache=True)
def number_cells(tiles, begins, keys, index):
    """Number the distinct cells of several moments in each tile, in order, and return their counts, int32 (tile,).

    Parameters
    ----------
    tiles : ndarray
        Numbers of the tiles that have cells.
    begins, keys : tuple of ndarray
        The arrays ``begin`` and ``keys`` of each moment.
    index : ndarray of int32
        Filled in with the number of each cell in its tile; the cells of the first moment come first.
    """
    counts = np.zeros(tiles.size, dtype=np.int32)
    for n in nb.prange(tiles.size):
        tile, max_cells = tiles[n], 0
        for m in range(len(keys)):
            max_cells += begins[m][tile + 1] - begins[m][tile]
        slots, found = np.full(_table_size(max_cells), -1, dtype=np.int32), np.empty(max_cells, dtype=np.uint64)
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
    """Write, for each cell, its sums over several moments; ``index`` numbers the cells of each moment within a tile."""
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
def table_begins(begin):
    """Return where the table of each tile begins, for its cells and all larger ones around them, int32 (TILES + 1,)."""
    tables = np.zeros(TILES + 1, dtype=np.int32)
    for tile in range(TILES):
        cells = begin[tile + 1] - begin[tile]
        # Never full, even if no two cells shared a larger one, which would give three times the usual number.
        tables[tile + 1] = tables[tile] + (_table_size(LEVELS * cells // 2 + 1) if cells else 0)
    return tables


@nb.njit(parallel=True, cache=True)
def light_beyond(surface, light, keys, tables, slots, known_keys, shading):
    """Return the cells' sums for the radiance beyond the known shading, L - matt·ρ - gloss, instead of L."""
    out = np.empty_like(light)
    for i in nb.prange(light.shape[0]):
        tile = cell_tile(keys[i])
        cell = find_cell(slots, tables[tile], tables[tile + 1] - tables[tile], known_keys, keys[i])
        for g in range(light.shape[1]):
            matt = np.float64(shading[cell, g, 0]) if cell >= 0 else 0.0
            gloss = np.float64(shading[cell, g, 1]) if cell >= 0 else 0.0
            out[i, g, 0] = light[i, g, 0] - matt * surface[i, 1] - gloss * surface[i, 0]
            out[i, g, 1] = light[i, g, 1] + _squares_beyond_shading(surface[i], light[i, g], matt, gloss)
            out[i, g, 2] = light[i, g, 2] - matt * surface[i, 2] - gloss * surface[i, 1]
    return out


@nb.njit(inline="always")
def _squares_beyond_shading(surface, light, matt, gloss):
    """Return by how much a cell's Σ(L - matt·ρ - gloss)² exceeds its ΣL²."""
    squares = matt * matt * surface[2] + 2 * matt * gloss * surface[1] + gloss * gloss * surface[0]
    return squares - 2 * matt * light[2] - 2 * gloss * light[0]


@nb.njit(parallel=True, cache=True)
def add_found(tiles, begin, keys, shading, tables, slots, found_keys, found):
    """Return each cell's shading plus the found shading of it or of the smallest known cell around it, at least 0."""
    out = np.zeros_like(shading)
    for n in nb.prange(tiles.size):
        tile = tiles[n]
        for i in range(LEVELS * np.int64(begin[tile]), LEVELS * np.int64(begin[tile + 1])):
            if keys[i] == 0:
                break
            cell = find_cell(slots, tables[tile], tables[tile + 1] - tables[tile], found_keys, keys[i])
            for g in range(shading.shape[1]):
                for j in range(2):
                    beyond = found[cell, g, j] if cell >= 0 else np.float32(0)
                    out[i, g, j] = max(shading[i, g, j] + beyond, np.float32(0))
    return out


@nb.njit(parallel=True, cache=True)
def estimate_tiles(tiles, begin, keys, surface, light, around, tables, slots, out_keys, out_shading, finest, sigmas):
    """Estimate the shading of the cells of each tile and of all larger ones around them.

    Parameters
    ----------
    tiles, begin, keys, surface, light : ndarray
        Cells by tile.
    around : tuple of ndarray
        Tables, slots, keys and shading in which known shading is looked up; not read if ``sigmas`` is 0.
    tables, slots : ndarray
        Where the table of each tile begins, and the slots of all tables, which are filled in.
    out_keys : ndarray of uint64, shape (cell,)
        All 0 at first; filled in for each tile from LEVELS times its ``begin`` on.
    out_shading : ndarray of float32, shape (cell, light, 2)
        Filled in at the same indices.
    finest : int
        Level of the smallest cells that may differ from those around them.
    sigmas : float
        Number of standard errors by which cells must differ. If 0, the largest cells start with their own mean,
        otherwise with 0.
    """
    for n in nb.prange(tiles.size):
        tile = tiles[n]
        a, b = begin[tile], begin[tile + 1]
        slots[tables[tile] : tables[tile + 1]] = -1
        table = slots, tables[tile], tables[tile + 1] - tables[tile]
        known = around[0][tile], around[0][tile + 1] - around[0][tile], around[1], around[2], around[3]
        first = LEVELS * np.int64(a)
        _estimate_tile(keys[a:b], surface[a:b], light[a:b], known, table, first, out_keys, out_shading, finest, sigmas)


@nb.njit(cache=True)
def _estimate_tile(keys, surface, light, known, table, first, out_keys, out_shading, finest, sigmas):
    slots, begin, size = table
    cells, groups, top = keys.size, light.shape[1], LEVELS - 1
    # Cells of all levels, smallest first; each level ends where the next begins.
    capacity = LEVELS * cells
    parent, ends = np.empty(capacity, dtype=np.int32), np.zeros(LEVELS + 1, dtype=np.int64)
    sums, lights, rest = np.empty((capacity, 3)), np.empty((capacity, groups, 3)), np.empty((capacity, groups, 2))
    # The estimates for a cell: its brightness (the radiance at ρ = 1), and the fraction of it that comes from gloss.
    shading, gloss = np.empty((capacity, groups)), np.zeros((capacity, groups))
    ends[1] = cells
    for i in range(cells):
        slots[find_slot(slots, begin, size, out_keys, keys[i])] = first + i
        out_keys[first + i] = keys[i]
        for j in range(3):
            sums[i, j] = surface[i, j]
        for g in range(groups):
            for j in range(3):
                lights[i, g, j] = light[i, g, j]
            # Sum of squared residuals L - shading·ρ, and their degrees of freedom.
            e = _ratio(surface[i], light[i, g, 0], 0.0)
            rest[i, g, 0] = max(light[i, g, 1] + _squares_beyond_shading(surface[i], light[i, g], e, 0.0), 0.0)
            rest[i, g, 1] = surface[i, 0] - 1
    for level in range(1, LEVELS):
        end = ends[level]
        for i in range(ends[level - 1], ends[level]):
            key = parent_cell(out_keys[first + i])
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
    glossy = np.empty(ends[LEVELS], dtype=np.bool_)
    for i in range(ends[LEVELS]):
        glossy[i] = is_glossy(out_keys[first + i])
    for i in range(ends[LEVELS] if sigmas > 0 else 0):
        cell = find_cell(known[2], known[0], known[1], known[3], out_keys[first + i])
        for g in range(groups):
            if cell >= 0 and known[4][cell, g, 1] > 0:
                gloss[i, g] = known[4][cell, g, 1] / (known[4][cell, g, 0] + known[4][cell, g, 1])
    for i in range(ends[top], ends[LEVELS]):
        for g in range(groups):
            shading[i, g] = 0.0 if sigmas > 0 else _ratio(sums[i], lights[i, g, 0], 0.0)
    if sigmas == 0:
        _separate_gloss(top, ends, parent, glossy, sums, lights, rest, shading, gloss)
    for level in range(top - 1, -1, -1):
        for i in range(ends[level], ends[level + 1]):
            for g in range(groups):
                shading[i, g] = shading[parent[i], g]
                gloss[i, g] = gloss[i, g] if sigmas > 0 else gloss[parent[i], g]
        if level >= finest:
            _shrink(level, ends, parent, sums, lights, rest, shading, gloss, sigmas)
            if sigmas == 0:
                _separate_gloss(level, ends, parent, glossy, sums, lights, rest, shading, gloss)
    if sigmas == 0:
        _conserve_light(ends, parent, sums, shading, gloss)
    for i in range(ends[LEVELS]):
        for g in range(groups):
            out_shading[first + i, g, 0] = shading[i, g] * (1 - gloss[i, g])
            out_shading[first + i, g, 1] = shading[i, g] * gloss[i, g]


@nb.njit(inline="always")
def _weights(surface, gloss):
    """Return Σw and Σw² of a cell, w = (1 - gloss)·ρ + gloss, the radiance of its paths at brightness 1."""
    matt = 1 - gloss
    first = matt * surface[1] + gloss * surface[0]
    return first, matt * matt * surface[2] + 2 * matt * gloss * surface[1] + gloss * gloss * surface[0]


@nb.njit(inline="always")
def _ratio(surface, radiance, gloss):
    """Return the brightness of a cell, its summed radiance divided by its summed weights; 0 for a black cell."""
    weight, _ = _weights(surface, gloss)
    return radiance / weight if weight > MIN_REFLECTANCE * surface[0] else 0.0


@nb.njit(inline="always")
def _pool_of(i, level, pool_level, parent):
    """Return the cell at the level of the pool that contains cell ``i``."""
    for _ in range(level, pool_level):
        i = parent[i]
    return i


@nb.njit(cache=True)
def _shrink(level, ends, parent, sums, lights, rest, shading, gloss, sigmas):
    """Move the brightness of each cell of a level from the brightness of the next larger cell towards the cell's mean.

    ``shading`` is changed in place. The mean of a cell has the noise variance v. Its true brightness differs from that
    of the larger cell with the variance τ². In a neighbourhood (``pool``) the squared differences average τ² + v, which
    gives τ². The weight of the mean is then τ²/(τ² + v). A neighbourhood in which the excess of the squared differences
    over the noise is at most ``sigmas`` times its standard error is left as it is.
    """
    pool_level = min(level + POOL, LEVELS - 1)
    a, b, base, groups = ends[level], ends[level + 1], ends[pool_level], shading.shape[1]
    pools = ends[pool_level + 1] - base
    weight, squares = np.zeros((pools, groups)), np.zeros((pools, groups))
    excess, scatter = np.zeros((pools, groups)), np.zeros((pools, groups))
    noise = np.empty((b - a, groups))
    for i in range(a, b):
        p = _pool_of(i, level, pool_level, parent)
        for g in range(groups):
            first, second = _weights(sums[i], gloss[i, g])
            weight[p - base, g] += first
            squares[p - base, g] += second
    for i in range(a, b):
        p = _pool_of(i, level, pool_level, parent)
        for g in range(groups):
            first, second = _weights(sums[i], gloss[i, g])
            mean = _ratio(sums[i], lights[i, g, 0], gloss[i, g])
            # The residual of one path per unit of w², times Σw²/(Σw)² for the noise of a ratio of sums.
            per_path = rest[p, g, 0] / max(rest[p, g, 1], 1.0)
            per_weight = per_path * sums[p, 0] / max(squares[p - base, g], 1e-30)
            noise[i - a, g] = per_weight * second / max(first, MIN_REFLECTANCE * sums[i, 0]) ** 2
            beyond = first * ((mean - shading[i, g]) ** 2 - noise[i - a, g])
            excess[p - base, g] += beyond
            scatter[p - base, g] += beyond**2
    for i in range(a, b):
        p = _pool_of(i, level, pool_level, parent)
        for g in range(groups):
            if (
                _weights(sums[i], gloss[i, g])[0] > MIN_REFLECTANCE * sums[i, 0]
                and rest[p, g, 1] >= 1
                and excess[p - base, g] > sigmas * np.sqrt(scatter[p - base, g])
            ):
                spread = excess[p - base, g] / weight[p - base, g]
                kept = spread / (spread + noise[i - a, g])
                shading[i, g] += kept * (_ratio(sums[i], lights[i, g, 0], gloss[i, g]) - shading[i, g])


@nb.njit(cache=True)
def _separate_gloss(level, ends, parent, glossy, sums, lights, rest, shading, gloss):
    """Separate, in place, the light that gloss adds to a level's cells from the light that their texture multiplies.

    The line L = shading·((1 - gloss)·ρ + gloss) of a cell is turned about its mean, towards the slope in ρ that the
    cell's own paths give (least squares), with the same weight τ²/(τ² + v) as in :func:`_shrink`. Neither part goes
    below 0.
    """
    pool_level = min(level + POOL, LEVELS - 1)
    a, b, base, groups = ends[level], ends[level + 1], ends[pool_level], shading.shape[1]
    pools = ends[pool_level + 1] - base
    weight, excess = np.zeros(pools), np.zeros((pools, groups))
    varied, slope = np.empty(b - a), np.empty((b - a, groups))
    for i in range(a, b):
        p = _pool_of(i, level, pool_level, parent)
        varied[i - a] = sums[i, 2] - sums[i, 1] ** 2 / sums[i, 0]
        if not glossy[i] or varied[i - a] <= SAME_REFLECTANCE * sums[i, 2]:
            varied[i - a] = 0
            continue
        weight[p - base] += varied[i - a]
        for g in range(groups):
            path_slope = (lights[i, g, 2] - lights[i, g, 0] * sums[i, 1] / sums[i, 0]) / varied[i - a]
            slope[i - a, g] = path_slope - shading[i, g] * (1 - gloss[i, g])
            excess[p - base, g] += slope[i - a, g] ** 2 * varied[i - a] - rest[p, g, 0] / max(rest[p, g, 1], 1.0)
    for i in range(a, b):
        p = _pool_of(i, level, pool_level, parent)
        if varied[i - a] == 0:
            continue
        for g in range(groups):
            if not (rest[p, g, 1] >= 1 and excess[p - base, g] > 0):
                continue
            spread = excess[p - base, g] / weight[p - base]
            noise = rest[p, g, 0] / rest[p, g, 1] / varied[i - a]
            matt, added, rho = shading[i, g] * (1 - gloss[i, g]), shading[i, g] * gloss[i, g], sums[i, 1] / sums[i, 0]
            change = slope[i - a, g] * spread / (spread + noise)
            change = min(max(change, -matt), added / rho)
            matt, added = matt + change, max(added - change * rho, 0.0)
            shading[i, g] = matt + added
            gloss[i, g] = added / (matt + added) if matt + added > 0 else 0.0


@nb.njit(cache=True)
def _conserve_light(ends, parent, sums, shading, gloss):
    """Scale the shading in each largest cell, in place, so that its smallest cells together reflect as much as it does.

    A bright path makes its neighbourhood look noisy, so its cells count less than the dark ones of another
    neighbourhood. Estimates that weigh cells by their noise therefore lose light. The mean of a largest cell has no
    bias of this kind.
    """
    groups, top = shading.shape[1], ends[LEVELS - 1]
    reflected, scale = np.zeros((ends[LEVELS] - top, groups)), np.ones((ends[LEVELS], groups))
    for i in range(ends[1]):
        p = parent[i]
        while p < top:
            p = parent[p]
        for g in range(groups):
            reflected[p - top, g] += _weights(sums[i], gloss[i, g])[0] * shading[i, g]
    for p in range(top, ends[LEVELS]):
        for g in range(groups):
            if reflected[p - top, g] > 0:
                scale[p, g] = shading[p, g] * _weights(sums[p], gloss[p, g])[0] / reflected[p - top, g]
    for i in range(top - 1, -1, -1):
        for g in range(groups):
            scale[i, g] = scale[parent[i], g]
            shading[i, g] *= scale[i, g]
