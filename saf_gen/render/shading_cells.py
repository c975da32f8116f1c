"""Shading gathered from many light paths: the brightness of each small patch of a surface, apart from its reflectance.

A path that first meets a surface of reflectance ρ and brings the radiance L shows how brightly that point is lit: the
shading is L/ρ, which for a matt surface is its irradiance/π. Shading varies slowly over a surface on which the
texture varies fast, so neighbouring paths may share their estimate of it (path space filtering: Keller, Dahm and Binder
2014; Binder, Fricke and Keller 2018), while the texture is looked up exactly for each ray.

Paths are sorted into cells: the same shape, nearly the same normal and depth, and the same half pixel of a picture
taken through the centre of the lens. These cells are nested in cells of one, two, four, eight and sixteen pixels. The
shading of a cell is the sum of its radiance divided by the sum of its reflectance. The more the differences from the
next larger cells exceed the noise in a neighbourhood, the more of its difference each cell keeps (the empirical Bayes
estimator: Efron and Morris 1973). At the edge of a shadow the smallest cells thus keep their values, an evenly lit wall
uses cells of sixteen pixels, and as the number of paths grows, every cell approaches its own mean.

A glossy surface adds to L a highlight that its texture does not multiply: L = matt·ρ + gloss. Each of its cells
therefore has two numbers, which describe L as a linear function of ρ. From the largest cells to the smallest, the slope
of this line is moved towards the slope that the cell's own paths give, by the same rule as the shading.

References
----------
A. Keller, K. Dahm and N. Binder, "Path space filtering", ACM SIGGRAPH 2014 Talks, doi:10.1145/2614106.2614149.
N. Binder, S. Fricke and A. Keller, "Fast path space filtering by jittered spatial hashing", ACM SIGGRAPH 2018 Talks,
doi:10.1145/3214745.3214806.
B. Efron and C. Morris, J. Am. Stat. Assoc. 68, 117 (1973), doi:10.1080/01621459.1973.10481350.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from saf_gen.render import shading_estimate as estimate
from saf_gen.render import shading_kernels as kernels

SIGNIFICANT = 2.0  # standard errors by which a moment must differ from the others to have its own shading
SIGNIFICANT_LEVEL = 2  # level of the smallest cells in which it may differ, because one moment has few paths
PATHS_AT_ONCE = 1 << 18
INITIAL_CELLS = 1 << 17  # initial capacity, in cells


class SurfaceHits(NamedTuple):
    """First surfaces that rays meet, as numpy arrays (ray,).

    Attributes
    ----------
    shape : ndarray of uint32
        Twice the number of the shape, counted from 1, plus 1 if its surface is glossy; 0 for rays that share no
        shading.
    column, row : ndarray of float32
        Position in a picture through the centre of the lens, in pixels; for a shape that moves, as if it had not moved.
    depth : ndarray of float32
        Logarithm of the axial distance, in units of a cell's depth.
    normal_u, normal_v : ndarray of float32
        Normal on the octahedral map, 0 to 1.
    reflectance : ndarray of float32
        Reflectance, 0 to 1.
    """

    shape: np.ndarray
    column: np.ndarray
    row: np.ndarray
    depth: np.ndarray
    normal_u: np.ndarray
    normal_v: np.ndarray
    reflectance: np.ndarray


class CellTable:
    """A table of cells into which paths are sorted, with the light of each light group."""

    def __init__(self, groups: int) -> None:
        self.count = 0
        self._rays = np.zeros(3, dtype=np.int64)
        self._slots = np.full(8 * INITIAL_CELLS, -1, dtype=np.int32)
        self._keys = np.zeros(INITIAL_CELLS, dtype=np.uint64)
        self._surface = np.zeros((INITIAL_CELLS, 3))  # paths, sum of ρ, sum of ρ²
        self._light = np.zeros((INITIAL_CELLS, groups, 3))  # sums of L, L² and L·ρ

    def add(self, hits: SurfaceHits, radiance: np.ndarray) -> None:
        """Add paths by their first surfaces; ``radiance`` is float32 (light, path). Split calls give the same bits."""
        for begin in range(0, hits.shape.size, PATHS_AT_ONCE):
            part = slice(begin, begin + PATHS_AT_ONCE)
            keys = kernels.cell_keys(*(array[part] for array in hits[:6]))
            self._reserve(self.count + keys.size)
            arrays = self._slots, self._keys, self._surface, self._light
            self.count = kernels.add_paths(*arrays, self.count, keys, hits.reflectance[part], radiance[:, part])

    def count_rays(self, rays: int, *, unshared: int, in_light: int) -> None:
        """Count the rays that were cast, that met an unshared surface, and that went straight into light."""
        self._rays += rays, unshared, in_light

    def by_tile(self) -> "ShadingCells":
        """Return the sums of the paths added so far, with the cells in order of their tiles."""
        order, begin = kernels.order_by_tile(self._keys[: self.count])
        return ShadingCells(begin, self._keys[order], self._surface[order], self._light[order], self._rays)

    def _reserve(self, cells: int) -> None:
        """Enlarge the arrays and the table so that ``cells`` cells fit and fill at most half of the table."""
        if cells > self._keys.size:
            more = max(cells, 2 * self._keys.size) - self._keys.size
            self._keys, self._surface, self._light = (
                np.concatenate([array, np.zeros((more, *array.shape[1:]), dtype=array.dtype)])
                for array in (self._keys, self._surface, self._light)
            )
        if 2 * cells > self._slots.size:
            self._slots = np.full(1 << (2 * cells - 1).bit_length(), -1, dtype=np.int32)
            kernels.fill_slots(self._slots, self._keys[: self.count])


@dataclass(frozen=True)
class ShadingCells:
    """Sums over the light paths in each cell, under each light group.

    Attributes
    ----------
    begin : ndarray of int32, shape (TILES + 1,)
        Index at which the cells of each tile begin in ``keys``, ``surface`` and ``light``.
    keys, surface, light : ndarray
        Arrays of cells, see :mod:`saf_gen.render.shading_kernels`.
    rays : ndarray of int64, shape (3,)
        Number of rays that were cast, that met a surface that cannot share shading, and that went straight into light.
    """

    begin: np.ndarray
    keys: np.ndarray
    surface: np.ndarray
    light: np.ndarray
    rays: np.ndarray

    @property
    def content(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The arrays ``keys``, ``surface`` and ``light``."""
        return self.keys, self.surface, self.light

    @property
    def tiles(self) -> np.ndarray:
        """Numbers of the tiles that have cells."""
        return np.flatnonzero(np.diff(self.begin))

    @classmethod
    def merged(cls, moments: Sequence["ShadingCells"]) -> "ShadingCells":
        """Return the sum of the cells of several moments, which have the same light groups."""
        if len(moments) == 1:
            return moments[0]
        # Kernels are compiled for each number of arrays, so empty arrays are added up to a multiple of 16.
        nothing = np.zeros_like(moments[0].begin), *(array[:0] for array in moments[0].content)
        arrays_of = [(moment.begin, *moment.content) for moment in moments] + [nothing] * (-len(moments) % 16)
        begins, keys, surfaces, lights = zip(*arrays_of, strict=True)
        tiles = np.flatnonzero(np.sum([np.diff(begin) for begin in begins], axis=0))
        index = np.empty(sum(array.size for array in keys), dtype=np.int32)
        sizes = np.zeros(kernels.TILES + 1, dtype=np.int32)
        sizes[tiles + 1] = estimate.number_cells(tiles, begins, keys, index)
        begin = np.cumsum(sizes, dtype=np.int32)
        count = begin[-1]
        arrays = np.empty(count, np.uint64), np.empty((count, 3)), np.empty((count, *lights[0].shape[1:]))
        merged_cells = cls(begin, *arrays, np.sum([m.rays for m in moments], axis=0))
        out = merged_cells.keys, merged_cells.surface, merged_cells.light
        estimate.add_moments(tiles, begins, keys, surfaces, lights, index, begin, *out)
        return merged_cells

    def estimate(self, around: "ShadingField | None" = None) -> "ShadingField":
        """Return the shading of each cell, estimated from its paths.

        Parameters
        ----------
        around : ShadingField, optional
            Shading from other moments. These cells then only determine by how much the present shading differs from it
            beyond the noise, and the result has the cells of ``around``. By default, the estimate starts from the means
            of the largest cells.
        """
        light, significance = self.light, (0, 0.0)
        if around is not None:
            light = estimate.light_beyond(self.surface, light, self.keys, *around.content)
            significance = SIGNIFICANT_LEVEL, SIGNIFICANT
        capacity, tables = kernels.LEVELS * self.keys.size, estimate.table_begins(self.begin)
        slots, keys = np.empty(tables[-1], np.int32), np.zeros(capacity, np.uint64)
        shading = np.zeros((capacity, light.shape[1], 2), np.float32)
        cells = self.tiles, self.begin, self.keys, self.surface, light
        known = around.content if around is not None else (tables, slots, keys, shading)
        estimate.estimate_tiles(*cells, known, tables, slots, keys, shading, *significance)
        _, unshared, in_light = (float(count) for count in self.rays / max(self.rays[0], 1))
        field = ShadingField(self.tiles, self.begin, tables, slots, keys, shading, unshared, in_light)
        return field if around is None else around.plus(field)


