"""Waves at the aperture: each path is bent where it passes the lens (Heisenberg uncertainty ray bending).

The aperture is round and has the radius R. The position of a path that passes it at a distance r from its centre is
known to within the distance d to the edge: d is R - r along the radius, and √(R² - r²), half the chord, across it. The
angle of the path behind the lens is then uncertain by σ = λ/(4π·d) rad in each of these directions. The bend moves the
point where the path meets the sensor by v·angle. It does not change the light that the path carries, which depends on
the slope in front of the lens. The image distance v is linear in the position for every drive, so a bent path is still
a straight line through the stack.

The exact optical transfer shows what this approximates. At the frequency ν it is the mean over the lens of the
geometric phase, taken over the points whose two neighbours at ±λνv/2 are both in the aperture (the ambiguity function
of a disc: Brenner et al. 1983). Each point of the lens thus has its own transfer, which is 1 up to the frequency at
which a neighbour leaves the aperture, 2d/(λv) along the radius and across it, and 0 beyond. Paths cannot have negative
weights, and so cannot have a transfer that sharp; a spread of directions with the standard deviation σ falls off at the
same frequency. Angles are drawn evenly from the ellipse with the semi-axes 2σ. Below the Nyquist frequency of pixels of
20 µm, for 555 nm and 0 to 1.5 wavelengths of defocus, the transfer is then within 0.039 of the exact one at R/v =
0.024, and within 0.052 at 0.015. With normally distributed angles of the same σ it would be within 0.042 and 0.074;
without bending it is 0.36 and 0.57 off. An ellipse is also bounded: no path is bent by more than 2σ.

At the edge σ grows without bound. The distances are therefore taken to be at least d_min, which is a twentieth of R, or
less if a path bent there would move by less than a pixel. The largest move, λ·v/(2π·d_min), is the width by which the
guard band grows. No light is lost in this way: the tenth of the paths that pass nearer to the edge are bent as if they
passed at d_min, and the 3 % of the light that Airy's rings carry farther than 3.2·λ·v/R stays within that distance.

References
----------
E. R. Freniere, G. G. Gregory and R. A. Hassler, "Edge diffraction in Monte Carlo ray tracing", Proc. SPIE 3780, 151
(1999), doi:10.1117/12.363773.
K.-H. Brenner, A. W. Lohmann and J. Ojeda-Castañeda, "The ambiguity function as a polar display of the OTF", Opt.
Commun. 44, 323 (1983), doi:10.1016/0030-4018(83)90221-4.
"""

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from saf_gen.optics import Drive
from saf_gen.render.ray_sampling import place_by_kronecker
from saf_gen.stack.focal_stack import PixelGrid

NEAREST_EDGE = 0.05  # of the radius: paths nearer to the edge are bent as if they passed at this distance
# Two dimensions of a Kronecker sequence: powers of the root of x^3 = x + 1, in 0.32 fixed point. Together with 1 they
# are independent over the rational numbers.
PLASTIC = 1.324717957244746
BEND_STEPS = tuple(round(PLASTIC ** -(j + 1) * 2**32) & 0xFFFFFFFF for j in range(2))
FIRST_DIMENSION = 4  # after those of pixel and lens


@dataclass(frozen=True)
class ApertureWaves:
    """Light of one wavelength at the aperture of a lens.

    Attributes
    ----------
    wavelength_m : float
        Wavelength λ, above 0.
    radius_m : float
        Radius R of the aperture.
    nearest_edge_m : float
        d_min, the smallest distance to the edge for which a bend is drawn.
    reach_m : float
        Largest move of a path on the sensor.
    """

    wavelength_m: float
    radius_m: float
    nearest_edge_m: float
    reach_m: float

    def bend(self, lens_point: Any, even: Any) -> Any:
        """Return the small angles by which paths are bent at points of the aperture.

        Parameters
        ----------
        lens_point : mi.Point2f
            Point in metres from the lens's centre; points outside the aperture count as if they were on its edge.
        even : mi.Point2f
            Points spread evenly over the unit square, from which the angles are drawn.

        Returns
        -------
        mi.Vector2f
            Angles along x and y, in radians.
        """
        # Numbers that the kernel reads; if they were constants, every lens would need a separate kernel.
        radius, nearest, doubled = (
            dr.opaque(mi.Float, number)
            for number in (self.radius_m, self.nearest_edge_m, self.wavelength_m / (2 * math.pi))
        )
        r = dr.norm(lens_point)  # finite, as all below is, because ``nearest`` is above 0
        outward = dr.select(r > 0, mi.Vector2f(lens_point) / r, mi.Vector2f(1, 0))
        inside = dr.maximum(radius - r, 0)
        along, across = dr.maximum(inside, nearest), dr.maximum(dr.sqrt(inside * (radius + r)), nearest)
        in_disc = mi.warp.square_to_uniform_disk_concentric(even) * doubled  # 2σ = λ/(2π·d)
        radial, tangential = in_disc.x / along, in_disc.y / across
        return mi.Vector2f(outward.x * radial - outward.y * tangential, outward.y * radial + outward.x * tangential)


def find_waves(
    drive: Drive, grid: PixelGrid, *, wavelength_m: float, ends: tuple[float, float] = (0.0, 1.0)
) -> ApertureWaves | None:
    """Return the waves at the aperture for positions between ``ends``, or None if the wavelength is 0."""
    if not wavelength_m:
        return None
    radius = drive.aperture_radius_m
    farthest = float(np.max(drive.image_distance(np.array(ends))))
    one_pixel = wavelength_m * farthest / (2 * math.pi * grid.pitch_m)
    nearest = min(NEAREST_EDGE * radius, one_pixel)
    return ApertureWaves(wavelength_m, radius, nearest, wavelength_m * farthest / (2 * math.pi * nearest))


def place_bends(pixel: Any, sample: Any, *, seed: int) -> Any:
    """Return the point of the unit square (mi.Point2f) from which each sample's bend is drawn.

    The points depend on pixel, sample and seed alone. Together with the positions in the pixel and on the lens, they
    are spread evenly.
    """
    across, down = place_by_kronecker(pixel, sample, steps=BEND_STEPS, seed=seed + FIRST_DIMENSION)
    return mi.Point2f(across, down)
