"""Shading gathered from many light paths: how bright each small patch of a surface is, apart from its reflectance.

A path that meets a surface of the reflectance ρ first and brings the radiance L says how brightly that place is lit:
shading = L/ρ, for a matt surface its irradiance over π. Shading varies slowly over a surface where the texture varies
fast, so neighbouring paths may share what they know of it (path space filtering: Keller, Dahm and Binder 2014;
Binder, Fricke and Keller 2018), while the texture is looked up exactly for each ray.

Paths are sorted into cells: the same shape, nearly the same normal and depth, and the same half pixel of a
picture taken through the centre of the lens. These lie in cells of one, two, four, eight and sixteen pixels. A cell's
shading is the sum of its radiance over the sum of its reflectance. How much of its difference from the larger cell
round it is kept is decided by how much larger such differences are, in the neighbourhood, than the noise explains (the
empirical Bayes estimator: Efron and Morris 1973). A shadow's edge thus keeps its smallest cells, an evenly lit wall
uses those of sixteen, and with ever more paths every cell keeps its own mean.

A glossy surface adds to L a highlight that its texture does not multiply: L = matt·ρ + gloss. So its cells have two
numbers. From the largest to the smallest, the slope of L over ρ is turned by the same rule towards that of their paths.

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

SIGNIFICANT = 2.0  # standard errors by which now must differ from other moments to be told apart
SIGNIFICANT_LEVEL = 2  # and the level of the smallest cells in which it may: few paths are of now
PATHS_AT_ONCE = 1 << 18
ROOM = 1 << 17  # cells that there is room for at first


class SurfaceHits(NamedTuple):
    """Where rays first meet the scene, as numpy arrays (ray,).

    Attributes
    ----------
    shape : uint32, twice the number of the shape from 1, plus 1 where its surface is glossy; 0 for rays that are not to
    share shading.
    column, row : float32, the place in a picture through the centre of the lens, in pixels; of a shape that moves, as
    if it had not moved along.
    depth : float32, logarithm of the axial distance in units of a cell's depth.
    normal_u, normal_v : float32, 0...1, the normal on the octahedral map.
    reflectance : float32, 0...1.
    """

    shape: np.ndarray
    column: np.ndarray
    row: np.ndarray
    depth: np.ndarray
    normal_u: np.ndarray
    normal_v: np.ndarray
    reflectance: np.ndarray


class CellTable:
    """Cells that paths are sorted into one by one, under some light groups."""

    def __init__(self, groups: int) -> None:
        self.count = 0
        self._rays = np.zeros(3, dtype=np.int64)
        self._slots = np.full(8 * ROOM, -1, dtype=np.int32)
        self._keys = np.zeros(ROOM, dtype=np.uint64)
        self._surface = np.zeros((ROOM, 3))  # paths, sum of ρ, sum of ρ²
        self._light = np.zeros((ROOM, groups, 3))  # sums of L, L² and L·ρ

    def add(self, hits: SurfaceHits, radiance: np.ndarray) -> None:
        """Add paths by their first surfaces; ``radiance`` is float32 (light, path). Split calls give the same bits."""
        for begin in range(0, hits.shape.size, PATHS_AT_ONCE):
            part = slice(begin, begin + PATHS_AT_ONCE)
            keys = kernels.keys_of_shading_cells(*(array[part] for array in hits[:6]))
            self._make_room(self.count + keys.size)
            arrays = self._slots, self._keys, self._surface, self._light
            self.count = kernels.add_shading_paths(*arrays, self.count, keys, hits.reflectance[part], radiance[:, part])

    def count_rays(self, rays: int, *, unshared: int, in_light: int) -> None:
        """Count rays that were cast, of them those that met a surface which cannot share shading, and those that went
        straight into light.
        """
        self._rays += rays, unshared, in_light

    def by_tile(self) -> "ShadingCells":
        """Return what the paths added so far told."""
        order, begin = kernels.order_shading_by_tile(self._keys[: self.count])
        return ShadingCells(begin, self._keys[order], self._surface[order], self._light[order], self._rays)

    def _make_room(self, cells: int) -> None:
        """Provide for this many cells, in the arrays and, at most half full, in the table."""
        if cells > self._keys.size:
            more = max(cells, 2 * self._keys.size) - self._keys.size
            self._keys, self._surface, self._light = (
                np.concatenate([array, np.zeros((more, *array.shape[1:]), dtype=array.dtype)])
                for array in (self._keys, self._surface, self._light)
            )
        if 2 * cells > self._slots.size:
            self._slots = np.full(1 << (2 * cells - 1).bit_length(), -1, dtype=np.int32)
            kernels.fill_shading_slots(self._slots, self._keys[: self.count])


@dataclass(frozen=True)
class ShadingCells:
    """What paths told about the shading of each cell, under each of some light groups.

    ``begin`` says where the cells of each tile begin in the next three arrays, which are those of
    :mod:`saf_gen.render.shading_kernels`. ``rays`` is how many rays were cast, how many of them met a surface which
    cannot share shading, and how many went straight into light, int64 (3,).
    """

    begin: np.ndarray
    keys: np.ndarray
    surface: np.ndarray
    light: np.ndarray
    rays: np.ndarray

    @property
    def content(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Keys of the cells, sums of what lies in them, sums of their light."""
        return self.keys, self.surface, self.light

    @property
    def tiles(self) -> np.ndarray:
        """The tiles in which there are cells."""
        return np.flatnonzero(np.diff(self.begin))

    @classmethod
    def merged(cls, moments: Sequence["ShadingCells"]) -> "ShadingCells":
        """Return the cells of several moments together, of the same light groups."""
        if len(moments) == 1:
            return moments[0]
        # Kernels are compiled for each number of arrays, so there is always a multiple of 16 of them.
        nothing = np.zeros_like(moments[0].begin), *(array[:0] for array in moments[0].content)
        arrays_of = [(moment.begin, *moment.content) for moment in moments] + [nothing] * (-len(moments) % 16)
        begins, keys, surfaces, lights = zip(*arrays_of, strict=True)
        tiles = np.flatnonzero(np.sum([np.diff(begin) for begin in begins], axis=0))
        index = np.empty(sum(array.size for array in keys), dtype=np.int32)
        sizes = np.zeros(kernels.TILES + 1, dtype=np.int32)
        sizes[tiles + 1] = estimate.number_shading_cells(tiles, begins, keys, index)
        begin = np.cumsum(sizes, dtype=np.int32)
        count = begin[-1]
        arrays = np.empty(count, np.uint64), np.empty((count, 3)), np.empty((count, *lights[0].shape[1:]))
        whole = cls(begin, *arrays, np.sum([m.rays for m in moments], axis=0))
        out = whole.keys, whole.surface, whole.light
        estimate.add_shading_moments(tiles, begins, keys, surfaces, lights, index, begin, *out)
        return whole

    def estimate(self, around: "ShadingField | None" = None) -> "ShadingField":
        """Return the shading of each cell, estimated from the paths that told it.

        Around the largest cells lies nothing, and each has its own mean. With ``around``, the shading that other
        moments tell, these cells only say by how much the shading of now differs from it, where noise does not
        explain that; the result has the cells of ``around``.
        """
        light, told = self.light, (0, 0.0)
        if around is not None:
            light = estimate.light_beside_shading(self.surface, light, self.keys, *around.content)
            told = SIGNIFICANT_LEVEL, SIGNIFICANT
        room, tables = kernels.LEVELS * self.keys.size, estimate.begin_of_shading_tables(self.begin)
        slots, keys = np.empty(tables[-1], np.int32), np.zeros(room, np.uint64)
        shading = np.zeros((room, light.shape[1], 2), np.float32)
        cells = self.tiles, self.begin, self.keys, self.surface, light
        known = around.content if around is not None else (tables, slots, keys, shading)
        estimate.estimate_shading_tiles(*cells, known, tables, slots, keys, shading, *told)
        _, unshared, in_light = (float(count) for count in self.rays / max(self.rays[0], 1))
        field = ShadingField(self.tiles, self.begin, tables, slots, keys, shading, unshared, in_light)
        return field if around is None else around.plus(field)


