"""The third-order aberrations of a lens: how far the waves that leave it depart from spheres.

W(a, x) is the optical path (m) by which a ray through the point a of the lens, bound for the point x of the sensor, is
longer than the ray through the centre of the lens. With ρ = a/R0 and η = x/h0 it is Seidel's sum

    W = W040·(ρ·ρ)² + W131·(η·ρ)(ρ·ρ) + W222·(η·ρ)² + W220·(η·η)(ρ·ρ)

for spherical aberration, coma, astigmatism and field curvature. R0 is the radius of the aperture for which the
coefficients are stated, and h0 the distance from the middle of the sensor. A smaller aperture uses a smaller part of
the same waves. Defocus is W020·(ρ·ρ) with W020 = R0²/2·(1/u_o - 1/u), so a positive W220 focuses the corner as if it
were nearer to the lens than it is.

A ray is perpendicular to its wave, so W turns it by ∇W, the gradient over a. In this package the turn is put in front
of the lens: the ray that meets the sensor at x and the lens at a has the slope s = -(x/v + a/u) + ∇W in object space.
Behind the lens nothing changes, so one path serves every position as it does for a perfect lens. A lens that moves as a
whole (``image_distance``) keeps its aberrations exactly: behind its last surface a ray is a straight line, wherever the
sensor is. For ``focal_length`` W is taken to be the same at all positions, and for ``stage`` to be that of the position
halfway (:meth:`Wavefront.stage_residual`).

References
----------
W. T. Welford, "Aberrations of Optical Systems" (1986), chapter 7, for the sum.
"""

from dataclasses import dataclass
from typing import Any

from saf_gen.errors import BadInput

COEFFICIENTS = ("spherical_m", "coma_m", "astigmatism_m", "field_curvature_m")


@dataclass(frozen=True)
class Wavefront:
    """Aberrations of a lens, as the optical path at the edge of its aperture.

    Attributes
    ----------
    spherical_m, coma_m, astigmatism_m, field_curvature_m : float
        W040, W131, W222 and W220, in metres.
    radius_m : float
        Radius R0 of the aperture at whose edge they hold, metres.
    height_m : float
        Distance h0 from the middle of the sensor at which they hold, metres.

    Raises
    ------
    BadInput
        If all are 0, which is a lens without a wavefront.
    """

    spherical_m: float = 0.0
    coma_m: float = 0.0
    astigmatism_m: float = 0.0
    field_curvature_m: float = 0.0
    radius_m: float = 1.0
    height_m: float = 1.0

    def __post_init__(self) -> None:
        if not any(getattr(self, name) for name in COEFFICIENTS):
            raise BadInput("all aberrations are 0", hint="leave aberrations out")

    @property
    def varies_over_field(self) -> bool:
        """Whether the aberrations differ between the middle of the picture and its corner."""
        return bool(self.coma_m or self.astigmatism_m or self.field_curvature_m)

    def path(self, a: tuple[Any, Any], x: tuple[Any, Any]) -> Any:
        """Return W in metres for points of the lens and of the sensor, both in metres from their middles."""
        rho, eta = self._relative(a, x)
        squared, along = rho[0] * rho[0] + rho[1] * rho[1], eta[0] * rho[0] + eta[1] * rho[1]
        field = eta[0] * eta[0] + eta[1] * eta[1]
        spherical = self.spherical_m * squared + self.coma_m * along + self.field_curvature_m * field
        return spherical * squared + self.astigmatism_m * along * along

    def slope(self, a: tuple[Any, Any], x: tuple[Any, Any], *, number: Any = float) -> tuple[Any, Any]:
        """Return ∇W, by which rays in front of the lens are turned, along x and y (a slope, without unit).

        Parameters
        ----------
        a, x : tuple of two arrays
            Points of the lens and of the sensor, metres from their middles: numpy arrays, or arrays of Dr.Jit.
        number : callable, optional
            Called with each coefficient, so that a kernel may read it as an input.
        """
        radius = number(1 / self.radius_m)
        rho, eta = self._relative(a, x, number=number)
        squared, along = rho[0] * rho[0] + rho[1] * rho[1], eta[0] * rho[0] + eta[1] * rho[1]
        field = eta[0] * eta[0] + eta[1] * eta[1]
        spherical, coma, astigmatism, curvature = (number(getattr(self, name)) for name in COEFFICIENTS)
        radial = 4 * spherical * squared + 2 * coma * along + 2 * curvature * field
        towards = coma * squared + 2 * astigmatism * along
        return (radial * rho[0] + towards * eta[0]) * radius, (radial * rho[1] + towards * eta[1]) * radius

    def largest_path(self, radius_m: float, height_m: float) -> float:
        """Return a bound of |W| in metres, over an aperture and a picture of these radii."""
        r, h = radius_m / self.radius_m, height_m / self.height_m
        powers = (r**4, h * r**3, (h * r) ** 2, (h * r) ** 2)
        return float(sum(abs(getattr(self, name)) * power for name, power in zip(COEFFICIENTS, powers, strict=True)))

    def _relative(self, a: tuple[Any, Any], x: tuple[Any, Any], *, number: Any = float) -> tuple[Any, Any]:
        radius, height = number(1 / self.radius_m), number(1 / self.height_m)
        return (a[0] * radius, a[1] * radius), (x[0] * height, x[1] * height)
