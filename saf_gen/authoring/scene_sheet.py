"""The contact sheet of a scene, rendered coarsely so that its author can see it within seconds."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.authoring.contact_sheet import ContactSheet, draw_sheet, sheet_form
from saf_gen.camera import Sensor
from saf_gen.core.config.ranges import is_range
from saf_gen.render import make_renderer
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.keyframes import motion_end_s
from saf_gen.scene.scene_folder import Scene

POSITIONS, SAMPLES, SHARP_SAMPLES = 33, 8, 12
SLOW_POSITIONS, SLOW_SAMPLES = 9, 4
SHRINK, SMALL_IMAGES = 2, 2  # factor by which the sides of small images are shorter; number of images of each kind
RECORDING_S = 1.0
STACK_SHARE = 0.9  # of the time for the sheet


def preview_scene(
    scene: Scene,
    sensor: Sensor,
    *,
    path: Path,
    backend: str = "auto",
    progress: Callable[[float], None] = lambda done: None,
) -> None:
    """Write the contact sheet of a scene as PNG or SVG, by the ending of ``path``.

    The target may be out of reach or out of sight. ``progress`` gets the fraction done, 0 to 1. Raises BadInput before
    anything is rendered if the file has another ending, and if the scene cannot be built or loaded.
    """
    sheet_form(path)
    draw_sheet(make_sheet(scene, sensor, backend=backend, progress=progress), path)


def make_sheet(
    scene: Scene, sensor: Sensor, *, backend: str, progress: Callable[[float], None] = lambda done: None
) -> ContactSheet:
    """Render the content of the contact sheet of a scene, and return it."""
    renderer = make_renderer(scene, sensor, backend_name=backend, wavelength_m=sensor.wavelength_m)
    seen = renderer.trace_geometry(allow_unseen_target=True)
    positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if renderer.is_slow else (POSITIONS, SAMPLES)
    stack = renderer.render_stack(
        seen, positions=positions, samples=samples, progress=lambda done: progress(STACK_SHARE * done)
    )
    sheet = ContactSheet(f"{scene.id}: {scene.card.title} ({scene.card.lens.summary})", stack, sensor)
    position = float(np.clip(np.nan_to_num(sheet.true_focus, nan=0.5), 0, 1))
    samples = SLOW_SAMPLES if renderer.is_slow else SHARP_SAMPLES
    sharp = None if scene.card.section is not None else renderer.render_pinhole(position, samples=samples)
    samples = max(1, samples // SHRINK)
    small = list(render_images(renderer, position, samples=samples, count=SMALL_IMAGES))
    return replace(sheet, sharp=sharp, small_images=small)


def render_images(
    renderer: SceneRenderer, position: float, *, samples: int, count: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield captions and small, sharp images of members of the family and of moments of a moving scene."""
    scene, grid = renderer.scene, renderer.grid
    grid = SensorGrid(grid.rows // SHRINK, grid.columns // SHRINK, grid.pitch_m * SHRINK)
    if any(is_range(value) for value in scene.card.params.values()):
        for n in range(count):
            member = make_renderer(scene.draw_member("preview", n), grid, backend_name=renderer.backend_name)
            yield f"member {n + 1}", member.render_pinhole(position, samples=samples)
    if renderer.motions:
        for time_s in np.linspace(0, motion_end_s(renderer.motions, recording_s=RECORDING_S), count):
            image = renderer.render_pinhole(position, samples=samples, time_s=float(time_s), grid=grid)
            yield f"{time_s:.2f} s", image
