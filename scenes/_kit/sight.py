"""What a lens sees: millimetres for a pixel and for half a depth of focus where the target is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

PIXEL_MM, FRAME_PX, WAVE_MM = 0.02, 128, 555e-6


class Sight(NamedTuple):
    """Where in the travel the target is in focus, 0 to 1, and how many half depths of focus the travel has.

    Distances (mm) from the lens, as on the card and in focus; mm for a pixel and half a depth of focus.
    """

    place: float
    travel: float
    away: float
    focused: float
    pixel: float
    half: float

    def scale(self, halves: Any) -> Any:
        """Millimetres that a pixel sees so many half depths of focus behind the target's middle."""
        return self.pixel * (1 + self.half * np.asarray(halves, dtype=np.float64) / self.focused)

    def at(self, x_px: Any, y_px: Any, halves: Any = 0.0) -> np.ndarray:
        """World points (mm): pixels right and up from the middle of the picture, half depths behind."""
        depth = self.away + self.half * np.asarray(halves, dtype=np.float64)
        scale = self.scale(halves)
        return np.stack(np.broadcast_arrays(x_px * scale, y_px * scale, -depth), axis=-1)


def look(lens: Mapping[str, Any], place_deg: float) -> Sight:
    """What a lens, by the keys of a scene card, sees of a target; the card says what ``place_deg`` is."""
    drive, place = lens["drive"], float(0.5 - 0.46 * np.cos(np.radians(place_deg)))
    f = lens["image_distance_mm" if drive == "focal_length" else "focal_length_mm"]
    radius = f / (2 * lens["f_number"])
    if drive == "stage":
        first, last = (1e3 * m for m in lens["travel_m"])
        focused, image = f * (1 + 1 / lens["magnification"]), f * (1 + lens["magnification"])
        way, shift = abs(last - first), first + (last - first) * place
    else:
        # Position is linear in the image distance, or in the vergence if the power changes.
        first, last = (1e3 * m for m in lens["focus_range_m"])
        moves = drive == "image_distance"
        ends = [1 / (1 / f - 1 / u) if moves else 1 / u for u in (first, last)]
        middle = ends[0] + (ends[1] - ends[0]) * place
        image, focused = (middle, 1 / (1 / f - 1 / middle)) if moves else (f, 1 / middle)
        way, shift = abs(1 / first - 1 / last) * focused**2, 0.0
    resolved = np.hypot(PIXEL_MM, WAVE_MM * image / radius)
    half = resolved * focused**2 / (2 * radius * image)
    return Sight(place, way / half, focused + shift, focused, PIXEL_MM * focused / image, half)
