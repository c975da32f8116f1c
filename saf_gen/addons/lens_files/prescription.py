"""The prescription of a lens: its surfaces in order, the stop, and the light for which it was designed.

Lengths are in millimetres, as in lens files. Light goes along +z, from the scene to the sensor; a positive curvature
has its centre on the side of the sensor.
"""

import math
from dataclasses import dataclass

import numpy as np

from saf_gen.addons.lens_files.glass import AIR, Glass
from saf_gen.errors import BadInput

MAX_SURFACES = 100


@dataclass(frozen=True)
class Surface:
    """A surface of revolution, z = c·r²/(1 + √(1 - (1 + k)·c²·r²)) + a1·r² + a2·r⁴ + ..., and what follows it.

    Attributes
    ----------
    curvature : float
        c at the vertex, 1/mm; 0 for a plane.
    conic : float
        k; 0 for a sphere.
    powers : tuple of float
        a1, a2, ... in mm⁻¹, mm⁻³, ...
    thickness_mm : float
        Distance to the vertex of the next surface; that of the last surface is not used.
    glass : Glass
        Medium behind the surface.
    semi_diameter_mm : float
        Radius of its clear part; infinite if the file does not say.
    """

    curvature: float
    thickness_mm: float
    glass: Glass = AIR
    conic: float = 0.0
    powers: tuple[float, ...] = ()
    semi_diameter_mm: float = math.inf

    @property
    def vertex_curvature(self) -> float:
        """Curvature at the vertex including that of the r² term, 1/mm."""
        return self.curvature + 2 * (self.powers[0] if self.powers else 0.0)

    def sag(self, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return z (mm) at squared heights r² (mm²), and its derivative with respect to r²; nan beyond the edge."""
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(1 - (1 + self.conic) * self.curvature**2 * squared)
            z, slope = self.curvature * squared / (1 + root), self.curvature / (2 * root)
        for n, a in enumerate(self.powers, start=1):
            z, slope = z + a * squared**n, slope + n * a * squared ** (n - 1)
        return z, slope


@dataclass(frozen=True)
class Prescription:
    """A lens of surfaces of revolution around one axis, in air.

    Attributes
    ----------
    name : str
        What the lens is.
    surfaces : tuple of Surface
        From the one that meets the light first to the last; the stop is one of them.
    stop : int
        Number of the surface at whose vertex the stop is.
    aperture : tuple of str and float
        How large the stop is: ``entrance`` (diameter of the entrance pupil, mm), ``f_number`` or ``stop`` (radius, mm).
    field : tuple of str and float
        How far the picture reaches: ``angle`` (degrees from the axis, in front of the lens) or ``image`` (mm).
    waves_nm : tuple of float
        Wavelengths of the design, nm, sorted.
    primary_nm : float
        The one at which the lens is described.
    notes : tuple of str
        What the file says and nothing here uses, a line each.
    """

    name: str
    surfaces: tuple[Surface, ...]
    stop: int
    aperture: tuple[str, float]
    field: tuple[str, float]
    waves_nm: tuple[float, ...]
    primary_nm: float
    notes: tuple[str, ...] = ()

    def indices(self, wavelength_nm: float) -> np.ndarray:
        """Return the index of the medium in front of each surface and behind the last, float64 (surface + 1,)."""
        return np.array([1.0, *(surface.glass.index(wavelength_nm / 1e3) for surface in self.surfaces)])

    @property
    def vertices_mm(self) -> np.ndarray:
        """Places of the vertices along the axis, from the first, mm, float64 (surface,)."""
        return np.concatenate([[0.0], np.cumsum([surface.thickness_mm for surface in self.surfaces[:-1]])])


def check_prescription(lens: Prescription, *, where: str) -> Prescription:
    """Return the lens if rays can be traced through it; ``where`` names the file in the message of BadInput."""
    surfaces = lens.surfaces
    if len(surfaces) > MAX_SURFACES:
        raise BadInput(f"{where} has {len(surfaces)} surfaces", allowed=f"at most {MAX_SURFACES}")
    if not any(surface.glass is not AIR and surface.glass.numbers != (1.0,) for surface in surfaces):
        raise BadInput(f"{where} has no glass", allowed="a lens: surfaces with glass between them")
    if not 0 <= lens.stop < len(surfaces):
        raise BadInput(f"{where} says of no surface that it is the stop", allowed="one surface that is the stop")
    if surfaces[-1].glass.numbers != (1.0,):
        raise BadInput(f"{where}: behind the last surface is {surfaces[-1].glass.name}", allowed="a lens in air")
    for n, surface in enumerate(surfaces, start=1):
        at = f"{where}: surface {n}"
        numbers = (surface.curvature, surface.conic, *surface.powers)
        if not all(map(math.isfinite, numbers)):
            raise BadInput(f"{at} has a shape that is no number", allowed="finite radius, conic and coefficients")
        if not surface.semi_diameter_mm > 0:
            raise BadInput(f"{at} has a semi-diameter of {surface.semi_diameter_mm:g} mm", allowed="above 0")
        if n == len(surfaces):
            continue
        if not math.isfinite(surface.thickness_mm):
            raise BadInput(f"{at} has a thickness of {surface.thickness_mm:g} mm", allowed="a finite thickness")
        if surface.glass.numbers != (1.0,) and not surface.thickness_mm > 0:
            raise BadInput(f"{at}: its glass is {surface.thickness_mm:g} mm thick", allowed="a thickness above 0")
        if surface.thickness_mm < 0 and not {n - 1, n} & _idle(lens):
            raise BadInput(
                f"{at}: the next surface is {-surface.thickness_mm:g} mm in front of it",
                allowed="a thickness of 0 or more between glasses",
            )
    for what, value in (lens.aperture, lens.field):
        if not (math.isfinite(value) and value > 0):
            raise BadInput(f"{where}: the {_WORDS[what]} is {value:g}", allowed="above 0")
    if lens.field[0] == "angle" and lens.field[1] >= 85:
        raise BadInput(f"{where}: the field reaches {lens.field[1]:g}° from the axis", allowed="below 85°")
    if not all(200 <= wave <= 3000 for wave in (*lens.waves_nm, lens.primary_nm)):
        raise BadInput(
            f"{where}: wavelengths are {', '.join(f'{wave:g}' for wave in lens.waves_nm)} nm", allowed="200 to 3000 nm"
        )
    return lens


def _idle(lens: Prescription) -> set[int]:
    """Return the numbers of the surfaces, such as a stop in air, that bend no ray."""
    media = [AIR.numbers, *(surface.glass.numbers for surface in lens.surfaces)]
    return {n for n in range(len(lens.surfaces)) if media[n] == media[n + 1]}


_WORDS = {
    "entrance": "diameter of the entrance pupil (mm)",
    "f_number": "f-number",
    "stop": "radius of the stop (mm)",
    "angle": "largest angle of the field (degrees)",
    "image": "largest image height (mm)",
}
