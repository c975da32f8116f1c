"""The sensor as the renderer sees it."""

import math
from dataclasses import dataclass
from typing import Any

__all__ = ["Film", "field_of_view", "film_dict"]


@dataclass(frozen=True)
class Film:
    """Pixels and their pitch (m)."""

    rows: int
    columns: int
    pitch_m: float


def film_dict(film: Film) -> dict[str, Any]:
    """A film with a box filter: each pixel on its own, where the default Gaussian mixes neighbours."""
    return {
        "type": "hdrfilm",
        "width": film.columns,
        "height": film.rows,
        "rfilter": {"type": "box"},
        "pixel_format": "luminance",
        "component_format": "float32",
    }


def field_of_view(film: Film, image_distance: float) -> dict[str, Any]:
    """The horizontal field of view of the sensor at this image distance, in Mitsuba's terms."""
    half = film.columns * film.pitch_m / 2
    return {"fov_axis": "x", "fov": math.degrees(2 * math.atan(half / image_distance))}
