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

References
----------
A. Keller, K. Dahm and N. Binder, "Path space filtering", ACM SIGGRAPH 2014 Talks, doi:10.1145/2614106.2614149.
N. Binder, S. Fricke and A. Keller, "Fast path space filtering by jittered spatial hashing", ACM SIGGRAPH 2018 Talks,
doi:10.1145/3214745.3214806.
B. Efron and C. Morris, J. Am. Stat. Assoc. 68, 117 (1973), doi:10.1080/01621459.1973.10481350.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saf_gen.render import shading_kernels as kernels
from saf_gen.render.shading_kernels import LEVELS

SIGNIFICANT = 2.0  # standard errors by which now must differ from other moments to be told apart
SIGNIFICANT_LEVEL = 2  # and the level of the smallest cells in which it may: few paths are of now
POOL = 2  # levels up: the neighbourhood that variances are estimated in is four cells wide
PATHS_AT_ONCE = 1 << 18
ROOM = 1 << 17  # cells that there is room for at first


class SurfaceHits(NamedTuple):
    """Where rays first meet the scene, as numpy arrays (ray,).

    Attributes
    ----------
    shape : uint32, number of the shape from 1; 0 for rays that are not to share shading.
    column, row : float32, the place in a picture through the centre of the lens, in pixels.
    depth : float32, logarithm of the axial distance in units of a cell's depth.
    normal_u, normal_v : float32, 0...1, the normal on the octahedral map.
    reflectance : float32, 0...1.
    distance : float32, axial distance (m) from the lens; inf where there is no surface, 0 where light comes from
    behind it.
    """

    shape: np.ndarray
    column: np.ndarray
    row: np.ndarray
    depth: np.ndarray
    normal_u: np.ndarray
    normal_v: np.ndarray
    reflectance: np.ndarray
    distance: np.ndarray


class ShadingCells:
    """What paths told about the shading of each cell, under each of some light groups."""

    def __init__(self, groups: int) -> None:
        self.groups, self.count = groups, 0
        self._slots = np.full(8 * ROOM, -1, dtype=np.int32)
        self._keys = np.zeros(ROOM, dtype=np.uint64)
        self._surface = np.zeros((ROOM, 3))  # paths, sum of ρ, sum of ρ²
        self._light = np.zeros((ROOM, groups, 3))  # sums of L, L² and L·ρ

    def add(self, hits: SurfaceHits, radiance: np.ndarray) -> None:
        """Add paths by their first surfaces; ``radiance`` is float32 (light, path). Split calls give the same bits."""
        for begin in range(0, hits.shape.size, PATHS_AT_ONCE):
            part = slice(begin, begin + PATHS_AT_ONCE)
            keys = kernels.cell_keys(*(array[part] for array in hits[:6]))
            self._make_room(self.count + keys.size)
            self.count = kernels.add_paths(
                self._slots,
                self._keys,
                self._surface,
                self._light,
                self.count,
                keys,
                hits.reflectance[part],
                radiance[:, part],
            )

    @classmethod
    def merged(cls, moments: Sequence["ShadingCells"]) -> "ShadingCells":
        """Return the cells of several moments together, of the same light groups."""
        if len(moments) == 1:
            return moments[0]
        whole = cls(moments[0].groups)
        for cells in moments:
            n = cells.count
            whole._make_room(whole.count + n)
            arrays = whole._slots, whole._keys, whole._surface, whole._light
            whole.count = kernels.add_cells(*arrays, whole.count, cells._keys[:n], cells._surface[:n], cells._light[:n])
        return whole

    def estimate(self, around: "ShadingField | None" = None) -> "ShadingField":
        """Return the shading of each cell, estimated from the paths added so far.

        Around the largest cells lies nothing, and each has its own mean. With ``around``, the shading that other
        moments tell, these cells only say by how much the shading of now differs from it, where noise does not
        explain that; the result has the cells of ``around``.
        """
        n = self.count
        keys, surface, light = [self._keys[:n]], [self._surface[:n]], [self._light[:n]]
        if around is not None:
            light = [kernels.light_beside(surface[0], light[0], around.find(keys[0]))]
        parents = []
        for _ in range(1, LEVELS):
            found, index = kernels.group_keys(kernels.parent_keys(keys[-1]))
            keys.append(found)
            surface.append(kernels.sum_by(index, surface[-1], size=found.size))
            light.append(kernels.sum_by(index, light[-1], size=found.size))
            parents.append(index)
        residual = [kernels.noise_of_cells(surface[0], light[0])]
        for index, found in zip(parents, keys[1:], strict=True):
            residual.append(kernels.sum_by(index, residual[-1], size=found.size))
        top = LEVELS - 1
        shading = kernels.mean_shading(surface[top], light[top]) if around is None else np.zeros(light[top].shape[:2])
        levels = [shading]
        for level in range(top - 1, -1, -1):
            pool_level, pool = level + 1, parents[level]
            while pool_level < min(level + POOL, top):
                pool, pool_level = parents[pool_level][pool], pool_level + 1
            shading = shading[parents[level]]
            if around is None or level >= SIGNIFICANT_LEVEL:
                sigmas = 0.0 if around is None else SIGNIFICANT
                pooled = surface[pool_level], residual[pool_level]
                shading = kernels.shrink(surface[level], light[level], shading, pool, *pooled, sigmas)
            levels.insert(0, shading)
        every_key, every_shading = np.concatenate(keys), np.concatenate(levels).astype(np.float32)
        field = ShadingField(kernels.index_keys(every_key), every_key, every_shading)
        if around is None:
            return field
        return ShadingField(around.slots, around.keys, np.maximum(around.shading + field.find(around.keys), 0))

    def _make_room(self, cells: int) -> None:
        """Provide for this many cells, in the arrays and, at most half full, in the table."""
        if cells > self._keys.size:
            more = max(cells, 2 * self._keys.size) - self._keys.size
            self._keys, self._surface, self._light = (
                np.concatenate([array, np.zeros((more, *array.shape[1:]), dtype=array.dtype)])
                for array in (self._keys, self._surface, self._light)
            )
        if 2 * cells > self._slots.size:
            self._slots = kernels.index_keys(self._keys[: self.count], room=cells)


@dataclass(frozen=True)
class ShadingField:
    """The shading of every cell of every width, float32 (cell, light), found by the cells' keys."""

    slots: np.ndarray
    keys: np.ndarray
    shading: np.ndarray

    def find(self, keys: np.ndarray) -> np.ndarray:
        """Return the shading of cells, or of the smallest known one round each, else 0: float32 (cell, light)."""
        return kernels.find_shading(self.slots, self.keys, self.shading, keys)

    def reflect(self, hits: SurfaceHits, *, first: int, seed: int) -> np.ndarray:
        """Return the radiance that surfaces reflect to rays, float32 (light, ray); 0 where nothing is known.

        Each ray looks its shading up at a place that is moved at random by up to half a cell, so that cells blend into
        each other. ``first`` is the number of the first ray among all; it and ``seed`` name the random numbers.
        """
        out = np.zeros((self.shading.shape[1], hits.shape.size), dtype=np.float32)
        kernels.reflect(
            self.slots, self.keys, self.shading, out, np.uint64(first), np.uint64(seed & 0xFFFFFFFF), *hits[:7]
        )
        return out
