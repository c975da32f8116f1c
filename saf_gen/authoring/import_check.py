"""The check of an imported scene: its source's own camera, rendered by Mitsuba in RGB, beside the imported scene.

Mitsuba reads no glTF: the source is then the scene.xml that was written from it. What an import reads otherwise than
Mitsuba shows there, be it a pose, a lamp or a colour.
"""

from pathlib import Path

import numpy as np

from saf_gen.authoring.meshes import encode_png
from saf_gen.render.exported_camera import SENSOR_WIDTH_M, source_pictures
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import COMPARISON, load_scene

COLUMNS, ROWS, BLOCK, ENLARGED, SAMPLES = 96, 60, 6, 4, 64
DARK = 0.25  # of the mean: differences of darker blocks count as if they had this brightness


def compare_with_source(folder: Path, *, camera: str = "", variant: str = "auto") -> str:
    """Write the picture of a scene's source, that of the scene, and their difference, and return a line about them.

    Differences are those of blocks of 6 × 6 pixels. The noise is that of the source's picture, from two halves of it.
    ``camera`` is the id of the source's camera, in place of the first.

    Raises BadInput if one of them cannot be rendered.
    """
    grid = SensorGrid(ROWS, COLUMNS, SENSOR_WIDTH_M / COLUMNS)
    halves = source_pictures(folder / "scene.xml", grid, samples=SAMPLES, camera=camera)
    source = halves.mean(axis=0)
    scene = load_scene(folder)
    pose = scene.card.camera
    position = scene.build_drive().best_position(float(np.linalg.norm(np.subtract(pose.look_at_m, pose.origin_m))))
    renderer = SceneRenderer(scene, grid, backend_name=variant)
    imported = renderer.render_pinhole(float(position), samples=SAMPLES)
    _write(folder / COMPARISON, source, imported=imported)
    theirs, ours, noise = (_blocks(picture) for picture in (source, imported, (halves[1] - halves[0]) / 2))
    apart, noise = (np.abs(by) / np.maximum(theirs, DARK * theirs.mean()) for by in (ours - theirs, noise))
    row, column = np.unravel_index(int(np.nanargmax(apart)), apart.shape)
    place = f"{(column + 0.5) * BLOCK / COLUMNS:.0%} from the left, {(row + 0.5) * BLOCK / ROWS:.0%} from the top"
    rms, noise_rms = (np.sqrt(np.mean(share**2)) for share in (apart, noise))
    return (
        f"picture: apart from Mitsuba's of scene.xml by at most {apart[row, column]:.0%} (noise: {noise.max():.0%}), "
        f"{place}, and by {rms:.1%} rms (noise: {noise_rms:.1%}); "
        f"{folder / COMPARISON} shows source, scene and difference"
    )


def _blocks(picture: np.ndarray) -> np.ndarray:
    """Return the means of blocks of pixels."""
    rows, columns = picture.shape
    return np.asarray(
        picture.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).mean(axis=(1, 3), dtype=np.float64)
    )


def _write(path: Path, source: np.ndarray, *, imported: np.ndarray) -> None:
    """Write both pictures and their difference side by side, with the same white."""
    white = max(float(np.quantile(source, 0.99)), 1e-30)
    parts = np.concatenate([source, imported, np.abs(imported - source)], axis=1)
    grey = np.round(255 * np.clip(parts / white, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    path.write_bytes(encode_png(np.kron(grey, np.ones((ENLARGED, ENLARGED), np.uint8))))
