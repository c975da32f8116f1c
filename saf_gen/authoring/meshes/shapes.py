"""What a mesh file holds: shapes of triangles with their surfaces, and what was left out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from saf_gen.errors import BadInput

GREY = (0.6, 0.6, 0.6)
"""Reflectance of a surface for which a file states no colour."""
MAX_SHAPES, MAX_CORNERS = 1_000, 30_000_000
MAX_SIDES = 400
"""Largest number of sides of a polygon that is not convex; its triangulation takes time in proportion to the cube."""
HUGE = 1e30
"""Limit of all numbers: single precision, in which Mitsuba computes, ends at 3·10³⁸."""
NAMED = 6  # shapes that a line names; the others are counted


@dataclass(frozen=True)
class Surface:
    """The matt colour, opacity and emission of a surface.

    Attributes
    ----------
    colour : tuple of float
        Linear red, green and blue, 0 to 1; a factor of the picture and of the colours of vertices.
    picture : ndarray or None
        sRGB-coded colours and opacity, uint8 (rows, columns, 4). Its first row is at v = 0.
    opacity : float
        Factor of the opacity of the picture and of the vertices.
    alpha : {'opaque', 'mask', 'blend'}
        Whether opacity is ignored, compared with the cutoff, or used.
    cutoff : float
        Smallest opacity of what is shown by 'mask'.
    emission : tuple of float
        Radiance of its own light in red, green and blue, in W m⁻² sr⁻¹; a factor of the emission's picture.
    emission_picture : ndarray or None
        sRGB-coded colours, uint8 (rows, columns, 4).
    wrap : {'repeat', 'mirror', 'clamp'}
        What is shown outside the picture.
    smooth : bool
        Whether colours between texels are interpolated.
    """

    colour: tuple[float, float, float] = GREY
    picture: np.ndarray | None = None
    opacity: float = 1.0
    alpha: Literal["opaque", "mask", "blend"] = "opaque"
    cutoff: float = 0.5
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emission_picture: np.ndarray | None = None
    wrap: Literal["repeat", "mirror", "clamp"] = "repeat"
    smooth: bool = True


@dataclass(frozen=True)
class Shape:
    """Triangles with one surface.

    Attributes
    ----------
    name : str
        Name in the file.
    points : ndarray
        Coordinates of the vertices, float64 (vertex, 3), in units of the file.
    triangles : ndarray
        Vertices of each triangle, counter-clockwise seen from outside, int64 (triangle, 3).
    surface : Surface
        The surface.
    normals : ndarray or None
        Normals of the vertices, float64 (vertex, 3).
    uv : ndarray or None
        Texture coordinates, float64 (vertex, 2); v points down in the picture.
    colours : ndarray or None
        Linear colours and opacity of the vertices, float64 (vertex, 4).
    flat : bool
        Whether triangles are shaded as planes; otherwise, missing normals are interpolated.
    """

    name: str
    points: np.ndarray
    triangles: np.ndarray
    surface: Surface = field(default_factory=Surface)
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None
    colours: np.ndarray | None = None
    flat: bool = False


class LeftOut:
    """What a reader leaves out of a file, as lines for the user: each kind once, with the names of its shapes."""

    def __init__(self) -> None:
        self._names: dict[str, dict[str, None]] = {}

    def add(self, kind: str, name: str = "") -> None:
        """Add a kind, such as "clearcoat ignored", and the name of the shape or material that has it."""
        self._names.setdefault(kind, {}).update({name: None} if name else {})

    def lines(self) -> list[str]:
        """Return a line for each kind."""
        return [f"{kind}: {_listed(list(names))}" if names else kind for kind, names in self._names.items()]


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(" ".join(name[:80].split()) for name in names[:NAMED]) + more


def checked(shape: Shape, left_out: LeftOut, *, path: Path) -> Shape:
    """Return a shape with finite values, existing vertices that its triangles use, and usable normals.

    Raises BadInput if a value is not finite, a triangle names a vertex that does not exist, or an emission is negative.
    """
    of = f" of {shape.name!r}" if shape.name else ""
    count = len(shape.points)
    values: Mapping[str, np.ndarray | None] = {
        "coordinate": shape.points,
        "normal": shape.normals,
        "texture coordinate": shape.uv,
        "colour": shape.colours,
    }
    for what, array in values.items():
        if array is not None and not (np.abs(array) < HUGE).all():
            raise BadInput(f"a {what}{of} is not a finite number", where=str(path), hint="export it again")
    glow = shape.surface.emission
    if not all(0 <= radiance < HUGE for radiance in glow):
        said = " ".join(f"{radiance:.6g}" for radiance in glow)
        raise BadInput(f"the emission{of} is {said}", where=str(path), allowed="0 or more", hint="correct its material")
    if shape.triangles.size and not (shape.triangles.min() >= 0 and shape.triangles.max() < count):
        low, high = int(shape.triangles.min()), int(shape.triangles.max())
        raise BadInput(
            f"a face{of} names the vertex {low if low < 0 else high}, but the number of vertices is {count}",
            where=str(path),
            hint="export it again",
        )
    used, triangles = np.unique(shape.triangles, return_inverse=True)
    if used.size < count:
        uv, normals, colours = (None if a is None else a[used] for a in (shape.uv, shape.normals, shape.colours))
        shape = replace(
            shape,
            points=shape.points[used],
            triangles=triangles.reshape(-1, 3),
            uv=uv,
            normals=normals,
            colours=colours,
        )
    if shape.normals is not None:
        length = np.linalg.norm(shape.normals, axis=1, keepdims=True)
        if (length < 1e-12).any():
            left_out.add("normals ignored, some have no length", shape.name)
            return replace(shape, normals=None)
        return replace(shape, normals=shape.normals / length)
    return shape


def triangulate(points: np.ndarray, counts: np.ndarray, *, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Split polygons into triangles.

    Convex polygons become a fan around their first corner; others are cut ear by ear in their mean plane.

    Parameters
    ----------
    points : ndarray
        Coordinates of all corners of all polygons, float64 (corner, 3).
    counts : ndarray
        Number of corners of each polygon, int64 (polygon,).
    path : Path
        The file, for messages.

    Returns
    -------
    corners, polygons : ndarray
        Corners of each triangle, int64 (triangle, 3), and its polygon, int64 (triangle,).

    Raises
    ------
    BadInput
        If a polygon is not convex and has more than MAX_SIDES sides.
    """
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]) if counts.size else counts
    corners, polygons = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for sides in np.unique(counts[counts >= 3]):
        of = np.flatnonzero(counts == sides)
        at = starts[of][:, None] + np.arange(sides)
        fan = np.stack([at[:, [0] * (sides - 2)], at[:, 1:-1], at[:, 2:]], axis=-1)
        if sides > 3:
            for k in np.flatnonzero(~_convex(points[at])):
                fan[k] = at[k][_cut_ears(points[at[k]], path)]
        corners.append(fan.reshape(-1, 3))
        polygons.append(np.repeat(of, sides - 2))
    return np.concatenate(corners), np.concatenate(polygons)


