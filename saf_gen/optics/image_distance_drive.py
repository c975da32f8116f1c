"""The drive that moves the lens relative to the sensor, as in a macro lens."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront


@dataclass(frozen=True)
class ImageDistanceDrive(Drive):
    """A lens of fixed focal length that moves; the position p is linear in the image distance v.

    The image breathes: its scale grows with v.

    Parameters
    ----------
    focal_length_m : float
        Focal length f, metres.
    f_number : float
        f-number N; the aperture radius is R = f/(2N).
    focus_range_m : tuple of float
        Object distances in focus at position 0 and at position 1, metres.
    transmission : float, default 1
        Fraction of the light that the lens transmits.
    wavefront : Wavefront, optional
        Aberrations of the lens.
    ring : Ring, optional
        Ring in front of the lens that vignettes.
    distortion : Distortion, optional
        Distortion of the lens.
    veiling_glare : float, default 0
        Share of the light in the frame that is spread evenly over it.

    Raises
    ------
    BadInput
        If an object distance is not beyond the focal length, so that no position focuses it, or both are equal.
    """

    kind: ClassVar[str] = "image_distance"
    travel_key: ClassVar[str] = "focus_range_m"

    focal_length_m: float
    f_number: float
    focus_range_m: tuple[float, float]
    transmission: float = 1.0
    wavefront: Wavefront | None = None
    ring: Ring | None = None
    distortion: Distortion | None = None
    veiling_glare: float = 0.0

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
        """Aperture radius R = f/(2N), metres."""
        return self.focal_length_m / (2 * self.f_number)

    @property
    def _ends(self) -> tuple[float, float]:
        first, last = (1 / (1 / self.focal_length_m - 1 / u) for u in self.focus_range_m)
        return first, last

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the image distance v at each position, in metres."""
        first, last = self._ends
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the object distance in focus at each position, u = f·v / (v - f), in metres."""
        v = self.image_distance(position)
        return self.focal_length_m * v / (v - self.focal_length_m)

    def position(self, image_distance: np.ndarray | float) -> np.ndarray:
        """Return the position with a given image distance in metres; it may be outside 0 to 1."""
        first, last = self._ends
        return (np.asarray(image_distance, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float, *, defocus: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the position that focuses a point at a depth in metres; it may be outside 0 to 1."""
        return self.position(1 / (1 / self.focal_length_m - 1 / np.asarray(depth, dtype=np.float64) + defocus))

    def least_blur(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean squared blur of a perfect lens over these depths in metres.

        The blur is c = 2R·|1 - v·w| with w = 1/f - 1/u_o, so the mean of c² is a parabola in v with its minimum at
        v = mean(w) / mean(w²), which is the image distance in focus if all depths are equal.
        """
        w = 1 / self.focal_length_m - 1 / np.asarray(depths, dtype=np.float64)
        return float(self.position(w.mean() / np.mean(w**2)))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return the positions at the image distances v·(1 ± blur/(2R))."""
        v = float(self.image_distance(focused))
        half = blur_m / (2 * self.aperture_radius_m)
        return float(self.position(v * (1 - half))), float(self.position(v * (1 + half)))
