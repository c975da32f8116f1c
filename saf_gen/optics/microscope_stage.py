"""The drive that moves the specimen against the lens, as the stage of a microscope does."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive


@dataclass(frozen=True)
class Stage(Drive):
    """A lens fixed to the sensor and a scene that moves as a whole; position p is linear in z of the stage.

    z (m) is positive towards the lens, as for a raised stage: a point of depth d is d - z away from the lens. Depths
    are in the frame of the card, where z = 0. Moving the scene towards the lens is moving the lens towards the scene: a
    line that meets the lens's plane at a with slope s for z = 0 meets it at a + s·z. The plane in focus is always u =
    f·(1 + 1/M) away. The scale of a plane is proportional to 1/(d - z). Raises BadInput for no travel, a travel on
    which a scene in focus would hit the lens, or one that puts the plane in focus behind the lens of the card.

    Parameters
    ----------
    focal_length_m, f_number : f and N; the aperture radius is R = f/(2N).
    magnification : M of the plane in focus; v = f·(1 + M).
    travel_m : z at position 0 and at position 1.
    transmission : fraction of the light that the glass transmits.
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
                f"a travel of {abs(last - first):g} m runs into the lens, which focuses at {u:g} m",
                allowed=f"less than {u:g} m from end to end",
            )
        if not min(first, last) > -u:
            raise BadInput(
                f"at {min(first, last):g} m of travel the plane in focus, {u:g} m away, is behind the lens",
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
        """Aperture radius R = f/(2N) (m)."""
        return self.focal_length_m / (2 * self.f_number)

    def image_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return v (m), the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._v)

    def object_distance(self, position: np.ndarray | float) -> np.ndarray:
        """Return u (m), from the lens to the plane in focus, the same at each position."""
        return np.full_like(np.asarray(position, dtype=np.float64), self._u)

    def shift(self, position: np.ndarray | float) -> np.ndarray:
        """Return z (m) at each position, linear in it."""
        first, last = self.travel_m
        return first + (last - first) * np.asarray(position, dtype=np.float64)

    def position(self, shift: np.ndarray | float) -> np.ndarray:
        """Return the position of a z (m); it may lie outside 0...1."""
        first, last = self.travel_m
        return (np.asarray(shift, dtype=np.float64) - first) / (last - first)

    def best_position(self, depth: np.ndarray | float) -> np.ndarray:
        """Return the position that focuses a point of this depth (m), z = d - u; infinite if the depth is."""
        return self.position(np.asarray(depth, dtype=np.float64) - self._u)

    def true_focus(self, depths: np.ndarray) -> float:
        """Return the position that minimises the mean of c² over these depths (m).

        c = 2R·v·|1/y - 1/u| with y = d - z; the mean of c² falls with z while F = mean((y - u)/y³) > 0.
        F is positive with the nearest depth in focus, negative with the farthest, and zero once in between:
        as z grows, the term of a depth nearer than the focus grows by more than 3/u of itself, that of a
        farther one by less. The lens stays in front of the nearest depth.
        """
        from scipy.optimize import brentq  # loaded in half a second, which all without a stage do without

        d = np.asarray(depths, dtype=np.float64)
        u, nearest = self._u, float(d.min())
        relief = d - nearest  # so that micrometres keep their digits next to millimetres

        def slope(rise: float) -> float:
            beyond = relief - rise  # y - u
            return float(np.mean(beyond / (u + beyond) ** 3))

        most = min(float(relief.max()), u * (1 - 1e-6))
        rise = float(brentq(slope, 0, most, xtol=1e-12 * most)) if most > 0 else 0.0
        return float(self.position(nearest - u + rise))

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        """Return 1/(d - z) = 1/u ± blur/(2R·v) as positions; the far one is infinite if it never blurs so much."""
        z = float(self.shift(focused))
        half = self._u * blur_m / (2 * self.aperture_radius_m * self._v)
        # d - u/(1 ± half), written so that the small difference is not lost.
        near, far = half / (1 + half), -half / (1 - half) if half < 1 else -np.inf
        return float(self.position(z + self._u * near)), float(self.position(z + self._u * far))
