"""The specimen that moves against the lens, as on the stage of a microscope."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import brentq

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive

__all__ = ["Stage"]


@dataclass(frozen=True)
class Stage(Drive):
    """A lens fixed to the sensor, and a scene that moves as a whole; position p is linear in the stage's z.

    z (m) counts towards the lens, as a stage that is raised: a point of depth d is d - z away from the lens.
    Depth is that of the card's frame, where z = 0. The scene moved towards the lens is the lens moved
    towards the scene: a line that meets the lens's plane at a with slope s at z = 0 meets it at a + s·z. What
    is in focus is always u = f·(1 + 1/M) away. The scale of a plane goes as 1/(d - z).

    Parameters
    ----------
    focal_length_m, f_number : the lens; its aperture radius is R = f/(2N).
    magnification : M of the plane in focus; v = f·(1 + M).
    travel_m : z at position 0 and at position 1.
    transmission : share of the light that the glass lets through.

    Raises
    ------
    BadInput : no travel; a travel on which a scene in focus would run into the lens, or that has the plane
    in focus behind the lens of the card.
    """

    kind: ClassVar[str] = "stage"
    travel_key: ClassVar[str] = "travel_m"

    focal_length_m: float
    f_number: float
    magnification: float
    travel_m: tuple[float, float]
    transmission: float = 1.0

    def __post_init__(self) -> None:
        first, last = self.travel_m
        u = self._u
        if first == last:
            raise BadInput(f"the stage does not move: both ends of the travel are {first:g} m")
        if not abs(last - first) < u:
            raise BadInput(
                f"a travel of {abs(last - first):g} m runs into the lens, which is in focus at {u:g} m",
                allowed=f"less than {u:g} m from end to end",
            )
        if not min(first, last) > -u:
            raise BadInput(
                f"at {min(first, last):g} m of travel the lens, in focus at {u:g} m, cannot focus before it",
                allowed=f"a travel above {-u:g} m, counted towards the lens",
            )

    @property
    def _u(self) -> float:
        return self.focal_length_m * (1 + 1 / self.magnification)

    @property
    def _v(self) -> float:
        return self.focal_length_m * (1 + self.magnification)

    @property
    def aperture_radius_m(self) -> float:
        """R = f/(2N)."""
        return self.focal_length_m / (2 * self.f_number)

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """v (m), the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._v)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """u (m) from the lens to the plane in focus, the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._u)

    def shift(self, position: np.ndarray | float) -> np.ndarray:
        """z (m) at each position: linear."""
        first, last = self.travel_m
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def position(self, shift: np.ndarray | float) -> np.ndarray:
        """The position of a z; below 0 or above 1 where the travel does not reach it."""
        first, last = self.travel_m
        return (np.asarray(shift, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float) -> np.ndarray:
        """The position that focuses a point of this depth (m): z = d - u. Infinite where the depth is."""
        return self.position(np.asarray(depth, dtype=np.float64) - self._u)

    def true_focus(self, depths: np.ndarray) -> float:
        """The position that minimises the mean of c² over these depths (m).

        c = 2R·v·|1/y - 1/u| with y = d - z; the mean of c² falls with z while F = mean((y - u)/y³) > 0.
        F is positive where the nearest depth comes into focus, negative where the farthest does, and zero
        once in between: as z grows, a depth nearer than the focus gains in F by more than 3/u of itself, one
        beyond the focus by less. The lens stays before the nearest depth.
        """
        d = np.asarray(depths, dtype=np.float64)
        u, nearest = self._u, float(d.min())
        relief = d - nearest  # counted from there, micrometres keep their digits beside millimetres

        def fall(rise: float) -> float:
            beyond = relief - rise  # y - u
            return float(np.mean(beyond / (u + beyond) ** 3))

        most = min(float(relief.max()), u * (1 - 1e-6))
        rise = float(brentq(fall, 0, most, xtol=1e-12 * most)) if most > 0 else 0.0
        return float(self.position(nearest - u + rise))

    def depth_of_focus(self, depths: np.ndarray, pixel_pitch_m: float) -> tuple[float, float]:
        """1/(d - z) = 1/u ± pitch/(2R·v) as positions; see :meth:`Drive.depth_of_focus`.

        The far one is infinite where the blur never grows to a pixel.
        """
        z = float(self.shift(self.true_focus(depths)))
        half = self._u * pixel_pitch_m / (2 * self.aperture_radius_m * self._v)
        # d - u/(1 ± half), written so that the small difference is not lost.
        ways = (half / (1 + half), -half / (1 - half) if half < 1 else -np.inf)
        low, high = sorted(float(self.position(z + self._u * way)) for way in ways)
        return low, high
