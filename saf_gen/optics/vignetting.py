"""Vignetting: a ring in front of the lens through which rays from the edge of the picture pass only in part.

A ray that meets the lens at a, with the slope s in object space, meets the plane of the ring at a + s·d, and passes if
that is within the ring's radius r. Whether it passes does not depend on the position of the drive, as long as lens and
ring stay together and the ray stays where it is: for ``image_distance`` and ``focal_length``.

Seen from a point x of the sensor, with the plane at the distance u in focus, s = -(x/v + a/u). The ring is then a disc
in the plane of the aperture, of the radius r/(1 - d/u) about x·(d/v)/(1 - d/u). What is left of the light is the
overlap of this disc with the aperture, divided by the aperture. Out of focus, a point far from the middle is spread
over the overlap, which looks like a cat's eye, and not over a disc.

References
----------
W. J. Smith, Modern Optical Engineering, 4th edition (2008), section 9.3 (vignetting).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Ring:
    """A ring in front of the lens.

    Attributes
    ----------
    radius_m : float
        Radius r of its opening, metres.
    distance_m : float
        Distance d from the lens, towards the scene, metres.
    """

    radius_m: float
    distance_m: float

    def passes(self, a: tuple[Any, Any], slope: tuple[Any, Any], *, number: Any = float) -> Any:
        """Return whether rays pass the ring, which meet the lens at a (m) with a slope in object space.

        ``a`` and ``slope`` are pairs of numpy arrays, or arrays of Dr.Jit; ``number`` is called with each coefficient,
        so that a kernel may read it as an input.
        """
        distance, radius = number(self.distance_m), number(self.radius_m)
        x, y = a[0] + slope[0] * distance, a[1] + slope[1] * distance
        return x * x + y * y <= radius * radius

    def relative_illumination(
        self,
        height_m: np.ndarray | float,
        *,
        aperture_radius_m: float,
        image_distance_m: float,
        object_distance_m: float,
    ) -> np.ndarray:
        """Return the share of the light that passes to points of the sensor, 0 to 1, in focus.

        Parameters
        ----------
        height_m : ndarray or float
            Distance of the points from the middle of the sensor, metres.
        aperture_radius_m, image_distance_m, object_distance_m : float
            Radius of the aperture, distance from the lens to the sensor, and to the plane in focus, metres.
        """
        shrinks = 1 - self.distance_m / object_distance_m
        centre = np.asarray(height_m, np.float64) * (self.distance_m / image_distance_m) / shrinks
        return overlap_of_discs(aperture_radius_m, self.radius_m / shrinks, distance=centre) / (
            math.pi * aperture_radius_m**2
        )


def overlap_of_discs(one: float, other: float, *, distance: np.ndarray | float) -> np.ndarray:
    """Return the area that two discs of these radii have in common, if their centres are ``distance`` apart.

    All three have the same unit. It is the sum of two circular segments.
    """
    apart = np.clip(np.asarray(distance, np.float64), abs(one - other), one + other)
    apart = np.where(apart > 0, apart, max(one, other))  # the same disc twice: any chord will do
    near = (apart**2 + one**2 - other**2) / (2 * apart)

    def segment(radius: float, chord: np.ndarray) -> np.ndarray:
        cosine = np.clip(chord / radius, -1, 1)
        return radius**2 * (np.arccos(cosine) - cosine * np.sqrt(1 - cosine**2))

    area = segment(one, near) + segment(other, apart - near)
    distance = np.asarray(distance, np.float64)
    area = np.where(distance < one + other, area, 0.0)
    return np.where(distance <= abs(one - other), math.pi * min(one, other) ** 2, area)
