"""What a renderer needs to know: the scene, the lens before it, and the sensor as a film."""

import math
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.core.region import Region
from saf_gen.optics import Drive

__all__ = ["RenderSetup", "SensorGrid", "make_camera_dict", "make_film_dict", "rendered_positions"]


@dataclass(frozen=True)
class SensorGrid:
    """Pixels and their pitch (m)."""

    rows: int
    columns: int
    pitch_m: float


@dataclass(frozen=True)
class RenderSetup:
    """A loaded scene in front of a lens: what to trace and how, from where, through what, onto what.

    mitsuba_scene, integrator : of Mitsuba. to_world : transform of camera space, which looks along +z, to
    the world; both in units of the scene, ``unit_m`` metres each.
    """

    mitsuba_scene: Any
    integrator: Any
    to_world: Any
    drive: Drive
    film: SensorGrid
    unit_m: float = 1.0

    def to_world_at(self, forward_m: float) -> Any:
        """Camera space (scene units) to the world, the lens moved this far (m) towards the scene."""
        return self.to_world @ mi.ScalarTransform4f().translate([0, 0, forward_m / self.unit_m])


def rendered_positions(positions: int, window: tuple[int, int] | None) -> np.ndarray:
    """The positions to render, float64 (focus,): of so many over the whole travel the first to the last."""
    first, last = window or (0, positions - 1)
    return np.linspace(0, 1, positions)[first : last + 1]


def make_film_dict(film: SensorGrid, region: Region | None = None) -> dict[str, Any]:
    """A film with a box filter: each pixel on its own, where the default Gaussian mixes neighbours.

    ``region``: only these rows and columns of it.
    """
    rows, columns = region or (slice(0, film.rows), slice(0, film.columns))
    return {
        "type": "hdrfilm",
        "width": film.columns,
        "height": film.rows,
        "crop_offset_x": columns.start,
        "crop_offset_y": rows.start,
        "crop_width": columns.stop - columns.start,
        "crop_height": rows.stop - rows.start,
        "rfilter": {"type": "box"},
        "pixel_format": "luminance",
        "component_format": "float32",
    }


def make_camera_dict(setup: RenderSetup, position: float) -> dict[str, Any]:
    """What any Mitsuba sensor in place of the lens must know: pose, field of view, film, clips.

    The clips lie at a ten-thousandth of the distance in focus and at a hundred thousand times it: Mitsuba's
    own, 0.01 and 10,000 units of the scene, hide a specimen, and all of it where a unit is a micrometre.
    """
    drive, film = setup.drive, setup.film
    distance = float(drive.object_distance(position)) / setup.unit_m
    half = film.columns * film.pitch_m / 2
    return {
        "to_world": setup.to_world_at(float(drive.shift(position))),
        "near_clip": 1e-4 * distance,
        "far_clip": 1e5 * distance,
        "fov_axis": "x",
        "fov": math.degrees(2 * math.atan(half / float(drive.image_distance(position)))),
        "film": make_film_dict(film),
    }
