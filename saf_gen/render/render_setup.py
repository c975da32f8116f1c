"""What a renderer works on: a loaded scene, the lens in front of it, and the sensor's pixels."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.core.region import Region
from saf_gen.optics import Drive
from saf_gen.stack.focal_stack import PixelGrid


@dataclass(frozen=True)
class SensorGrid:
    """Pixels of no particular sensor: rows, columns and pitch (m)."""

    rows: int
    columns: int
    pitch_m: float


@dataclass(frozen=True)
class RenderSetup:
    """A loaded scene (Mitsuba's own objects) in front of a lens with its focus drive and a sensor.

    ``to_world`` takes camera space, which looks along +z, to the world; both are in units of the scene, ``unit_m``
    metres each. ``wavelength_m`` is that of the light at the aperture; 0 leaves waves out. ``moved_m`` tells of shapes
    by how much they stand beside their place at the moment that the card shows, world axes, (3,) m.
    """

    mitsuba_scene: Any
    integrator: Any
    to_world: Any
    drive: Drive
    grid: PixelGrid
    unit_m: float = 1.0
    wavelength_m: float = 0.0
    moved_m: Mapping[str, np.ndarray] = field(default_factory=dict)

    def to_world_at(self, forward_m: float) -> Any:
        """Return the transform of camera space to the world for a lens moved ``forward_m`` metres towards the scene."""
        return self.to_world @ mi.ScalarTransform4f().translate([0, 0, forward_m / self.unit_m])


def positions_to_render(positions: int, window: tuple[int, int] | None) -> np.ndarray:
    """Return the focus positions to render, float64 (focus,).

    They are ``positions`` evenly spaced ones over the whole travel, or of these the first to the last index
    in ``window``.
    """
    first, last = window or (0, positions - 1)
    return np.linspace(0, 1, positions)[first : last + 1]


def make_mitsuba_film_dict(grid: PixelGrid, region: Region | None = None) -> dict[str, Any]:
    """Return Mitsuba's film for a sensor, or for a region of its rows and columns.

    Its box filter keeps pixels apart, where the default Gaussian mixes neighbours.
    """
    rows, columns = region or (slice(0, grid.rows), slice(0, grid.columns))
    return {
        "type": "hdrfilm",
        "width": grid.columns,
        "height": grid.rows,
        "crop_offset_x": columns.start,
        "crop_offset_y": rows.start,
        "crop_width": columns.stop - columns.start,
        "crop_height": rows.stop - rows.start,
        "rfilter": {"type": "box"},
        "pixel_format": "luminance",
        "component_format": "float32",
    }


def make_mitsuba_camera_dict(setup: RenderSetup, position: float) -> dict[str, Any]:
    """Return what every Mitsuba camera must know at a focus position: pose, field of view, film, clips.

    The clips lie at a ten-thousandth of the distance in focus and at a hundred thousand times it. Mitsuba's own, 0.01
    and 10,000 units of the scene, would hide a microscope's specimen, and all of a scene whose unit is a micrometre.
    """
    drive, grid = setup.drive, setup.grid
    distance = float(drive.object_distance(position)) / setup.unit_m
    half = grid.columns * grid.pitch_m / 2
    return {
        "to_world": setup.to_world_at(float(drive.shift(position))),
        "near_clip": 1e-4 * distance,
        "far_clip": 1e5 * distance,
        "fov_axis": "x",
        "fov": math.degrees(2 * math.atan(half / float(drive.image_distance(position)))),
        "film": make_mitsuba_film_dict(grid),
    }


def render_with_mitsuba_camera(scene: Any, camera: Any, *, integrator: Any, samples: int, seed: int = 0) -> np.ndarray:
    """Return what an integrator renders of a Mitsuba scene through a Mitsuba camera: float32 (row, col, channel).

    ``mi.render`` would keep the scene in a cycle of references for the sake of gradients; here it is released as soon
    as nobody needs it.
    """
    seed_word: Any = seed & 0xFFFFFFFF  # Mitsuba accepts an int, but its stubs want an array
    return np.array(integrator.render(scene, sensor=camera, spp=samples, seed=seed_word))
