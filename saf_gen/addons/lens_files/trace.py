"""Rays through the surfaces of a lens, one surface after the other: exact, and slow beside the polynomials of ``fit``.

References
----------
G. H. Spencer and M. V. R. K. Murty, "General ray-tracing procedure", J. Opt. Soc. Am. 52, 672 (1962),
doi:10.1364/JOSA.52.000672.
"""

from typing import NamedTuple

import numpy as np

from saf_gen.addons.lens_files.prescription import Prescription, Surface

STEPS, CLOSE_MM = 40, 1e-11  # of Newton's method, which finds where a ray meets an asphere


class Rays(NamedTuple):
    """Rays in one plane across the axis.

    Attributes
    ----------
    place : ndarray of float64, shape (2, ray)
        Where they meet the plane, mm; nan for rays that do not pass the lens.
    slope : ndarray of float64, shape (2, ray)
        dx/dz and dy/dz.
    """

    place: np.ndarray
    slope: np.ndarray

    def at(self, forward_mm: float) -> "Rays":
        """Return the same rays in a plane that is ``forward_mm`` farther along +z."""
        return Rays(self.place + forward_mm * self.slope, self.slope)


def reverse(lens: Prescription) -> tuple[tuple[Surface, ...], np.ndarray]:
    """Return the surfaces of the lens turned round, as light from the sensor meets them, and their places, mm.

    The first is at 0. Media are those in front of each surface and do not turn by themselves: see ``trace_back``.
    """
    last = lens.vertices_mm[-1]
    turned = tuple(
        Surface(-one.curvature, 0.0, conic=one.conic, powers=tuple(-a for a in one.powers))
        for one in reversed(lens.surfaces)
    )
    return turned, last - lens.vertices_mm[::-1]


def trace_forward(lens: Prescription, rays: Rays, *, wavelength_nm: float) -> tuple[Rays, np.ndarray]:
    """Trace rays from the plane of the first vertex to the plane of the last, along +z.

    Returns
    -------
    rays : Rays
        Rays in the plane of the last vertex.
    heights : ndarray of float64, shape (surface, ray)
        Distance from the axis at which each ray meets each surface, mm.
    """
    return _trace(lens.surfaces, lens.vertices_mm, indices=lens.indices(wavelength_nm), rays=rays)


def trace_back(lens: Prescription, rays: Rays, *, wavelength_nm: float) -> tuple[Rays, np.ndarray]:
    """Trace rays from the plane of the last vertex to that of the first; z points from the sensor to the scene.

    Returns
    -------
    rays : Rays
        Rays in the plane of the first vertex.
    heights : ndarray of float64, shape (surface, ray)
        As of :func:`trace_forward`, of the surfaces in the order of the prescription.
    """
    surfaces, places = reverse(lens)
    found, heights = _trace(surfaces, places, indices=lens.indices(wavelength_nm)[::-1], rays=rays)
    return found, heights[::-1]


def _trace(
    surfaces: tuple[Surface, ...], places: np.ndarray, *, indices: np.ndarray, rays: Rays
) -> tuple[Rays, np.ndarray]:
    x, y = np.array(rays.place, dtype=np.float64)
    z = np.zeros_like(x)
    length = np.sqrt(1 + rays.slope[0] ** 2 + rays.slope[1] ** 2)
    way = np.stack([rays.slope[0], rays.slope[1], np.ones_like(length)]) / length
    heights = np.empty((len(surfaces), x.size))
    for n, (surface, place) in enumerate(zip(surfaces, places, strict=True)):
        step = (place - z) / way[2]
        x, y = x + step * way[0], y + step * way[1]
        step = _meet(surface, np.stack([x, y]), way=way)
        x, y, local = x + step * way[0], y + step * way[1], step * way[2]
        z = place + local
        squared = x * x + y * y
        heights[n] = np.sqrt(squared)
        if indices[n] != indices[n + 1]:
            way = _refract(surface, np.stack([x, y]), way=way, ratio=indices[n] / indices[n + 1])
    step = (places[-1] - z) / way[2]
    return Rays(np.stack([x + step * way[0], y + step * way[1]]), way[:2] / way[2]), heights


def _meet(surface: Surface, place: np.ndarray, *, way: np.ndarray) -> np.ndarray:
    """Return how far rays go from the plane of the vertex to the surface, mm; nan if they miss it."""
    c, k = surface.curvature, surface.conic
    x, y = place
    squared = x * x + y * y
    a = c * (way[0] ** 2 + way[1] ** 2 + (1 + k) * way[2] ** 2)
    b = way[2] - c * (x * way[0] + y * way[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        step = c * squared / (b + np.sqrt(b * b - a * c * squared))
        if not any(surface.powers):
            return step
        step = np.where(np.isfinite(step), step, 0.0)
        for _ in range(STEPS):
            px, py = x + step * way[0], y + step * way[1]
            z, by_squared = surface.sag(px * px + py * py)
            off = step * way[2] - z
            step = step - off / (way[2] - 2 * by_squared * (px * way[0] + py * way[1]))
            if not np.nanmax(np.abs(off), initial=0.0) > CLOSE_MM:
                break
        return np.where(np.abs(off) < 1e-6, step, np.nan)


def _refract(surface: Surface, place: np.ndarray, *, way: np.ndarray, ratio: float) -> np.ndarray:
    """Return the directions behind a surface by Snell's law; nan where light is reflected totally."""
    by_squared = surface.sag(place[0] ** 2 + place[1] ** 2)[1]
    normal = np.stack([-2 * by_squared * place[0], -2 * by_squared * place[1], np.ones_like(by_squared)])
    normal = normal / np.sqrt((normal**2).sum(axis=0))
    cosine = (normal * way).sum(axis=0)
    with np.errstate(invalid="ignore"):
        behind = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    return ratio * way + (behind - ratio * cosine) * normal
