"""The drive that moves the lens against the sensor, as in a macro lens."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive


@dataclass(frozen=True)
class ImageDistanceDrive(Drive):
    """A lens of fixed focal length; position p is linear in v. The image breathes: its scale grows with v.

    Raises BadInput for a distance within the focal length, which no position focuses, or no travel.

    Parameters
    ----------
    focal_length_m, f_number : f and N; the aperture radius is R = f/(2N).
    focus_range_m : object distances in focus at position 0 and at position 1.
    transmission : fraction of the light that the glass transmits.
    """

    kind: ClassVar[str] = "image_distance"
    travel_key: ClassVar[str] = "focus_range_m"

    focal_length_m: float
    f_number: float
    focus_range_m: tuple[float, float]
    transmission: float = 1.0

    def __post_init__(self) -> None:
        for distance in self.focus_range_m:
            if not distance > self.focal_length_m:
                raise BadInput(
                    f"the lens of {self.focal_length_m * 1e3:g} mm cannot focus at {distance:g} m",
                    allowed=f"object distances beyond {self.focal_length_m:g} m",
                )
        if self.focus_range_m[0] == self.focus_range_m[1]:
            raise BadInput(f"the lens does not move: both ends focus at {self.focus_range_m[0]:g} m")

    @property
    def aperture_radius_m(self) -> float:
        """Aperture radius R = f/(2N) (m)."""
        return self.focal_length_m / (2 * self.f_number)

    @property
    def _ends(self) -> tuple[float, float]:
        first, last = (1 / (1 / self.focal_length_m - 1 / u) for u in self.focus_range_m)
        return first, last

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return v (m) at each position, linear in it."""
        first, last = self._ends
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return u (m) in focus at each position: f·v / (v - f)."""
        v = self.image_distance(position)
        return self.focal_length_m * v / (v - self.focal_length_m)

    def position(self, image_distance: np.ndarray | float) -> np.ndarray:
        """Return the position of an image distance (m); it may lie outside 0...1."""
        first, last = self._ends
        return (np.asarray(image_distance, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float) -> np.ndarray:
        """Return the position that focuses a point of this depth (m)."""
        return self.position(1 / (1 / self.focal_length_m - 1 / np.asarray(depth, dtype=np.float64)))

    def true_focus(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean of c² over these depths (m).

        c = 2R·|1 - v·w| with w = 1/f - 1/u_o, so the mean of c² is a parabola in v with its minimum at
        v = mean(w) / mean(w²): the in-focus distance itself if all depths are equal.
        """
        w = 1 / self.focal_length_m - 1 / np.asarray(depths, dtype=np.float64)
        return float(self.position(w.mean() / np.mean(w**2)))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return v·(1 ± blur/(2R)) as positions."""
        v = float(self.image_distance(focused))
        half = blur_m / (2 * self.aperture_radius_m)
        return float(self.position(v * (1 - half))), float(self.position(v * (1 + half)))
