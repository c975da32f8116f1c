"""The contact sheet: images along the lens's travel, depth, light groups, brightness, blur and sharpness.

The images fill a grid without gaps; below them are two plots, each half as wide as the sheet. The sheet is as wide as a
page, and uses one font.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from saf_gen.authoring.preview.sheet_plots import draw_preview_curves, draw_preview_histogram
from saf_gen.camera import Sensor
from saf_gen.core.display_tone import apply_display_gamma, find_display_white_level
from saf_gen.core.figure_style import COLUMN_STYLE, use_plot_style
from saf_gen.core.files import write_atomically
from saf_gen.errors import unknown
from saf_gen.stack.focal_stack import FocalStack

WIDTH, PIXELS = 7.16, 1600  # width in inches, two columns of a paper, and in pixels of a PNG
TITLE, CAPTION, GAP, PLOT, AXIS, LEFT, RIGHT = (
    0.22,
    0.26,
    0.06,
    1.5,
    0.36,
    0.45,
    0.6,
)  # inches; a caption has two lines, and a plot has a margin on either side
FORMS = ("png", "pdf", "svg")


@dataclass(frozen=True)
class ContactSheet:
    """The content of a contact sheet.

    Parameters
    ----------
    title : str
        Line above the images.
    stack : FocalStack
        Focal stack to show.
    sensor : Sensor
        Sensor that would record the stack.
    sharp : ndarray, shape (row, col), optional
        Image of the scene with everything sharp.
    small_images : sequence of (str, ndarray), optional
        Captions and images (row, col) of other members of the family and of other moments.
    """

    title: str
    stack: FocalStack
    sensor: Sensor
    sharp: np.ndarray | None = None
    small_images: Sequence[tuple[str, np.ndarray]] = ()

    @property
    def true_focus(self) -> float:
        """True focus, which may be outside the travel; NaN if the target is out of sight."""
        depths = self.stack.depth[self.stack.target]
        return self.stack.spec.drive.true_focus(depths) if depths.size else float("nan")


@dataclass(frozen=True)
class _Cell:
    """An image of the grid, with grey values or depths from 0 to 1, and its caption."""

    caption: str
    image: np.ndarray
    colours: str = "gray"
    outline: np.ndarray | None = None


def write_scene_preview(stack: FocalStack, sensor: Sensor, *, path: Path) -> None:
    """Write the contact sheet of a dataset's focal stack; ``path`` is as in :func:`draw_preview_sheet`."""
    spec = stack.spec
    title = f"{spec.scene}: {spec.positions} positions, {spec.samples} samples per pixel"
    draw_preview_sheet(ContactSheet(title, stack, sensor), path)


