"""The drive that changes the power of the lens, such as a liquid lens."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront


@dataclass(frozen=True)
class FocalLengthDrive(Drive):
    """A varifocal lens at a fixed distance from the sensor; the position p is linear in its power 1/f.

    As v is fixed and 1/f = 1/u + 1/v, p is linear in 1/u as well. The image does not breathe. The aperture is a
    separate stop: neither it nor the light that it collects changes with f.

    Parameters
    ----------
    image_distance_m : float
        Distance v from the lens to the sensor, metres.
    f_number : float
        f-number N of the lens focused at infinity, where f = v; the aperture radius is R = v/(2N).
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
        If an object distance is not in front of the lens, or both are equal.
    """

    kind: ClassVar[str] = "focal_length"
    travel_key: ClassVar[str] = "focus_range_m"

    image_distance_m: float
    f_number: float
    focus_range_m: tuple[float, float]
    transmission: float = 1.0
    wavefront: Wavefront | None = None
    ring: Ring | None = None
    distortion: Distortion | None = None
    veiling_glare: float = 0.0

    def __post_init__(self) -> None:
        for distance in self.focus_range_m:
            if not distance > 0:
                raise BadInput(f"the lens cannot focus at {distance:g} m", allowed="object distances in front of it")
        if self.focus_range_m[0] == self.focus_range_m[1]:
            raise BadInput(f"the lens does not change: both ends focus at {self.focus_range_m[0]:g} m")

    @property
    def aperture_radius_m(self) -> float:
        """Aperture radius R = v/(2N), metres."""
        return self.image_distance_m / (2 * self.f_number)

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the image distance v in metres, which is the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self.image_distance_m)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the object distance u in focus at each position, in metres; 1/u is linear in the position."""
        first, last = (1 / u for u in self.focus_range_m)
        return 1 / (first + (last - first) * np.asarray(position, dtype=np.float64))

    def position(self, dioptres: np.ndarray | float) -> np.ndarray:
        """Return the position that focuses a vergence 1/u in dioptres; it may be outside 0 to 1."""
        first, last = (1 / u for u in self.focus_range_m)
        return (np.asarray(dioptres, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float, *, defocus: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the position that focuses a point at a depth in metres; it may be outside 0 to 1."""
        return self.position(1 / np.asarray(depth, dtype=np.float64) - defocus)

    def least_blur(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean squared blur of a perfect lens over these depths in metres.

        The blur is c = 2R·v·|1/u_o - 1/u|, so the mean of c² is a parabola in 1/u with its minimum at mean(1/u_o).
        """
        return float(self.position(float(np.mean(1 / np.asarray(depths, dtype=np.float64)))))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return the positions that focus the vergences 1/u ± blur/(2R·v)."""
        sharp = 1 / float(self.object_distance(focused))
        half = blur_m / (2 * self.aperture_radius_m * self.image_distance_m)
        return float(self.position(sharp - half)), float(self.position(sharp + half))
