"""The drive that changes the power of the lens, such as a liquid lens."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive


@dataclass(frozen=True)
class FocalLengthDrive(Drive):
    """A varifocal lens at a fixed distance from the sensor; position p is linear in its power 1/f.

    With v fixed, 1/f = 1/u + 1/v makes p linear in 1/u as well. The image does not breathe. The aperture is a separate
    stop: neither it nor the light it collects changes with f. Raises BadInput for a distance that is not in front of
    the lens, or no travel.

    Parameters
    ----------
    image_distance_m : v, from lens to sensor.
    f_number : N of the lens focused at infinity, where f = v; the aperture radius is R = v/(2N).
    focus_range_m : object distances in focus at position 0 and at position 1.
    transmission : fraction of the light that the glass transmits.
    """

    kind: ClassVar[str] = "focal_length"
    travel_key: ClassVar[str] = "focus_range_m"

    image_distance_m: float
    f_number: float
    focus_range_m: tuple[float, float]
    transmission: float = 1.0

    def __post_init__(self) -> None:
        for distance in self.focus_range_m:
            if not distance > 0:
                raise BadInput(f"the lens cannot focus at {distance:g} m", allowed="object distances in front of it")
        if self.focus_range_m[0] == self.focus_range_m[1]:
            raise BadInput(f"the lens does not change: both ends focus at {self.focus_range_m[0]:g} m")

    @property
    def aperture_radius_m(self) -> float:
        """Aperture radius R = v/(2N) (m)."""
        return self.image_distance_m / (2 * self.f_number)

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return v (m), the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self.image_distance_m)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return u (m) in focus at each position: 1/u is linear."""
        first, last = (1 / u for u in self.focus_range_m)
        return 1 / (first + (last - first) * np.asarray(position, dtype=np.float64))

    def position(self, dioptres: np.ndarray | float) -> np.ndarray:
        """Return the position of a vergence 1/u (dioptres); it may lie outside 0...1."""
        first, last = (1 / u for u in self.focus_range_m)
        return (np.asarray(dioptres, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float) -> np.ndarray:
        """Return the position that focuses a point of this depth (m)."""
        return self.position(1 / np.asarray(depth, dtype=np.float64))

    def true_focus(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean of c² over these depths (m).

        c = 2R·v·|1/u_o - 1/u|, so the mean of c² is a parabola in 1/u with its minimum at mean(1/u_o).
        """
        return float(self.position(float(np.mean(1 / np.asarray(depths, dtype=np.float64)))))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return 1/u ± blur/(2R·v) as positions."""
        sharp = 1 / float(self.object_distance(focused))
        half = blur_m / (2 * self.aperture_radius_m * self.image_distance_m)
        return float(self.position(sharp - half)), float(self.position(sharp + half))