@dataclass(frozen=True)
class ShadingField:
    """The shading of every cell of every width, looked up by the keys of the cells.

    Attributes
    ----------
    tiles : ndarray
        Numbers of the tiles that have cells.
    begin : ndarray of int32, shape (TILES + 1,)
        The cells of each tile begin at LEVELS times this index; they end where the next tile begins, or at a key of 0.
    tables : ndarray of int32, shape (TILES + 1,)
        Where the table of each tile begins.
    slots : ndarray of int32
        Slots of all tables.
    keys : ndarray of uint64, shape (cell,)
        Keys of the cells.
    shading : ndarray of float32, shape (cell, light, 2)
        The part of the shading that the reflectance multiplies, and the part that gloss adds.
    unshared, in_light : float
        Fractions of the rays, 0 to 1, that met a surface that cannot share shading, and that went straight into light.
    """

    tiles: np.ndarray
    begin: np.ndarray
    tables: np.ndarray
    slots: np.ndarray
    keys: np.ndarray
    shading: np.ndarray
    unshared: float
    in_light: float

    @property
    def content(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The arrays in which kernels look up shading."""
        return self.tables, self.slots, self.keys, self.shading

    def plus(self, other: "ShadingField") -> "ShadingField":
        """Return the sum with another field's shading of the same cells, or of the cells around them; not below 0."""
        cells = self.tiles, self.begin, self.keys, self.shading
        return replace(self, shading=estimate.add_found(*cells, *other.content))

    def reflect(self, hits: SurfaceHits, *, first: int, seed: int) -> np.ndarray:
        """Return the radiance that surfaces reflect to rays, float32 (light, ray); 0 if the shading is unknown.

        Each ray looks its shading up at a position that is moved at random by up to half a cell, so that cells blend
        into each other. ``first`` is the number of the first ray among all; the random numbers depend on it and on
        ``seed``.
        """
        out = np.zeros((self.shading.shape[1], hits.shape.size), dtype=np.float32)
        kernels.reflect_shading(*self.content, out, np.uint64(first), np.uint64(seed & 0xFFFFFFFF), *hits)
        return out
