"""What a renderer needs to know: the scene, the lens before it, and the sensor as a film."""

import math
from dataclasses import dataclass
from typing import Any

from saf_gen.optics import ImageDistance

__all__ = ["Film", "Setup", "field_of_view", "film_dict"]


@dataclass(frozen=True)
class Film:
    """Pixels and their pitch (m)."""

    rows: int
    columns: int
    pitch_m: float


@dataclass(frozen=True)
class Setup:
    """A loaded scene in front of a lens: what to trace and how, from where, through what, onto what.

    world, integrator : of Mitsuba. to_world : transform of camera space, which looks along +z.
    """

    world: Any
    integrator: Any
    to_world: Any
    drive: ImageDistance
    film: Film


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
