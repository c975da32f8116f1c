"""A tracer of rays through the surfaces of the shipped double Gauss, written from Snell's law: of the package, only the
file of its surfaces is read. Lengths are in metres; z runs from the scene to the sensor, 0 at the first vertex.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

import saf_gen

FILE = Path(saf_gen.__file__).parent / "addons/lens_files/lenses/double_gauss.zmx"
SMALL = 1e-6
"""Height (m) and slope of rays near the axis."""


@dataclass(frozen=True)
class DoubleGauss:
    """The lens in the light of the line d, for which its file states the indices of its glasses.

    Attributes
    ----------
    f_number : float
        f-number at which it is used; the entrance pupil has the radius f/(2N).
    """

    f_number: float

    @cached_property
    def surfaces(self) -> list[tuple[float, float, float, float]]:
        """Curvature (1/m), place (m), and index before and behind of each surface; the stop has the curvature 0."""
        found, z, before = [], 0.0, 1.0
        for text in FILE.read_text().split("SURF ")[2:-1]:
            words = {line.split()[0]: line.split()[1:] for line in text.splitlines() if line.strip()}
            behind = float(words["GLAS"][3]) if "GLAS" in words else 1.0
            found.append((1e3 * float(words["CURV"][0]), z, before, behind))
            z, before = z + float(words["DISZ"][0]) / 1e3, behind
        return found

    @cached_property
    def pupils(self) -> tuple[float, float, float, float]:
        """Focal length f, places of entrance and exit pupil, and magnification m from the one to the other."""
        (stop,) = (n for n, one in enumerate(self.surfaces) if one[0] == 0)
        middle, ahead = np.array([[0.0], [0.0], [self.surfaces[stop][1]]]), np.array([[SMALL], [0.0], [1.0]])
        parallel, along = np.array([[SMALL], [0.0], [-0.01]]), np.array([[0.0], [0.0], [1.0]])
        _, way = self.trace(parallel, along, range(len(self.surfaces)))
        focal = -SMALL / float((way[0] / way[2])[0])
        # Rays through the middle of the stop, followed to both sides.
        sides = (
            self.trace(middle, -ahead, range(stop - 1, -1, -1)),
            self.trace(middle, ahead, range(stop + 1, len(self.surfaces))),
        )
        slopes = [float((way[0] / way[2])[0]) for _, way in sides]
        places = [float((at[2] - at[0] / slope)[0]) for (at, _), slope in zip(sides, slopes, strict=True)]
        return focal, places[0], places[1], slopes[0] / slopes[1]

    @property
    def radius_m(self) -> float:
        """Radius of the entrance pupil."""
        return self.pupils[0] / (2 * self.f_number)

    def sensor_distance(self, object_m: float) -> float:
        """Return the distance from the exit pupil to the sensor that is in focus near the axis.

        ``object_m`` is counted from the entrance pupil.
        """
        focal, _, _, m = self.pupils
        return m / (1 / focal - 1 / (m * object_m))

    def trace(self, place: np.ndarray, way: np.ndarray, order: range) -> tuple[np.ndarray, np.ndarray]:
        """Follow rays through surfaces in this order; return places on the last one and unit vectors behind it.

        ``place`` and ``way`` are float64 (3, ray).
        """
        place, way = np.array(place, np.float64), way / np.linalg.norm(way, axis=0)
        for n in order:
            curvature, z, *indices = self.surfaces[n]
            first, second = indices if order.step > 0 else reversed(indices)
            place = place - np.array([[0], [0], [z]])
            b = curvature * (place * way).sum(axis=0) - way[2]
            c = curvature * (place * place).sum(axis=0) - 2 * place[2]
            place = place + way * (c / (-b + np.copysign(np.sqrt(b * b - curvature * c), -b)))
            normal = np.array([[0], [0], [1.0]]) - curvature * place
            cosine = (way * normal).sum(axis=0)
            normal, cosine, ratio = normal * np.sign(cosine), np.abs(cosine), first / second
            way = ratio * way + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
            place = place + np.array([[0], [0], [z]])
        return place, way

    def seen_from(self, sensor: np.ndarray, pupil: np.ndarray, *, behind_m: float, object_m: float) -> np.ndarray:
        """Return where rays meet the plane of the object, float64 (2, ray).

        Parameters
        ----------
        sensor, pupil : ndarray of float64, shape (2, ray)
            Points of the sensor and of the exit pupil.
        behind_m, object_m : float
            Distance from the exit pupil to the sensor, and from the entrance pupil to the object.
        """
        _, entrance, leaves, _ = self.pupils
        through = np.vstack([pupil, np.full((1, pupil.shape[1]), leaves)])
        start = np.vstack([sensor, np.full((1, sensor.shape[1]), leaves + behind_m)])
        place, way = self.trace(start, through - start, range(len(self.surfaces) - 1, -1, -1))
        return np.asarray((place + way * ((entrance - object_m - place[2]) / way[2]))[:2])
