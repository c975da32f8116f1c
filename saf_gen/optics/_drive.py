"""What every drive offers, and the lens equations they share.

Thin lens of focal length f, image distance v, object distance u, aperture radius R: 1/u + 1/v = 1/f. A ray
through the lens point a with slope s in object space meets the sensor at x = -v·(s + a/u).

The frame of reference is that of the card: depths count from where it puts the lens. A drive may bring lens
and scene nearer to each other, by ``shift`` metres: the lens then lies at that depth of the frame.
"""

from abc import ABC, abstractmethod
from dataclasses import asdict
from typing import Any, ClassVar

import numpy as np

__all__ = ["Drive"]

Positions = np.ndarray | float


class Drive(ABC):
    """A lens and what moves its focus: a frozen dataclass a kind."""

    kind: ClassVar[str]
    travel_key: ClassVar[str]
    """The word of a scene card that sets the travel, for messages."""

    f_number: float
    """Of the lens focused at infinity."""
    transmission: float

    @property
    @abstractmethod
    def aperture_radius_m(self) -> float:
        """R, the same at every position."""

    @abstractmethod
    def image_distance(self, position: Positions) -> np.ndarray:
        """v (m), from the lens to the sensor, at each position."""

    @abstractmethod
    def object_distance(self, position: Positions) -> np.ndarray:
        """u (m), from the lens to the plane in focus, at each position."""

    def shift(self, position: Positions) -> np.ndarray:
        """How far (m) lens and scene have come nearer to each other than the card puts them: 0."""
        return np.zeros_like(np.asarray(position, dtype=np.float64))

    @abstractmethod
    def best_position(self, depth: Positions) -> np.ndarray:
        """The position that focuses a point of this depth (m); outside 0...1 where the travel ends before."""

    @abstractmethod
    def true_focus(self, depths: np.ndarray) -> float:
        """The position that minimises the mean of c² over these depths (m)."""

    @abstractmethod
    def depth_of_focus(self, depths: np.ndarray, pixel_pitch_m: float) -> tuple[float, float]:
        """The two positions, in rising order, at which the blur at the truth's depth is one pixel.

        Taken at the one depth that is in focus at :meth:`true_focus`; a target with depth of its own is never
        sharp everywhere, and its mean blur might not come down to a pixel at all.
        """

    def focus_depth(self, position: Positions) -> np.ndarray:
        """Depth (m) of the plane in focus at each position, in the frame of the card."""
        return self.object_distance(position) + self.shift(position)

    @property
    def focusing_range_m(self) -> tuple[float, float]:
        """Nearest and farthest depth (m) that a position focuses."""
        near, far = sorted(float(depth) for depth in self.focus_depth(np.array([0.0, 1.0])))
        return near, far

    def blur_diameter(self, position: Positions, depth: Positions) -> np.ndarray:
        """Diameter (m, on the sensor) of the blur of a point: c = 2R·v·|1/u_o - 1/u|, u_o its distance.

        inf for a point that the lens has reached or passed.
        """
        distance = np.asarray(depth, dtype=np.float64) - self.shift(position)
        with np.errstate(divide="ignore"):
            defocus = np.where(distance > 0, 1 / distance, np.inf) - 1 / self.object_distance(position)
        return 2 * self.aperture_radius_m * self.image_distance(position) * np.abs(defocus)

    def ray_transfer(self, position: Positions, reference: float = 0.5) -> np.ndarray:
        """A ray's way through the stack: float64 (..., 2, 2), M with (x_p, a_p) = M(p)·(x, a).

        (x, a): where a ray meets sensor and lens (m) at the position of reference, and so its slope in object
        space is s = -(x/v + a/u). (x_p, a_p): where at position p, a_p = a + s·(shift_p - shift).
        Every drive's M is linear in p: a path is a straight line through the stack. Its determinant does not
        depend on the ray: rays spread evenly at one position are spread evenly at every position.
        """
        v, u = float(self.image_distance(reference)), float(self.object_distance(reference))
        v_p, u_p = self.image_distance(position), self.object_distance(position)
        nearer = self.shift(position) - self.shift(reference)
        from_lens = np.stack([-nearer / v, 1 - nearer / u], axis=-1)
        slope = np.array([-1 / v, -1 / u])
        on_sensor = -v_p[..., None] * (slope + from_lens / u_p[..., None])
        return np.stack([on_sensor, from_lens], axis=-2)

    def as_dict(self) -> dict[str, Any]:
        """The numbers of this drive and its kind, as plain data."""
        return {"kind": self.kind, **asdict(self)}  # type: ignore[call-overload]
