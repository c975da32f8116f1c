"""The contact sheet of a scene, rendered for it alone: coarse, so that an author has it in seconds."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.authoring.preview.contact_sheet import ContactSheet, draw_contact_sheet
from saf_gen.camera import Sensor
from saf_gen.core.config.ranges import is_range
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene

__all__ = ["make_contact_sheet", "preview_scene", "render_small_pictures"]

POSITIONS, SAMPLES, SHARP_SAMPLES = 33, 8, 12
SLOW_POSITIONS, SLOW_SAMPLES = 9, 4
SMALLER, FEW = 2, 2  # pixels along a side that a glimpse takes as one; glimpses of a kind on a sheet
LATEST_S = 1.0  # of a recording


def preview_scene(scene: Scene, sensor: Sensor, path: Path, *, variant: str = "auto") -> None:
    """Write a scene's sheet as PNG. A target out of reach or sight is drawn as it is.

    Raises BadInput where the scene cannot be built or loaded.
    """
    draw_contact_sheet(make_contact_sheet(scene, sensor, variant=variant), path)


def make_contact_sheet(scene: Scene, sensor: Sensor, *, variant: str) -> ContactSheet:
    """What a sheet of this scene shows."""
    renderer = SceneRenderer(scene, sensor, backend_name=variant)
    seen = renderer.trace_depth_and_target(allow_unseen_target=True)
    positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if renderer.is_slow else (POSITIONS, SAMPLES)
    stack = renderer.render_stack(seen, positions=positions, samples=samples)
    sheet = ContactSheet(f"{scene.id}: {scene.card.title} ({scene.card.lens.summary})", stack, sensor)
    place = float(np.clip(np.nan_to_num(sheet.true_focus, nan=0.5), 0, 1))
    samples = SLOW_SAMPLES if renderer.is_slow else SHARP_SAMPLES
    sharp = renderer.render_pinhole(place, samples=samples)
    few = list(render_small_pictures(renderer, place, samples=max(1, samples // SMALLER), count=FEW))
    return replace(sheet, sharp=sharp, small_pictures=few)


def render_small_pictures(
    renderer: SceneRenderer, position: float, *, samples: int, count: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Small pictures, everything sharp, with a word each: of members of the family, and of moments."""
    scene, grid = renderer.scene, renderer.grid
    grid = SensorGrid(grid.rows // SMALLER, grid.columns // SMALLER, grid.pitch_m * SMALLER)
    if any(is_range(value) for value in scene.card.params.values()):
        for n in range(count):
            member = SceneRenderer(scene.draw_member("preview", n), grid, backend_name=renderer.backend_name)
            yield f"member {n + 1}", member.render_pinhole(position, samples=samples)
    if renderer.motions:
        last = max(k.time_s for motion in renderer.motions.values() for k in motion.keyframes)
        for time_s in np.linspace(0, min(last, LATEST_S) if last > 0 else LATEST_S, count):
            picture = renderer.render_pinhole(position, samples=samples, time_s=float(time_s), grid=grid)
            yield f"{time_s:.2f} s", picture
