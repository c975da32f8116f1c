"""The drive that moves a lens read from a file as a whole, relative to the sensor."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.fitted_rays import FittedRays, SeenWavefront
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront


@dataclass(frozen=True)
class FittedLensDrive(Drive):
    """A lens whose entrance and exit pupil lie apart; the position p is linear in the distance of the sensor.

    Near its axis, the lens images a point b of the entrance pupil on m·b of the exit pupil, and a ray that starts at b
    with slope s meets the sensor at x = -V·(s + b/U). V is the distance from the exit pupil to the sensor divided by m,
    and U the distance in focus from the entrance pupil: 1/U = m·(1/f - 1/V). With m = 1 this is the thin lens. Depths
    are measured from the entrance pupil, which stays where it is: the sensor moves.

    Parameters
    ----------
    focal_length_m : float
        Focal length f, metres.
    f_number : float
        f-number N; the radius of the entrance pupil is R = f/(2N).
    focus_range_m : tuple of float
        Object distances in focus at position 0 and at position 1, from the entrance pupil, metres.
    pupil_magnification : float
        m, the exit pupil divided by the entrance pupil.
    transmission : float, default 1
        Fraction of the light that the lens transmits.
    wavefront : FittedRays or Wavefront, optional
        How its rays differ from those near the axis.
    ring : Ring, optional
        Ring in front of the lens that takes light away from the edge of the picture.
    distortion : Distortion, optional
        Further distortion of the lens.
    veiling_glare : float, default 0
        Share of the light in the frame that the lens spreads evenly over it.

    Raises
    ------
    BadInput
        If an object distance is too near for any position, or both are equal.
    """

    kind: ClassVar[str] = "lens_file"
    travel_key: ClassVar[str] = "focus_range_m"

    focal_length_m: float
    f_number: float
    focus_range_m: tuple[float, float]
    pupil_magnification: float
    transmission: float = 1.0
    wavefront: Wavefront | FittedRays | SeenWavefront | None = None
    ring: Ring | None = None
    distortion: Distortion | None = None
    veiling_glare: float = 0.0

    def __post_init__(self) -> None:
        nearest = self.focal_length_m / self.pupil_magnification
        for distance in self.focus_range_m:
            if not distance > nearest:
                raise BadInput(
                    f"the lens of {self.focal_length_m * 1e3:.4g} mm cannot focus at {distance:g} m",
                    allowed=f"object distances beyond {nearest:.4g} m",
                )
        if self.focus_range_m[0] == self.focus_range_m[1]:
            raise BadInput(f"the lens does not move: both ends focus at {self.focus_range_m[0]:g} m")

    @property
    def aperture_radius_m(self) -> float:
        """Radius R = f/(2N) of the entrance pupil, metres."""
        return self.focal_length_m / (2 * self.f_number)

    def focused_image_distance(self, vergence: np.ndarray | float) -> np.ndarray:
        """Return V (m) that brings objects at the vergence 1/U (1/m) into focus."""
        inverse = 1 / self.focal_length_m - np.asarray(vergence, dtype=np.float64) / self.pupil_magnification
        return np.asarray(1 / inverse)

    @property
    def _ends(self) -> tuple[float, float]:
        first, last = (float(self.focused_image_distance(1 / u)) for u in self.focus_range_m)
        return first, last

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return V at each position, in metres."""
        first, last = self._ends
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the distance U in focus at each position, from the entrance pupil, in metres."""
        v = self.image_distance(position)
        return self.focal_length_m * v / (v - self.focal_length_m) / self.pupil_magnification

    def position(self, image_distance: np.ndarray | float) -> np.ndarray:
        """Return the position with a given V in metres; it may be outside 0 to 1."""
        first, last = self._ends
        return (np.asarray(image_distance, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float, *, defocus: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the position that focuses a point at a depth in metres; it may be outside 0 to 1."""
        return self.position(self.focused_image_distance(1 / np.asarray(depth, dtype=np.float64) - defocus))

    def least_blur(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean squared blur of a perfect lens over these depths in metres.

        The blur is c = 2R·|m - V·w| with w = m/f - 1/u_o, so the mean of c² is a parabola in V with its minimum at
        V = m·mean(w)/mean(w²).
        """
        w = self.pupil_magnification / self.focal_length_m - 1 / np.asarray(depths, dtype=np.float64)
        return float(self.position(self.pupil_magnification * w.mean() / np.mean(w**2)))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return the positions at the image distances V·(1 ± blur/(2R·m))."""
        v = float(self.image_distance(focused))
        half = blur_m / (2 * self.aperture_radius_m * self.pupil_magnification)
        return float(self.position(v * (1 - half))), float(self.position(v * (1 + half)))