@dataclass(frozen=True)
class ShadingField:
    """The shading of every cell of every width, float32 (cell, light, 2), found by the cells' keys.

    It has two parts: what the reflectance multiplies, and what its gloss adds.

    tiles, begin : the tiles in which there are cells; those of each begin at LEVELS times ``begin``, and end before the
        next tile's or at a key of 0.
    tables, slots : where the table of each tile begins, and the slots of all.
    unshared, in_light : fractions of rays, 0...1, that met a surface which cannot share shading, and that went straight
        into light.
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
        """What kernels look shading up in."""
        return self.tables, self.slots, self.keys, self.shading

    def plus(self, other: "ShadingField") -> "ShadingField":
        """Return the sum with what another field has in the same cells or round them, where it is above 0."""
        cells = self.tiles, self.begin, self.keys, self.shading
        return replace(self, shading=estimate.add_found_shading(*cells, *other.content))

    def reflect(self, hits: SurfaceHits, *, first: int, seed: int) -> np.ndarray:
        """Return the radiance that surfaces reflect to rays, float32 (light, ray); 0 where nothing is known.

        Each ray looks its shading up at a place that is moved at random by up to half a cell, so that cells blend into
        each other. ``first`` is the number of the first ray among all; it and ``seed`` name the random numbers.
        """
        out = np.zeros((self.shading.shape[1], hits.shape.size), dtype=np.float32)
        kernels.reflect_shading(*self.content, out, np.uint64(first), np.uint64(seed & 0xFFFFFFFF), *hits)
        return out
