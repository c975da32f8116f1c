"""The rays of a real lens as polynomials, fitted to rays traced through its surfaces.

A ray behind the lens is known by the point of the exit pupil from which it comes and by its slope. Both are the same
wherever the sensor is, so the polynomials hold at every position of a lens that moves as a whole. They give the point b
of the entrance pupil and the slope s with which that ray starts in front of the lens,

    b = a + R·(P1·α + P2·β),    s = m·(slope behind) - m·a/f + q·(P3·α + P4·β),

where a is the point of the exit pupil divided by the pupils' magnification m, so that b = a for rays near the axis,
α = a/R, β = ((slope behind) - a/f)/q, and P1 to P4 are polynomials in α·α, α·β and β·β: a round lens has no others.
The slope behind is (a - x/m)/V for a sensor at V = (distance from exit pupil to sensor)/m. With P = 0 this is a thin
lens whose pupils lie apart (:class:`saf_gen.optics.FittedLensDrive`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebval2d, chebvander

NODES, WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(8)[1])


def monomials(order: int) -> list[tuple[int, int, int]]:
    """Return the exponents of α·α, α·β and β·β of a polynomial of this order, in the order of its coefficients."""
    return [(i, j, k) for i in range(order + 1) for j in range(order + 1 - i) for k in range(order + 1 - i - j)]


def powers(order: int, invariants: tuple[Any, Any, Any]) -> list[Any]:
    """Return the monomials of a polynomial, for arrays of numpy or Dr.Jit."""
    rows = []
    for invariant in invariants:
        row = [1.0]
        for _ in range(order):
            row.append(row[-1] * invariant)
        rows.append(row)
    return [rows[0][i] * (rows[1][j] * rows[2][k]) for i, j, k in monomials(order)]


@dataclass(frozen=True)
class FittedRays:
    """The polynomials of a lens at one wavelength.

    Attributes
    ----------
    focal_length_m : float
        Focal length f of the lens near its axis at the wavelength at which it is described, metres.
    pupil_magnification : float
        m, the exit pupil divided by the entrance pupil.
    radius_m : float
        R, the radius of the entrance pupil within which the polynomials hold, metres.
    height_m : float
        Distance from the middle of the sensor up to which they hold, metres.
    slope : float
        q, the largest β.
    order : int
        Order of P1 to P4; rays are polynomials of degree 2·order + 1.
    starts, slopes : tuple of float
        Coefficients of P1 and then of P2, and of P3 and then of P4, in the order of :func:`monomials`.
    residual_m : float, default 0
        Largest distance on the sensor between fitted rays and those of the lens, metres.
    """

    focal_length_m: float
    pupil_magnification: float
    radius_m: float
    height_m: float
    slope: float
    order: int
    starts: tuple[float, ...]
    slopes: tuple[float, ...]
    residual_m: float = 0.0

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "FittedRays":
        """Return the rays that ``dataclasses.asdict`` described, also after a round trip through JSON."""
        fields: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in data.items()}
        return cls(**fields)

    def turn(
        self, a: tuple[Any, Any], x: tuple[Any, Any], *, image_distance_m: Any
    ) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Return by how much rays differ from those of the thin lens with these pupils.

        Parameters
        ----------
        a, x : tuple of two arrays
            Points of the lens and of the sensor, metres from their middles: numpy arrays, or arrays of Dr.Jit.
        image_distance_m : float or array
            V, the image distance of the drive, metres.

        Returns
        -------
        tuple of two tuples of two arrays
            What is added to the point (m) at which a ray starts, and to its slope, along x and along y.
        """
        per_radius, per_slope = 1 / self.radius_m, 1 / self.slope
        alpha = a[0] * per_radius, a[1] * per_radius
        beta = tuple(
            ((at - on * (1 / self.pupil_magnification)) / image_distance_m - at * (1 / self.focal_length_m)) * per_slope
            for at, on in zip(a, x, strict=True)
        )
        invariants = (
            alpha[0] * alpha[0] + alpha[1] * alpha[1],
            alpha[0] * beta[0] + alpha[1] * beta[1],
            beta[0] * beta[0] + beta[1] * beta[1],
        )
        terms = powers(self.order, invariants)
        found = []
        for coefficients, scale in ((self.starts, self.radius_m), (self.slopes, self.slope)):
            by_alpha, by_beta = (
                sum(float(c) * term for c, term in zip(half, terms, strict=True))
                for half in (coefficients[: len(terms)], coefficients[len(terms) :])
            )
            found.append(tuple((by_alpha * alpha[n] + by_beta * beta[n]) * scale for n in (0, 1)))
        return found[0], found[1]

    def seen_from(self, depth_m: float, image_distance_m: float) -> "SeenWavefront":
        """Return the aberrations of a point at this distance (m) in front of the lens, for a sensor at V (m)."""
        return SeenWavefront(self, float(depth_m), float(image_distance_m))


