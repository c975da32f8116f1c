"""The lens of a stack of pictures: positions in steps from picture to picture, and nothing known of its optics."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from saf_gen.optics._drive import Drive, Positions


@dataclass(frozen=True)
class PictureSteps(Drive):
    """A drive that took pictures at equal steps; every distance of its optics is NaN.

    Attributes
    ----------
    step_um : float or None
        Distance of the focus between two pictures, µm; None if it is not known.
    """

    step_um: float | None = None

    kind: ClassVar[str] = "pictures"
    travel_key: ClassVar[str] = "step_um"
    f_number: ClassVar[float] = math.nan  # type: ignore[misc]
    transmission: ClassVar[float] = 1.0  # type: ignore[misc]
    wavefront: ClassVar[None] = None  # type: ignore[misc]
    ring: ClassVar[None] = None  # type: ignore[misc]
    distortion: ClassVar[None] = None  # type: ignore[misc]
    veiling_glare: ClassVar[float] = 0.0  # type: ignore[misc]

    @property
    def aperture_radius_m(self) -> float:
        return math.nan

    def image_distance(self, position: Positions) -> np.ndarray:
        return np.full_like(np.asarray(position, dtype=np.float64), math.nan)

    object_distance = image_distance

    def best_position(self, depth: Positions, *, defocus: Positions = 0.0) -> np.ndarray:
        return self.image_distance(depth)

    def least_blur(self, depths: np.ndarray) -> float:
        return math.nan

    def _positions_of_blur(self, focused: float, blur_m: float) -> tuple[float, float]:
        return math.nan, math.nan

    def as_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "step_um": self.step_um}