def draw_preview_sheet(sheet: ContactSheet, path: Path) -> None:
    """Write a contact sheet as PNG (1600 pixels wide), PDF or SVG, by the ending of the file.

    Raises BadInput for another ending.
    """
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMS:
        raise unknown("kind of file", path.suffix or path.name, allowed=[f".{f}" for f in FORMS], where=str(path))
    cells = _list_cells(sheet)
    across = choose_preview_columns(len(cells))
    width = (WIDTH - GAP * (across + 1)) / across
    rows, columns = sheet.stack.depth.shape
    height = CAPTION + width * rows / columns
    below = CAPTION + PLOT + AXIS
    tall = TITLE + -(-len(cells) // across) * (height + GAP) + below
    with use_plot_style(COLUMN_STYLE):
        figure = Figure(figsize=(WIDTH, tall), dpi=PIXELS / WIDTH)
        FigureCanvasAgg(figure)

        def place(left: float, top: float, size: tuple[float, float]) -> Axes:
            return figure.add_axes((left / WIDTH, 1 - (top + size[1]) / tall, size[0] / WIDTH, size[1] / tall))

        figure.text(GAP / WIDTH, 1 - 0.05 / tall, sheet.title, va="top", fontweight="bold")
        for number, cell in enumerate(cells):
            left = GAP + number % across * (width + GAP)
            top = TITLE + number // across * (height + GAP) + CAPTION
            _draw_cell(place(left, top, (width, height - CAPTION)), cell)
        half, top = WIDTH / 2, tall - below + CAPTION
        plots = [place(left, top, (half - LEFT - RIGHT, PLOT)) for left in (LEFT, half + LEFT)]
        draw_preview_histogram(plots[0], sheet.stack, sensor=sheet.sensor, best=_best_index(sheet))
        draw_preview_curves(plots[1], sheet.stack, sensor=sheet.sensor, truth=sheet.true_focus)
        with write_atomically(path) as written:
            nothing: Any = dict.fromkeys({"pdf": ("CreationDate",), "svg": ("Date",)}.get(form, ()))
            figure.savefig(written, format=form, metadata=nothing)


def choose_preview_columns(count: int) -> int:
    """Return how many images to place in a row so that ``count`` images fill all rows: 3 to 7, 4 if possible."""
    return next((across for across in (4, 5, 3, 6, 7) if count % across == 0), 4)


def _best_index(sheet: ContactSheet) -> int:
    """Return the index of the rendered position nearest to the true focus."""
    return int(np.abs(sheet.stack.spec.focus - np.nan_to_num(sheet.true_focus, nan=0.5)).argmin())


def _list_cells(sheet: ContactSheet) -> list[_Cell]:
    """Return the images of the grid; if they would not fill their rows, an image of the target alone is added."""
    stack, best = sheet.stack, _best_index(sheet)
    spec, image = stack.spec, stack.radiance.sum(axis=0)
    white = find_display_white_level(image[best])
    cells = []
    if sheet.sharp is not None:
        cells.append(_Cell("everything sharp,\nthrough a pinhole", apply_display_gamma(sheet.sharp, white)))
    truth = "the target is not in the image" if np.isnan(sheet.true_focus) else "nearest to the true focus"
    for k, words in ((0, "one end of the travel"), (best, truth), (spec.rendered_count - 1, "the other end")):
        position = float(spec.focus[k])
        depth = float(spec.drive.focus_depth(position))
        cells.append(_Cell(f"{words}:\n{position:.3f}, in focus {depth:.5g} m", apply_display_gamma(image[k], white)))
    finite = stack.depth[np.isfinite(stack.depth)]
    low, high = np.quantile(finite, [0.01, 0.99]) if finite.size else (0.0, 1.0)
    shown = np.clip((stack.depth - low) / (high - low + 1e-9), 0, 1)
    outline = stack.target if 0 < stack.target.mean() < 1 else None
    cells.append(_Cell(f"depth {low:.4g} (dark) to {high:.4g} m,\nthe target outlined", shown, "viridis", outline))
    for name, group in zip(spec.groups, stack.radiance[:, best], strict=True):
        cells.append(_Cell(f"light of {name} alone,\nat gain 1", apply_display_gamma(group, white)))
    if sheet.small_images:
        white_of_small = find_display_white_level(*(small for _, small in sheet.small_images))
        cells += [_Cell(words, apply_display_gamma(small, white_of_small)) for words, small in sheet.small_images]
    if len(cells) % choose_preview_columns(len(cells)):
        alone = apply_display_gamma(image[best] * stack.target, white)
        cells.append(_Cell("the target alone,\nnearest to the true focus", alone))
    return cells


def _draw_cell(axes: Axes, cell: _Cell) -> None:
    axes.imshow(cell.image, cmap=cell.colours, vmin=0, vmax=1, interpolation="nearest", aspect="auto")
    if cell.outline is not None:
        axes.contour(cell.outline, levels=[0.5], colors="white", linewidths=0.6)
    axes.set_axis_off()
    axes.set_title(cell.caption, y=1.0, pad=2, linespacing=1.1)  # without y, it would measure every tick
