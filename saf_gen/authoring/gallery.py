"""A page with a picture and the numbers of every scene: docs/scenes.md is made by this."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.authoring.preview import encode_gamma, render_small_pictures, save_image_grid, white_level
from saf_gen.camera import Sensor
from saf_gen.core.config.ranges import extreme_values, is_range
from saf_gen.core.files import write_text_atomically
from saf_gen.errors import BadInput
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene, SceneCard

__all__ = ["write_gallery"]

MOST_BYTES = 100_000  # of a picture: it is cloned with the project
SAMPLES, SLOW_SAMPLES, SMALL_SAMPLES = 32, 4, 24  # a pixel of the pictures; of the small ones
GLIMPSES = 3  # members, and moments
HEAD = f"""# Scenes

The upper row of a picture has one end of the lens's travel, the true focus of the target, and the other
end. Below are members of the scene's family, drawn at random, and of a scene that moves the first moment of a
second, its middle and its end. It is what the camera sees; a file has at most {MOST_BYTES // 1000} kB.

This page is made by one command, and made again when a scene has changed:

```
saf-gen scenes gallery
```
"""


def write_gallery(
    scenes: Sequence[Scene],
    sensor: Sensor,
    folder: Path,
    *,
    variant: str = "auto",
    progress: Callable[[str], None] = lambda name: None,
) -> tuple[Path, dict[str, BadInput]]:
    """Write ``folder/scenes.md`` and ``folder/pictures/scenes/<id>.jpg``; gives the page, and what failed.

    A scene that cannot be drawn is left out, and told by its name. ``progress`` is told each name.
    """
    parts, failed = [HEAD], {}
    for scene in scenes:
        progress(scene.id)
        try:
            view = _View.of(scene, sensor, variant)
        except BadInput as problem:
            failed[scene.id] = problem
            continue
        picture = folder / "pictures" / "scenes" / f"{scene.id}.jpg"
        save_image_grid(view.rows, picture, max_bytes=MOST_BYTES)
        parts.append(_section(scene, view, picture.relative_to(folder), folder))
    page = folder / "scenes.md"
    write_text_atomically(page, "\n".join(parts))
    return page, failed


@dataclass(frozen=True)
class _View:
    """Grey pictures in rows, 0...1, and where the target is: pixels, depth, true focus (NaN out of sight)."""

    rows: list[list[np.ndarray]]
    seen: DepthAndTarget
    truth: float

    @classmethod
    def of(cls, scene: Scene, sensor: Sensor, variant: str) -> "_View":
        renderer = SceneRenderer(scene, sensor, backend_name=variant)
        seen = renderer.trace_depth_and_target(allow_unseen_target=True)
        depths = seen.depth[seen.target]
        truth = scene.build_drive().true_focus(depths) if depths.size else float("nan")
        best = float(np.clip(np.nan_to_num(truth, nan=0.5), 0, 1))
        samples = SLOW_SAMPLES if renderer.is_slow else SAMPLES
        whole = slice(0, sensor.rows), slice(0, sensor.columns)
        pictures = [renderer.render_region(p, samples=samples, region=whole) for p in (0.0, best, 1.0)]
        white = white_level(pictures[1])
        rows = [[encode_gamma(picture, white) for picture in pictures]]
        samples = SLOW_SAMPLES if renderer.is_slow else SMALL_SAMPLES
        small = [
            picture for _, picture in render_small_pictures(renderer, best, samples=samples, count=GLIMPSES)
        ]
        if small:
            rows.append([encode_gamma(picture, white_level(picture)) for picture in small])
        return cls(rows, seen, truth)


def _section(scene: Scene, view: _View, picture: Path, folder: Path) -> str:
    card, seen = scene.card, view.seen
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
        "light": ", ".join(_light(group, card.illuminance_lux) for group in card.lights),
        "family": "; ".join(_param(*param) for param in card.params.items() if is_range(param[1])),
        "motion": _motion(card),
        "licence": card.licence,
        "source": _source(scene, folder),
    }
    table = [f"| {key} | {value} |" for key, value in rows.items() if value]
    image = f"![{card.title}]({picture.as_posix()})"
    return "\n".join(
        [f"## {scene.id}", "", f"{card.title}.", "", image, "", "| | |", "|---|---|", *table, ""]
    )


def _light(group: str, lux: Any) -> str:
    return f"`{group}` {lux[group]:,g} lux" if group in lux else f"`{group}`"


def _motion(card: SceneCard) -> str:
    if card.slices_per_s is None:
        return ""
    error = card.interpolation_error
    off = "" if error is None else f", half way between two at most {100 * error:.2g} % off"
    return f"{card.slices_per_s:g} time slices a second{off}"


def _param(name: str, value: Any) -> str:
    among = extreme_values(value)
    if "choice" in value:
        return f"`{name}` {', '.join(str(one) for one in dict.fromkeys(among))}"
    return f"`{name}` {among[0]:,.10g} to {among[1]:,.10g}"


def _source(scene: Scene, folder: Path) -> str:
    source = scene.card.source
    if not (scene.folder / source).is_file():
        return source
    return f"[{source}]({Path(os.path.relpath(scene.folder / source, folder)).as_posix()})"
