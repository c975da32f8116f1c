"""First-order properties of a lens: focal length, pupils, and how both of its sides belong together.

References
----------
W. T. Welford, "Aberrations of Optical Systems" (1986), chapters 2 and 3.
"""

from dataclasses import dataclass

import numpy as np

from saf_gen.addons.lens_files.prescription import Prescription
from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Pupils:
    """What a lens does to rays near its axis, at one wavelength.

    A point b of the entrance pupil is imaged on m·b of the exit pupil. A ray that leaves b with slope s (dx/dz, z from
    the scene to the sensor) leaves the exit pupil with slope s/m - b/f.

    Attributes
    ----------
    focal_length_mm : float
        f.
    entrance_mm : float
        Place of the entrance pupil along z, from the first vertex.
    exit_mm : float
        Place of the exit pupil along z, from the last vertex.
    magnification : float
        m.
    stop_scale : float
        Radius of the stop divided by that of the entrance pupil.
    """

    focal_length_mm: float
    entrance_mm: float
    exit_mm: float
    magnification: float
    stop_scale: float

    def entrance_radius_mm(self, aperture: tuple[str, float]) -> float:
        """Return the radius of the entrance pupil that a prescription's aperture states."""
        kind, value = aperture
        if kind == "entrance":
            return value / 2
        return abs(value / self.stop_scale) if kind == "stop" else self.focal_length_mm / (2 * value)


def find_pupils(lens: Prescription, wavelength_nm: float) -> Pupils:
    """Return the pupils of a lens; raise BadInput if it has no focal length above 0 or no pupils at a finite place."""
    indices, surfaces = lens.indices(wavelength_nm), lens.surfaces
    front, whole = np.eye(2), np.eye(2)
    for n, surface in enumerate(surfaces):
        if n == lens.stop:
            front = whole
        bend = (indices[n + 1] - indices[n]) * surface.vertex_curvature / indices[n + 1]
        whole = np.array([[1, 0], [-bend, indices[n] / indices[n + 1]]]) @ whole
        if n < len(surfaces) - 1:
            whole = np.array([[1, surface.thickness_mm], [0, 1]]) @ whole
    rear = whole @ np.linalg.inv(front)
    if not whole[1, 0] < -1e-9:
        raise BadInput(
            f"{lens.name} collects no light: its power is {-1e3 * whole[1, 0]:g} dioptres", allowed="above 0"
        )
    if not (abs(front[0, 0]) > 1e-6 and abs(rear[1, 1]) > 1e-6):
        raise BadInput(f"{lens.name} is telecentric: a pupil is at infinity", allowed="pupils at a finite distance")
    return Pupils(
        focal_length_mm=float(-1 / whole[1, 0]),
        entrance_mm=float(front[0, 1] / front[0, 0]),
        exit_mm=float(-rear[0, 1] / rear[1, 1]),
        magnification=float(front[0, 0] * np.linalg.det(rear) / rear[1, 1]),
        stop_scale=float(front[0, 0]),
    )
