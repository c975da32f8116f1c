"""The drive that moves the scene relative to the lens, as the stage of a microscope does."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront


@dataclass(frozen=True)
class Stage(Drive):
    """A lens fixed to the sensor, and a rigid scene that moves; the position p is linear in z of the stage.

    z (m) is positive towards the lens, as for a raised stage: a point at depth d is d - z away from the lens. Depths
    are in the frame of the card, where z = 0. Moving the scene towards the lens is the same as moving the lens towards
    the scene: a line with slope s that meets the plane of the lens at a for z = 0 meets it at a + s·z. The plane in
    focus is always u = f·(1 + 1/M) from the lens. The scale of a plane is proportional to 1/(d - z).

    Parameters
    ----------
    focal_length_m : float
        Focal length f, metres.
    f_number : float
        f-number N; the aperture radius is R = f/(2N).
    magnification : float
        Magnification M of the plane in focus; the image distance is v = f·(1 + M).
    travel_m : tuple of float
        z at position 0 and at position 1, metres.
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
        If both ends of the travel are equal, a scene in focus could hit the lens, or the plane in focus would be behind
        the lens as the card places it.
    """

    kind: ClassVar[str] = "stage"
    travel_key: ClassVar[str] = "travel_m"

    focal_length_m: float
    f_number: float
    magnification: float
    travel_m: tuple[float, float]
    transmission: float = 1.0
    wavefront: Wavefront | None = None
    ring: Ring | None = None
    distortion: Distortion | None = None
    veiling_glare: float = 0.0

    def __post_init__(self) -> None:
        first, last = self.travel_m
        u = self._u
        if first == last:
            raise BadInput(f"the stage does not move: both ends of the travel are {first:g} m")
        if not abs(last - first) < u:
            raise BadInput(
                f"a travel of {abs(last - first):g} m runs into the lens, which focuses at {u:g} m",
                allowed=f"less than {u:g} m from end to end",
            )
        if not min(first, last) > -u:
            raise BadInput(
                f"at {min(first, last):g} m of travel, the plane in focus, {u:g} m from the lens, is behind the lens "
                "as the card places it",
                allowed=f"a travel above {-u:g} m; positive values bring lens and scene closer",
            )

    @property
    def _u(self) -> float:
        return self.focal_length_m * (1 + 1 / self.magnification)

    @property
    def _v(self) -> float:
        return self.focal_length_m * (1 + self.magnification)

    @property
    def aperture_radius_m(self) -> float:
        """Aperture radius R = f/(2N), metres."""
        return self.focal_length_m / (2 * self.f_number)

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the image distance v in metres, which is the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._v)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return the object distance u in metres, which is the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._u)

    def shift(self, position: np.ndarray | float) -> np.ndarray:
        """Return z in metres at each position."""
        first, last = self.travel_m
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def position(self, shift: np.ndarray | float) -> np.ndarray:
        """Return the position at which the shift z, in metres, is reached; it may be outside 0 to 1."""
        first, last = self.travel_m
        return (np.asarray(shift, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float, *, defocus: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the position that focuses a point at a depth in metres, where z = d - u; infinite if the depth is."""
        nearer = self._u * self._u * defocus / (1 + self._u * defocus)  # u - 1/(1/u + defocus), without cancellation
        return self.position(np.asarray(depth, dtype=np.float64) - self._u + nearer)

    def least_blur(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean squared blur of a perfect lens over these depths in metres.

        The blur is c = 2R·v·|1/y - 1/u| with y = d - z. The mean of c² decreases with z while F = mean((y - u)/y³) > 0.
        F is positive with the nearest depth in focus, negative with the farthest in focus, and has one zero in between:
        as z grows, the relative growth rate of each term is above 3/u for a depth nearer than the focus, and below it
        for a farther one. The lens stays in front of the nearest depth.
        """
        from scipy.optimize import brentq  # the import takes half a second and is needed for a stage only

        d = np.asarray(depths, dtype=np.float64)
        u, nearest = self._u, float(d.min())
        relief = d - nearest  # keeps the digits of micrometres next to millimetres

        def slope(rise: float) -> float:
            beyond = relief - rise  # y - u
            return float(np.mean(beyond / (u + beyond) ** 3))

        max_rise = min(float(relief.max()), u * (1 - 1e-6))
        rise = float(brentq(slope, 0, max_rise, xtol=1e-12 * max_rise)) if max_rise > 0 else 0.0
        return float(self.position(nearest - u + rise))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return the positions at which 1/(d - z) = 1/u ± blur/(2R·v).

        The farther one is infinite if the blur never becomes as large.
        """
        z = float(self.shift(focused))
        half = self._u * blur_m / (2 * self.aperture_radius_m * self._v)
        # d - u/(1 ± half), in a form without cancellation.
        near, far = half / (1 + half), -half / (1 - half) if half < 1 else -np.inf
        return float(self.position(z + self._u * near)), float(self.position(z + self._u * far))
