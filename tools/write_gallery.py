"""Write the gallery of scenes, docs/scenes.md: a picture and the figures of every scene.

python tools/write_gallery.py [SCENE...] [--out docs]
"""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imsave

from saf_gen.authoring.scene_sheet import render_images
from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.config.ranges import is_range, range_extremes
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.files import atomic_file, write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.errors import BadInput
from saf_gen.render import make_renderer
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.scene.scene_folder import Scene, SceneCard, find_scene, scene_names

GAP = 4  # pixels between two images
MAX_BYTES = 100_000  # per image file, because these are part of the repository
SAMPLES, SLOW_SAMPLES, SMALL_SAMPLES = 16, 4, 8  # per pixel; SMALL_SAMPLES is for the small images
SMALL_IMAGES = 3  # number of members, and of moments
HEAD = f"""# Scenes

The upper row of an image shows what the camera sees at one end of the lens's travel, at the true focus of the
target, and at the other end. The lower row shows members of the scene's family, drawn at random, and for a
moving scene the start, the middle and the end of a second. An image file has at most {MAX_BYTES // 1000} kB.

This page is written by one command. Run it again after a scene has changed:

```
python tools/write_gallery.py
```
"""


def write_gallery(scenes: Sequence[Scene], sensor: Sensor, *, folder: Path, backend: str) -> dict[str, BadInput]:
    """Write ``folder/scenes.md`` and ``folder/pictures/scenes/<id>.jpg``.

    Return the error of each scene that could not be rendered and was left out, by name.
    """
    sections, failed = [HEAD], {}
    for scene in scenes:
        print(scene.id, flush=True)
        try:
            view = View.render(scene, sensor, backend=backend)
        except BadInput as problem:
            failed[scene.id] = problem
            continue
        picture = folder / "pictures" / "scenes" / f"{scene.id}.jpg"
        save_grid(view.rows, picture, max_bytes=MAX_BYTES)
        sections.append(section(scene, view, picture=picture, folder=folder))
    write_text(folder / "scenes.md", "\n".join(sections))
    return failed


@dataclass(frozen=True)
class View:
    """Rows of grey images (0 to 1), depth and target, and the true focus (NaN if the target is out of sight)."""

    rows: list[list[np.ndarray]]
    seen: DepthAndTarget
    truth: float

    @classmethod
    def render(cls, scene: Scene, sensor: Sensor, *, backend: str) -> "View":
        renderer = make_renderer(scene, sensor, backend_name=backend, wavelength_m=sensor.wavelength_m)
        seen = renderer.trace_geometry(allow_unseen_target=True)
        depths = seen.depth[seen.target]
        truth = scene.build_drive().least_blur(depths) if depths.size else float("nan")
        best = float(np.clip(np.nan_to_num(truth, nan=0.5), 0, 1))
        samples = SLOW_SAMPLES if renderer.is_slow else SAMPLES
        images = [renderer.render_picture(p, samples=samples) for p in (0.0, best, 1.0)]
        white = white_level(images[1])
        rows = [[display_gamma(image, white) for image in images]]
        samples = SLOW_SAMPLES if renderer.is_slow else SMALL_SAMPLES
        small = [image for _, image in render_images(renderer, best, samples=samples, count=SMALL_IMAGES)]
        if small:
            rows.append([display_gamma(image, white_level(image)) for image in small])
        return cls(rows, seen, truth)


def section(scene: Scene, view: View, *, picture: Path, folder: Path) -> str:
    card, seen, lux = scene.card, view.seen, scene.card.illuminance_lux
    depths = seen.depth[seen.target]
    near, far = scene.build_drive().focusing_range_m
    drive = "" if card.lens.drive in card.lens.summary else f", `{card.lens.drive}`"
    target = ", ".join(f"`{name}`" for name in card.target)
    if depths.size:
        target += f", {np.median(depths):.4g} m away, {seen.target.mean():.0%} of the frame"
        target += f", in focus at {view.truth:.3f} of the travel"
    rows = {
        "lens": f"{card.lens.summary}{drive}, in focus from {near:.4g} to {far:.4g} m",
        "target": target,
        "light": ", ".join(f"`{group}` {lux[group]:,g} lux" if group in lux else f"`{group}`" for group in card.lights),
        "family": "; ".join(param_range(*param) for param in card.params.items() if is_range(param[1])),
        "motion": motion(card),
        "licence": card.licence,
        "source": source_link(scene, folder),
    }
    table = [f"| {key} | {value} |" for key, value in rows.items() if value]
    image = f"![{escape_markdown(card.title)}]({picture.relative_to(folder).as_posix()})"
    return "\n".join(
        [f"## {scene.id}", "", f"{escape_markdown(card.title)}.", "", image, "", "| | |", "|---|---|", *table, ""]
    )


def motion(card: SceneCard) -> str:
    if card.slices_per_s is None:
        return ""
    error = card.interpolation_error
    limit = "" if error is None else f", interpolated with an error of at most {100 * error:.2g} %"
    return f"{card.slices_per_s:g} time slices per second{limit}"


def param_range(name: str, value: Any) -> str:
    values = range_extremes(value)
    if "choice" in value:
        return f"`{name}` {', '.join(str(choice) for choice in dict.fromkeys(values))}"
    return f"`{name}` {values[0]:,.10g} to {values[1]:,.10g}"


def source_link(scene: Scene, folder: Path) -> str:
    source = scene.card.source
    if not (scene.folder / source).is_file():
        return source
    return f"[{source}]({Path(os.path.relpath(scene.folder / source, folder)).as_posix()})"


def save_grid(rows: Sequence[Sequence[np.ndarray]], path: Path, *, max_bytes: int) -> None:
    """Write rows of grey images (0 to 1, of equal height in a row) as JPEG, with at most ``max_bytes`` if possible."""
    height = sum(row[0].shape[0] + GAP for row in rows) - GAP
    sheet = np.ones((height, max(sum(image.shape[1] + GAP for image in row) - GAP for row in rows)))
    y = 0
    for row in rows:
        x = 0
        for image in row:
            sheet[y : y + image.shape[0], x : x + image.shape[1]] = image
            x += image.shape[1] + GAP
        y += row[0].shape[0] + GAP
    with atomic_file(path) as temporary:
        for quality in (90, 85, 80, 70, 60, 45, 30):
            options = {"quality": quality, "optimize": True}
            imsave(temporary, sheet, cmap="gray", vmin=0, vmax=1, format="jpg", pil_kwargs=options)
            if temporary.stat().st_size <= max_bytes:
                break


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of scenes (default: all)")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder for scenes.md and its pictures")
    parser.add_argument("--sensor", default="vidar_400x250")
    parser.add_argument("--variant", default="auto")
    given = parser.parse_args(argv)
    try:
        scenes = [find_scene(name) for name in given.scenes or scene_names()]
        failed = write_gallery(scenes, get_sensor(given.sensor), folder=given.out, backend=given.variant)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    for name, problem in failed.items():
        print(f"{name} could not be drawn: {problem}", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
