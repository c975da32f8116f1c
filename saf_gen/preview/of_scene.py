"""The contact sheet of a scene, rendered for it alone: coarse, so that an author has it in seconds."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.preview.sheet import Sheet, draw
from saf_gen.ranges import is_range
from saf_gen.render.film import Film
from saf_gen.render.studio import Studio
from saf_gen.scene import Scene

__all__ = ["glimpses", "preview_scene", "sheet_of"]

POSITIONS, SAMPLES, SHARP_SAMPLES = 33, 8, 12
SLOW_POSITIONS, SLOW_SAMPLES = 9, 4
SMALLER, FEW = 2, 2  # pixels along a side that a glimpse takes as one; glimpses of a kind on a sheet
LATEST_S = 1.0  # of a recording


def preview_scene(scene: Scene, sensor: Sensor, path: Path, *, variant: str = "auto") -> None:
    """Write a scene's sheet as PNG. A target out of reach or sight is drawn as it is.

    Raises BadInput where the scene cannot be built or loaded.
    """
    draw(sheet_of(scene, sensor, variant=variant), path)


def sheet_of(scene: Scene, sensor: Sensor, *, variant: str) -> Sheet:
    """What a sheet of this scene shows."""
    studio = Studio(scene, Film(sensor.rows, sensor.columns, sensor.pitch_m), variant_name=variant)
    seen = studio.look(passing=True)
    positions, samples = (SLOW_POSITIONS, SLOW_SAMPLES) if studio.is_slow else (POSITIONS, SAMPLES)
    stack = studio.stack(seen, positions=positions, samples=samples)
    sheet = Sheet(f"{scene.id}: {scene.card.title} ({scene.card.lens.words})", stack, sensor)
    place = float(np.clip(np.nan_to_num(sheet.truth, nan=0.5), 0, 1))
    samples = SLOW_SAMPLES if studio.is_slow else SHARP_SAMPLES
    sharp = studio.sharp(place, samples=samples)
    few = list(glimpses(studio, place, samples=max(1, samples // SMALLER), count=FEW))
    return replace(sheet, sharp=sharp, glimpses=few)


def glimpses(
    studio: Studio, position: float, *, samples: int, count: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Small pictures, everything sharp, with a word each: of members of the family, and of moments."""
    scene, film = studio.scene, studio.film
    film = Film(film.rows // SMALLER, film.columns // SMALLER, film.pitch_m * SMALLER)
    if any(is_range(value) for value in scene.card.params.values()):
        for n in range(count):
            member = Studio(scene.drawn("preview", n), film, variant_name=studio.variant_name)
            yield f"member {n + 1}", member.sharp(position, samples=samples)
    if studio.motions:
        last = max(k.time_s for motion in studio.motions.values() for k in motion.keyframes)
        for time_s in np.linspace(0, min(last, LATEST_S) if last > 0 else LATEST_S, count):
            picture = studio.sharp(position, samples=samples, time_s=float(time_s), film=film)
            yield f"{time_s:.2f} s", picture
