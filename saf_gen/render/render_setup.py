"""Input of a renderer: a loaded scene, the lens in front of it, and the pixels of the sensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.core.region import Region
from saf_gen.optics import Drive, FocusCriterion
from saf_gen.stack.focal_stack import PixelGrid, focus_positions


@dataclass(frozen=True)
class SensorGrid:
    """A grid of pixels that belongs to no particular sensor: rows, columns and pitch (m)."""

    rows: int
    columns: int
    pitch_m: float


@dataclass(frozen=True)
class RenderSetup:
    """A loaded scene (Mitsuba objects) in front of a lens with its focus drive and a sensor.

    Attributes
    ----------
    mitsuba_scene, integrator : mi.Scene, mi.Integrator
        Scene, lit by some of its emitters, and the integrator that traces it.
    to_world : mi.ScalarTransform4f
        Transform from camera space, which looks along +z, to the world; both are in units of the scene.
    drive : Drive
        Focus drive of the lens.
    grid : PixelGrid
        Pixels of the sensor.
    unit_m : float, default 1.0
        Metres per unit of the scene.
    wavelength_m : float, default 0.0
        Wavelength (m) of the light at the aperture; 0 leaves out diffraction.
    moved_m : mapping of str to ndarray of float64, shape (3,)
        Displacement (m, world axes) of each shape from its position at the moment that the card shows.
    travel : tuple of float, default (0.0, 1.0)
        First and last position of the lens in any picture: beyond the travel if lens and lamps have colour.
    """

    mitsuba_scene: Any
    integrator: Any
    to_world: Any
    drive: Drive
    grid: PixelGrid
    unit_m: float = 1.0
    wavelength_m: float = 0.0
    moved_m: Mapping[str, np.ndarray] = field(default_factory=dict)
    travel: tuple[float, float] = (0.0, 1.0)

    @property
    def in_focus(self) -> FocusCriterion:
        """What counts as in focus."""
        return FocusCriterion(self.drive, self.grid.pitch_m, self.wavelength_m)

    def to_world_at(self, forward_m: float) -> Any:
        """Return the transform from camera space to the world for a lens moved by ``forward_m`` towards the scene."""
        return self.to_world @ mi.ScalarTransform4f().translate([0, 0, forward_m / self.unit_m])


def positions_to_render(positions: int, window: tuple[int, int] | None) -> np.ndarray:
    """Return the focus positions to render, as fractions of the travel, float64 (focus,).

    They are evenly spaced: ``positions`` over the full travel, of which ``window`` holds the first and last index. Both
    may be beyond the ends.
    """
    first, last = window or (0, positions - 1)
    return focus_positions(positions, first, count=last - first + 1)


def film_dict(grid: PixelGrid, region: Region | None = None) -> dict[str, Any]:
    """Return Mitsuba's film for a sensor, or for a region of its rows and columns.

    Its box filter keeps pixels separate; Mitsuba's default, a Gaussian, would mix neighbours.
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


def camera_dict(setup: RenderSetup, position: float) -> dict[str, Any]:
    """Return every Mitsuba camera's settings at a focus position: pose, field of view, film, and clipping distances.

    The clipping distances are a ten-thousandth of the distance in focus, and a hundred thousand times it. The defaults
    of Mitsuba are 0.01 and 10,000 units of the scene, which would hide a microscope's specimen, and everything in a
    scene whose unit is a micrometre.
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
        "film": film_dict(grid),
    }


def render_with_camera(scene: Any, camera: Any, *, integrator: Any, samples: int, seed: int = 0) -> np.ndarray:
    """Return the image that an integrator renders of a Mitsuba scene through a camera, float32 (row, col, channel).

    ``mi.render`` would keep the scene alive in a cycle of references that gradients need; here it is released as soon
    as nothing refers to it.
    """
    seed_word: Any = seed & 0xFFFFFFFF  # Mitsuba accepts an int, but its stubs want an array
    return np.array(integrator.render(scene, sensor=camera, spp=samples, seed=seed_word))