def _convex(rings: np.ndarray) -> np.ndarray:
    """Return which polygons (polygon, side, 3) turn in one direction at every corner."""
    edges = np.roll(rings, -1, axis=1) - rings
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    normal = turns.sum(axis=1, keepdims=True)
    along = (turns * normal).sum(axis=-1)
    return np.asarray((along >= -1e-9 * np.abs(along).max(axis=1, keepdims=True)).all(axis=1))


def _cut_ears(ring: np.ndarray, path: Path) -> np.ndarray:
    """Return the triangles of a polygon (side, 3) that is not convex, int64 (side - 2, 3)."""
    if len(ring) > MAX_SIDES:
        raise BadInput(
            f"a face has {len(ring)} sides and is not convex",
            where=str(path),
            allowed=f"up to {MAX_SIDES} sides",
            hint="export it with triangles",
        )
    following = np.roll(ring, -1, axis=0)
    normal = np.cross(ring - ring[0], following - ring[0]).sum(axis=0)
    drop = int(np.abs(normal).argmax())
    flat = np.delete(ring, drop, axis=1) * ([1, 1] if (normal[drop] > 0) == (drop != 1) else [1, -1])
    left, found = list(range(len(ring))), []
    while len(left) > 3:
        ears = (k for k in range(len(left)) if _is_ear(flat[left], k))
        k = next(ears, 0)  # a polygon that crosses itself may have none
        found.append([left[k - 1], left[k], left[(k + 1) % len(left)]])
        del left[k]
    return np.array([*found, left])


def _is_ear(ring: np.ndarray, k: int) -> bool:
    """Return whether corner k of a polygon (side, 2) is convex and its triangle holds no other corner."""
    triangle = ring[[k - 1, k, (k + 1) % len(ring)]]
    if _area(triangle[:2], triangle[2]) <= 0:
        return False
    others = np.delete(ring, [k, k - 1 if k else len(ring) - 1, (k + 1) % len(ring)], axis=0)
    inside = [_area(triangle[[n, (n + 1) % 3]], others) >= 0 for n in range(3)]
    return not (inside[0] & inside[1] & inside[2]).any()


def _area(side: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Return twice the signed area of triangles on a side (2, 2), by their third corners (..., 2)."""
    (a, b), c = side, corner
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))


def srgb_to_linear(coded: np.ndarray) -> np.ndarray:
    """Return linear values of sRGB-coded ones, both 0 to 1 (IEC 61966-2-1)."""
    return np.asarray(np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4))