@dataclass(frozen=True)
class SeenWavefront:
    """The aberrations of a fitted lens as a point at one depth shows them, with a sensor at one distance.

    It stands where a :class:`saf_gen.optics.Wavefront` may stand in :mod:`saf_gen.optics.texture_contrast`. The slope
    ∇W = Δs + Δb/d is that of a thin lens whose rays pass the point where those of the lens pass it.
    """

    rays: FittedRays
    depth_m: float
    image_distance_m: float
    varies_over_field = True

    @property
    def height_m(self) -> float:
        """Distance from the middle of the sensor up to which the lens is known, metres."""
        return self.rays.height_m

    def slope(self, a: tuple[Any, Any], x: tuple[Any, Any]) -> tuple[Any, Any]:
        """Return ∇W along x and y for points of the lens and of the sensor, metres from their middles."""
        moved, turned = self.rays.turn(a, x, image_distance_m=self.image_distance_m)
        return turned[0] + moved[0] / self.depth_m, turned[1] + moved[1] / self.depth_m

    def path(self, a: tuple[Any, Any], x: tuple[float, float]) -> np.ndarray:
        """Return W in metres at points of the lens, for one of the sensor: ∇W along the line from the lens's centre.

        Rays are polynomials in the point of the lens, so W is one, too, and is found once for each point of the sensor.
        """
        per_radius = 1 / self.rays.radius_m
        across, along = np.broadcast_arrays(a[0] * per_radius, a[1] * per_radius)
        return np.asarray(chebval2d(across, along, _path_series(self, sensor_m=(float(x[0]), float(x[1])))))

    def largest_path(self, radius_m: float, height_m: float) -> float:
        """Return the largest |W| in metres, without its tilt, over an aperture and a picture of these radii."""
        return _largest_path(self, radius_m=radius_m, height_m=height_m)


@lru_cache(maxsize=1024)
def _path_series(seen: SeenWavefront, *, sensor_m: tuple[float, float]) -> np.ndarray:
    """Return W for a point of the sensor as a Chebyshev series in the point of the lens over R, float64 (n, n).

    It is interpolated at Chebyshev's nodes, which is exact for a polynomial of its degree, 2·order + 2.
    """
    degree = 2 * seen.rays.order + 2
    nodes = chebpts1(degree + 1)
    grid = np.meshgrid(nodes * seen.rays.radius_m, nodes * seen.rays.radius_m, indexing="ij")
    total = np.zeros_like(grid[0])
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        slope = seen.slope((node * grid[0], node * grid[1]), sensor_m)
        total += weight * (grid[0] * slope[0] + grid[1] * slope[1])
    back = np.linalg.inv(chebvander(nodes, degree))
    return np.asarray(back @ total @ back.T)


@lru_cache(maxsize=256)
def _largest_path(seen: SeenWavefront, *, radius_m: float, height_m: float) -> float:
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    r, angle = (grid.ravel() for grid in np.meshgrid(np.linspace(0, radius_m, 6)[1:], angle))
    a, largest = (r * np.cos(angle), r * np.sin(angle)), 0.0
    for height in np.linspace(0, min(height_m, seen.height_m), 5):
        path = seen.path(a, (float(height), 0.0))
        tilt = np.linalg.lstsq(np.stack(a, axis=1), path, rcond=None)[0]
        largest = max(largest, float(np.abs(path - np.stack(a, axis=1) @ tilt).max()))
    return largest
