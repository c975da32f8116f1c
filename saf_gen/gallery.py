"""A page with a picture and the numbers of every scene: docs/scenes.md is made by this."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.dataset import write_text
from saf_gen.errors import BadInput
from saf_gen.preview import Sheet, encoded, save_grid, sheet_of, white_of
from saf_gen.ranges import ends, is_range
from saf_gen.scene import Scene

__all__ = ["write_gallery"]

MOST_BYTES = 150_000
HEAD = """# Scenes

Each picture has in its first row one end of the lens's travel, the true focus of the target, and the other
end. A second row has members of the scene's family, drawn at random; the last row of a scene that moves has
moments of a second. Made by `saf-gen scenes gallery`.
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
            sheet = sheet_of(scene, sensor, variant=variant, smaller=1)
        except BadInput as problem:
            failed[scene.id] = problem
            continue
        picture = folder / "pictures" / "scenes" / f"{scene.id}.jpg"
        save_grid(_rows(sheet), picture, most_bytes=MOST_BYTES)
        parts.append(_section(scene, sheet, picture.relative_to(folder), folder))
    page = folder / "scenes.md"
    write_text(page, "\n".join(parts))
    return page, failed


def _rows(sheet: Sheet) -> list[list[np.ndarray]]:
    image, focus = sheet.stack.radiance.sum(axis=0), sheet.stack.spec.focus
    best = int(np.abs(focus - np.nan_to_num(sheet.truth, nan=0.5)).argmin())
    white = white_of(image[best])
    rows = [[encoded(image[k], white) for k in (0, best, len(focus) - 1)]]
    others = [encoded(picture, white_of(picture)) for _, picture in sheet.glimpses]
    return rows + [others[n : n + 3] for n in range(0, len(others), 3)]


def _section(scene: Scene, sheet: Sheet, picture: Path, folder: Path) -> str:
    card, stack = scene.card, sheet.stack
    depths = stack.depth[stack.target]
    near, far = scene.drive().reach_m
    target = ", ".join(f"`{name}`" for name in card.target)
    if depths.size:
        target += f", {np.median(depths):.4g} m away, {stack.target.mean():.0%} of the frame"
        target += f", in focus at {sheet.truth:.3f} of the travel"
    rows = {
        "lens": f"{card.lens.words}, `{card.lens.drive}`, in focus from {near:.4g} to {far:.4g} m",
        "target": target,
        "light": ", ".join(_light(group, card.illuminance_lux) for group in card.lights),
        "family": "; ".join(_param(*param) for param in card.params.items() if is_range(param[1])),
        "motion": f"{card.slices_per_s:g} time slices a second" if card.slices_per_s else "",
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


def _param(name: str, value: Any) -> str:
    among = ends(value)
    if "choice" in value:
        return f"`{name}` {', '.join(str(one) for one in dict.fromkeys(among))}"
    return f"`{name}` {among[0]:g} to {among[1]:g}"


def _source(scene: Scene, folder: Path) -> str:
    source = scene.card.source
    if not (scene.folder / source).is_file():
        return source
    return f"[{source}]({Path(os.path.relpath(scene.folder / source, folder)).as_posix()})"
