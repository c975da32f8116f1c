"""The thin lens and its drive: focus positions, blur, depth of focus, truth. Closed forms only.

Thin lens of focal length f, f-number N, aperture radius R = f/(2N): 1/u + 1/v = 1/f. A ray through the
lens point a with slope s in object space meets the sensor at x = -v·(s + a/u_k), u_k the distance in focus.
All lengths in metres; a position is the fraction 0...1 of the drive's travel.
"""

from dataclasses import dataclass

import numpy as np

from saf_gen.errors import BadInput

__all__ = ["ImageDistance", "sweep"]


@dataclass(frozen=True)
class ImageDistance:
    """A lens of fixed focal length that moves against the sensor, as a macro lens does.

    Position p is linear in the image distance v; the picture breathes, its scale goes as v.

    Parameters
    ----------
    focal_length_m, f_number : the lens.
    focus_range_m : object distances in focus at position 0 and at position 1.
    transmission : share of the light that the glass lets through.

    Raises
    ------
    BadInput : a distance at or inside the focal length, which no lens position can focus.
    """

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
        """R = f / 2N."""
        return self.focal_length_m / (2 * self.f_number)

    @property
    def _ends(self) -> tuple[float, float]:
        near, far = (1 / (1 / self.focal_length_m - 1 / u) for u in self.focus_range_m)
        return near, far

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """v (m) at each position."""
        first, last = self._ends
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """u (m) in focus at each position: f·v / (v - f)."""
        v = self.image_distance(position)
        return self.focal_length_m * v / (v - self.focal_length_m)

    def position(self, image_distance: np.ndarray | float) -> np.ndarray:
        """The position of an image distance; below 0 or above 1 where the travel does not reach it."""
        first, last = self._ends
        return (np.asarray(image_distance, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float) -> np.ndarray:
        """The position that focuses a point at this axial distance (m)."""
        return self.position(1 / (1 / self.focal_length_m - 1 / np.asarray(depth, dtype=np.float64)))

    def blur_diameter(self, position: np.ndarray | float, depth: np.ndarray | float) -> np.ndarray:
        """Diameter (m, on the sensor) of the blur of a point: c = 2R·v·|1/u_o - 1/u_k|."""
        v = self.image_distance(position)
        defocus = 1 / np.asarray(depth, dtype=np.float64) - 1 / self.object_distance(position)
        return 2 * self.aperture_radius_m * v * np.abs(defocus)

    def truth(self, depths: np.ndarray) -> float:
        """The position that minimises the mean of c² over these depths (m).

        c = 2R·|1 - v·w| with w = 1/f - 1/u_o, so the mean of c² is a parabola in v with its minimum at
        v = mean(w) / mean(w²): the in-focus distance itself where all depths are one.
        """
        w = 1 / self.focal_length_m - 1 / np.asarray(depths, dtype=np.float64)
        return float(self.position(w.mean() / np.mean(w**2)))

    def depth_of_focus(self, depths: np.ndarray, pixel_pitch_m: float) -> tuple[float, float]:
        """The two positions, in rising order, at which the blur at the truth's depth is one pixel.

        Taken at the one depth that is in focus at :meth:`truth`; a target with depth of its own is never
        sharp everywhere, and its mean blur might not come down to a pixel at all.
        """
        v = float(self.image_distance(self.truth(depths)))
        half = pixel_pitch_m / (2 * self.aperture_radius_m)
        low, high = sorted(float(self.position(v * (1 + sign * half))) for sign in (-1, 1))
        return low, high


def sweep(frames: int) -> np.ndarray:
    """Position of the lens at the middle of each readout of one sweep, float64 (frames,), 0...1."""
    return (np.arange(frames) + 0.5) / frames
