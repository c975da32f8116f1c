"""Write the gallery of scenes, docs/scenes.md: pictures and a line about every scene.

python tools/write_gallery.py [SCENE...] [--out docs] [--samples 1024] [--keep]
"""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

import numpy as np
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from saf_gen.authoring.scene_sheet import render_images
from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.config.ranges import is_range
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.files import atomic_file, write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.errors import BadInput
from saf_gen.render import make_renderer
from saf_gen.render.depth_and_target import DepthAndTarget
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import Scene, find_scene, scene_names

GAP = 10  # pixels between two images of the upper row
LABEL, TYPE = 26, 18  # pixels: height of the strip above an image, and size of the letters in it
MAX_BYTES = 140_000  # per image file, because these are part of the repository
THUMBNAIL = 200  # pixels: width of the pictures at the head of the page
SAMPLES, SLOW_SAMPLES = 1024, 4  # per pixel; the latter for a backend that renders position by position
POSITIONS = 129  # of the stack from which the upper row is taken: one trace serves all three
SMALL_IMAGES = 6  # of half the size: members, moments, or three of each
FONT = Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
BLANK = 0.01  # spread of grey values below which a thumbnail shows nothing, as of a section that only delays light
HEAD = """# Scenes

{table}

{moving}

The upper row of a sheet shows what the camera sees at both ends of the lens's travel and, between them, at the true
focus of the target. The lower row shows members of the scene's family, drawn at random, and a moving scene at moments
of a second, all sharp. Distances are those in focus at the ends of the travel. `python tools/write_gallery.py` writes
this page, with `--keep` without rendering what is there.
"""


def write_gallery(
    scenes: Sequence[Scene], sensor: Sensor, *, folder: Path, backend: str, samples: int = SAMPLES, keep: bool = False
) -> dict[str, BadInput]:
    """Write ``folder/scenes.md``, and ``<id>.jpg`` and ``thumbnails/<id>.jpg`` in ``folder/pictures/scenes``.

    keep : whether to use pictures that are already there. Return the error of each scene that could not be rendered
    and was left out, by name.
    """
    sections, failed = {}, {}
    for scene in scenes:
        print(scene.id, flush=True)
        picture = folder / "pictures" / "scenes" / f"{scene.id}.jpg"
        small = picture.parent / "thumbnails" / picture.name
        try:
            if not (keep and picture.is_file() and small.is_file()):
                rows = View.trace(scene, sensor, backend=backend).render(samples=samples)
                save_grid(rows, picture, max_bytes=MAX_BYTES)
                end, focused, _ = (image for _, image in rows[0])
                save_thumbnail(end if focused.std() < BLANK else focused, small)
        except BadInput as problem:
            failed[scene.id] = problem
            continue
        sections[scene.id] = section(scene, picture=picture, folder=folder)
    moving = ", ".join(f"`{scene.id}`" for scene in scenes if scene.id in sections and scene.card.slices_per_s)
    known = "`saf-gen scenes show NAME` prints the target, the light and the parameters of a scene."
    at_rest = "They are at rest unless a recipe says `scene_motion: [dynamic]`."
    head = fill(f"Scenes that move: {moving or 'none'}. {at_rest} {known}")
    page = [HEAD.format(table=thumbnail_table(sorted(sections)), moving=head)]
    for name in sorted(sections):
        page += [f"## {name}", "", sections[name]]
    write_text(folder / "scenes.md", "\n".join(page))
    return failed


def fill(text: str) -> str:
    """Return text in lines of at most 120 characters."""
    return "\n".join(wrap(text, 120, break_long_words=False, break_on_hyphens=False))


def thumbnail_table(names: Sequence[str]) -> str:
    """Return a table of small pictures that link to the sections."""
    cells = [f"[![{name}](pictures/scenes/thumbnails/{name}.jpg)](#{name})<br>[{name}](#{name})" for name in names]
    across = min((5, 4, 6), key=lambda columns: -len(cells) % columns)  # the last row lacks as few as possible
    cells += [""] * (-len(cells) % across)
    rows = [cells[k : k + across] for k in range(0, len(cells), across)]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([f"|{' |' * across}", f"|{':-:|' * across}", *lines])


