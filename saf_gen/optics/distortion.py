"""Distortion: a lens that shows points in the wrong place, farther from the middle (pincushion) or nearer (barrel).

A point that is seen at the distance x from the middle of the sensor would be at x·(1 - D·(x/h)²) without distortion; D
is the share by which it is displaced at the height h. That is Seidel's fifth sum, W311·(η·η)(η·ρ), whose gradient over
the aperture is the same for all rays to a point: it turns them alike, and blurs nothing.

Rays are turned in front of the lens, as by the other aberrations (:mod:`saf_gen.optics.wavefront`), by an angle that
depends on the direction in which they leave the lens through its centre. So a lens that moves as a whole keeps its
distortion, and pictures of all positions are scaled copies. Light on the sensor is that of a lens without distortion,
which spreads an even scene evenly, as radiance does not change along a ray.

References
----------
W. T. Welford, "Aberrations of Optical Systems" (1986), chapter 7.
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Distortion:
    """Third-order distortion of a lens.

    Attributes
    ----------
    share : float
        D, the share by which a point at the height is displaced outwards; below 0 inwards.
    height_m : float
        Distance h from the middle of the sensor, metres.
    image_distance_m : float
        Distance (m) from lens to sensor at which the height is stated: that of the middle of the travel.
    """

    share: float
    height_m: float
    image_distance_m: float

    @property
    def per_slope_squared(self) -> float:
        """D·(v/h)², by which the square of a slope is multiplied."""
        return self.share * (self.image_distance_m / self.height_m) ** 2

    def turn(self, slope: tuple[Any, Any], *, number: Any = float) -> tuple[Any, Any]:
        """Return what is added to slopes in object space along x and y, given those of the perfect lens.

        ``slope`` is a pair of numpy arrays, or arrays of Dr.Jit: the slope of the ray through the centre of the lens
        that meets the sensor in the same point. ``number`` is called with the coefficient, so that a kernel may read it
        as an input.
        """
        factor = number(-self.per_slope_squared) * (slope[0] * slope[0] + slope[1] * slope[1])
        return slope[0] * factor, slope[1] * factor

    def folds(self, largest_slope: float) -> bool:
        """Return whether points at different heights are seen in one place, up to the slope of the picture's corner."""
        return 3 * self.per_slope_squared * largest_slope**2 >= 1
