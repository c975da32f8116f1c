"""The contact sheet: images along the lens's travel, depth, light groups, brightness, blur and sharpness."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from saf_gen.authoring.preview.sheet_plots import draw_preview_curves, draw_preview_histogram
from saf_gen.camera import Sensor
from saf_gen.core.display_tone import encode_gamma, find_white_level
from saf_gen.core.files import write_atomically
from saf_gen.stack.focal_stack import FocalStack

STYLE: Any = {"font.size": 9, "axes.titlesize": 9}
SHEET_WIDTH, ROW_HEIGHT, SMALL_ROW_HEIGHT = 16.0, 3.4, 2.4  # inches


@dataclass(frozen=True)
class ContactSheet:
    """The content of a contact sheet.

    title : a line above the images.
    stack, sensor : a focal stack, and the sensor that would record it.
    sharp : image of the scene with everything sharp, (row, col), if any.
    small_images : captions and images (row, col) of other members of the family and other moments.
    """

    title: str
    stack: FocalStack
    sensor: Sensor
    sharp: np.ndarray | None = None
    small_images: Sequence[tuple[str, np.ndarray]] = ()

    @property
    def true_focus(self) -> float:
        """The true focus, inside the travel or not; NaN for a target out of sight."""
        depths = self.stack.depth[self.stack.target]
        return self.stack.spec.drive.true_focus(depths) if depths.size else float("nan")


def write_preview(stack: FocalStack, sensor: Sensor, *, path: Path) -> None:
    """Write the contact sheet of a dataset's focal stack as PNG, 1600 × 720 pixels."""
    spec = stack.spec
    title = f"{spec.scene}: {spec.positions} positions, {spec.samples} samples per pixel"
    draw_contact_sheet(ContactSheet(title, stack, sensor), path)


def draw_contact_sheet(sheet: ContactSheet, path: Path) -> None:
    """Write a contact sheet as PNG, 1600 pixels wide."""
    images = ["first", "best", "last"] if sheet.sharp is None else ["sharp", "first", "best", "last"]
    rows = [(images, ROW_HEIGHT), (["depth", "groups", "histogram", "curves"], ROW_HEIGHT)]
    if sheet.small_images:
        rows.append((["small"], SMALL_ROW_HEIGHT))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(SHEET_WIDTH, 0.4 + sum(height for _, height in rows)), dpi=100, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(sheet.title)
        # Each row is a figure of its own, so that labels of plots do not push images together.
        subfigures: Any = figure.subfigures(len(rows), 1, height_ratios=[height for _, height in rows])
        axes: dict[str, Axes] = {}
        for subfigure, (names, _) in zip(subfigures, rows, strict=True):
            axes |= dict(zip(names, subfigure.subplots(1, len(names), squeeze=False)[0], strict=True))
        _draw_images(axes, sheet)
        _draw_depth(axes["depth"], sheet.stack)
        draw_preview_histogram(axes["histogram"], sheet.stack, sensor=sheet.sensor, best=_best_index(sheet))
        draw_preview_curves(axes["curves"], sheet.stack, sensor=sheet.sensor, truth=sheet.true_focus)
        with write_atomically(path) as written:
            figure.savefig(written, format="png")


def _best_index(sheet: ContactSheet) -> int:
    """Return the index of the rendered position nearest to the true focus."""
    return int(np.abs(sheet.stack.spec.focus - np.nan_to_num(sheet.true_focus, nan=0.5)).argmin())


def _draw_images(axes: dict[str, Axes], sheet: ContactSheet) -> None:
    stack, best = sheet.stack, _best_index(sheet)
    spec = stack.spec
    image = stack.radiance.sum(axis=0)
    white = find_white_level(image[best])
    truth = "the target is not in the image" if np.isnan(sheet.true_focus) else "nearest to the true focus"
    for name, k, caption in (
        ("first", 0, "one end of the travel"),
        ("best", best, truth),
        ("last", spec.rendered_count - 1, "the other end"),
    ):
        position = float(spec.focus[k])
        _show(axes[name], image[k], white=white)
        axes[name].set_title(
            f"{position:.3f} of the travel, in focus {float(spec.drive.focus_depth(position)):.5g} m:\n{caption}"
        )
    if sheet.sharp is not None:
        _show(axes["sharp"], sheet.sharp, white=white)
        axes["sharp"].set_title("everything sharp,\nthrough a pinhole")
    groups = stack.radiance[:, best]
    _show_row(axes["groups"], list(groups), captions=spec.groups, white=white, size=(SHEET_WIDTH / 4, ROW_HEIGHT))
    axes["groups"].set_title("light groups alone, at gain 1")
    if sheet.small_images:
        captions, small = zip(*sheet.small_images, strict=True)
        white, size = find_white_level(*small), (SHEET_WIDTH, SMALL_ROW_HEIGHT)
        _show_row(axes["small"], list(small), captions=captions, white=white, size=size)
        axes["small"].set_title("members of the family, and moments")


def _show(axes: Axes, image: np.ndarray, *, white: float) -> None:
    axes.imshow(encode_gamma(image, white), cmap="gray", vmin=0, vmax=1)
    axes.set_axis_off()


def _show_row(
    axes: Axes, images: list[np.ndarray], *, captions: Sequence[str], white: float, size: tuple[float, float]
) -> None:
    """Show images with captions in their corners, arranged to fill an area of this width and height."""
    rows, columns = images[0].shape

    def scale(across: int) -> float:
        return min(size[0] / (across * columns), size[1] / (-(-len(images) // across) * rows))

    across = max(range(1, len(images) + 1), key=scale)
    sheet = np.full((-(-len(images) // across) * rows, across * columns), white)
    for n, image in enumerate(images):
        y, x = n // across * rows, n % across * columns
        sheet[y : y + rows, x : x + columns] = image
        box = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5}
        axes.text(x + 0.02 * columns, y + 0.03 * rows, captions[n], va="top", fontsize=8, bbox=box)
    _show(axes, sheet, white=white)


def _draw_depth(axes: Axes, stack: FocalStack) -> None:
    finite = stack.depth[np.isfinite(stack.depth)]
    low, high = np.quantile(finite, [0.01, 0.99]) if finite.size else (0.0, 1.0)
    shown = axes.imshow(stack.depth, cmap="viridis", vmin=low, vmax=high + 1e-9)
    if 0 < stack.target.mean() < 1:
        axes.contour(stack.target, levels=[0.5], colors="white", linewidths=1)
    axes.set_axis_off()
    axes.set_title("depth (m), the target outlined")
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, orientation="horizontal", pad=0.02)