@dataclass(frozen=True)
class View:
    """A scene in front of its camera: depth and target, and the true focus (NaN if the target is out of sight)."""

    renderer: SceneRenderer
    seen: DepthAndTarget
    truth: float

    @classmethod
    def trace(cls, scene: Scene, sensor: Sensor, *, backend: str) -> "View":
        renderer = make_renderer(scene, sensor, backend_name=backend, wavelength_m=sensor.wavelength_m)
        seen = renderer.trace_geometry(allow_unseen_target=True)
        depths = seen.depth[seen.target]
        return cls(renderer, seen, scene.build_drive().least_blur(depths) if depths.size else float("nan"))

    def render(self, *, samples: int) -> list[list[tuple[str, np.ndarray]]]:
        """Return rows of labels and grey images (0 to 1): at both ends and in focus; members and moments."""
        renderer = self.renderer
        best = float(np.clip(np.nan_to_num(self.truth, nan=0.5), 0, 1))
        samples = SLOW_SAMPLES if renderer.is_slow else samples
        images = self._along_travel((0.0, best, 1.0), samples=samples)
        white = white_level(images[1])
        depths = [float(renderer.scene.build_drive().focus_depth(p)) for p in (0.0, 1.0)]
        first, last = ("near end", "far end") if depths[0] < depths[1] else ("far end", "near end")
        middle = (
            "in focus" if best == self.truth else "middle of the travel" if np.isnan(self.truth) else "out of reach"
        )
        rows = [
            [(label, display_gamma(image, white)) for label, image in zip((first, middle, last), images, strict=True)]
        ]
        both = bool(renderer.motions) and any(is_range(value) for value in renderer.scene.card.params.values())
        small = render_images(renderer, best, samples=samples, count=SMALL_IMAGES // 2 if both else SMALL_IMAGES)
        row = [(moment_label(label), display_gamma(image, white_level(image))) for label, image in small]
        return [*rows, row] if row else rows

    def _along_travel(self, positions: Sequence[float], *, samples: int) -> list[np.ndarray]:
        """Return the camera's images at positions under all lights, or at the nearest of a stack's."""
        if self.renderer.is_slow:
            return [self.renderer.render_picture(p, samples=samples) for p in positions]
        stack = self.renderer.render_stack(self.seen, positions=POSITIONS, samples=samples, as_one_group=True)
        return [stack.radiance[0, round(p * (POSITIONS - 1))] for p in positions]


def moment_label(label: str) -> str:
    """Return the label of an image: moments of time are written as such."""
    return f"t = {label}" if label.endswith(" s") else label


def section(scene: Scene, *, picture: Path, folder: Path) -> str:
    card = scene.card
    near, far = scene.build_drive().focusing_range_m
    moves = f", {card.slices_per_s:g} slices per second" if card.slices_per_s else ""
    image = f"![{scene.id}]({picture.relative_to(folder).as_posix()})"
    source = f"{card.licence}, {source_link(scene, folder)}"
    line = fill(f"{card.lens.summary}, {near:.4g} to {far:.4g} m{moves}, {source}.")
    return "\n".join([f"{escape_markdown(card.title)}.", "", image, "", line, ""])


def source_link(scene: Scene, folder: Path) -> str:
    source = scene.card.source
    if not (scene.folder / source).is_file():
        return source
    return f"[{source}]({Path(os.path.relpath(scene.folder / source, folder)).as_posix()})"


def save_grid(rows: Sequence[Sequence[tuple[str, np.ndarray]]], path: Path, *, max_bytes: int) -> None:
    """Write rows of labelled grey images (0 to 1, of equal size in a row) as JPEG, at most ``max_bytes`` if possible.

    Each row fills the width: images stand evenly from the left edge to the right, and each below its label.
    """
    width = max(sum(image.shape[1] + GAP for _, image in row) - GAP for row in rows[:1])
    height = sum(LABEL + row[0][1].shape[0] for row in rows)
    sheet = Image.new("L", (width, height), 255)
    draw, typeface = ImageDraw.Draw(sheet), ImageFont.truetype(FONT, TYPE)
    y = 0
    for row in rows:
        rest = width - row[0][1].shape[1]
        for number, (label, image) in enumerate(row):
            x = round(number * rest / max(len(row) - 1, 1))
            draw.text((x + image.shape[1] / 2, y + LABEL / 2), label, fill=32, font=typeface, anchor="mm")
            sheet.paste(Image.fromarray(np.round(255 * image).astype(np.uint8)), (x, y + LABEL))
        y += LABEL + row[0][1].shape[0]
    save_jpeg(sheet, path, max_bytes=max_bytes)


def save_thumbnail(image: np.ndarray, path: Path) -> None:
    """Write a small copy of a grey image (0 to 1) as JPEG."""
    size = THUMBNAIL, round(THUMBNAIL * image.shape[0] / image.shape[1])
    small = Image.fromarray(np.round(255 * image).astype(np.uint8)).resize(size, Image.Resampling.LANCZOS)
    save_jpeg(small, path, max_bytes=MAX_BYTES // 10)


def save_jpeg(image: Image.Image, path: Path, *, max_bytes: int) -> None:
    """Write an image with the best quality that fits, or else a poor one."""
    with atomic_file(path) as temporary:
        for quality in (90, 85, 80, 70, 60, 45, 30):
            image.save(temporary, format="JPEG", quality=quality, optimize=True)
            if temporary.stat().st_size <= max_bytes:
                break


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="names of scenes (default: all)")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder for scenes.md and its pictures")
    parser.add_argument("--sensor", default="vidar_400x250")
    parser.add_argument("--variant", default="auto")
    parser.add_argument("--samples", type=int, default=SAMPLES, help=f"light paths per pixel (default: {SAMPLES})")
    parser.add_argument("--keep", action="store_true", help="render no scene whose pictures are there")
    given = parser.parse_args(argv)
    if given.samples < 1:
        parser.error(f"--samples {given.samples} is below 1; the default is {SAMPLES}")
    try:
        scenes = [find_scene(name) for name in given.scenes or scene_names()]
        sensor, how = get_sensor(given.sensor), {"samples": given.samples, "keep": given.keep}
        failed = write_gallery(scenes, sensor, folder=given.out, backend=given.variant, **how)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    for name, problem in failed.items():
        print(f"{name} could not be drawn: {problem}", file=sys.stderr)
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
