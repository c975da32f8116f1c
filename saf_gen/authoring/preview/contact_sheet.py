"""The contact sheet: what the lens sees along its travel, how far it is, what light there is, how sharp."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from saf_gen.authoring.preview.display_images import encode_gamma, white_level
from saf_gen.authoring.preview.sheet_plots import draw_curves, draw_histogram
from saf_gen.camera import Sensor
from saf_gen.core.files import write_atomically
from saf_gen.stack.focal_stack import FocalStack

__all__ = ["ContactSheet", "draw_contact_sheet", "write_preview"]

STYLE: Any = {"font.size": 9, "axes.titlesize": 9}
WIDE, HIGH, LOW = 16.0, 3.4, 2.4  # inches: a sheet, a row of pictures, a row of small ones


@dataclass(frozen=True)
class ContactSheet:
    """What is drawn: a stack, before a sensor; and, where there are, what a stack does not hold.

    sharp : the scene with everything sharp, (row, col). small_pictures : small pictures (row, col) of other
    members of the family or other moments, with a word each.
    """

    title: str
    stack: FocalStack
    sensor: Sensor
    sharp: np.ndarray | None = None
    small_pictures: Sequence[tuple[str, np.ndarray]] = ()

    @property
    def true_focus(self) -> float:
        """The true focus, in the travel or not; NaN where the target is not seen."""
        depths = self.stack.depth[self.stack.target]
        return self.stack.spec.drive.true_focus(depths) if depths.size else float("nan")


def write_preview(stack: FocalStack, sensor: Sensor, path: Path) -> None:
    """Write the sheet of a dataset's stack as PNG, 1600 × 720 pixels."""
    spec = stack.spec
    title = f"{spec.scene}: {spec.positions} positions, {spec.samples} samples a pixel"
    draw_contact_sheet(ContactSheet(title, stack, sensor), path)


def draw_contact_sheet(sheet: ContactSheet, path: Path) -> None:
    """Write a sheet as PNG, 1600 pixels wide."""
    pictures = ["first", "best", "last"] if sheet.sharp is None else ["sharp", "first", "best", "last"]
    rows = [(pictures, HIGH), (["depth", "groups", "histogram", "curves"], HIGH)]
    if sheet.small_pictures:
        rows.append((["glimpses"], LOW))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDE, 0.4 + sum(high for _, high in rows)), dpi=100, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(sheet.title)
        # A row is a figure of its own: labels of plots do not push pictures together.
        parts: Any = figure.subfigures(len(rows), 1, height_ratios=[high for _, high in rows])
        axes: dict[str, Axes] = {}
        for part, (names, _) in zip(parts, rows, strict=True):
            axes |= dict(zip(names, part.subplots(1, len(names), squeeze=False)[0], strict=True))
        _draw_pictures(axes, sheet)
        _draw_depth(axes["depth"], sheet.stack)
        draw_histogram(axes["histogram"], sheet.stack, sheet.sensor, _best(sheet))
        draw_curves(axes["curves"], sheet.stack, sheet.sensor, sheet.true_focus)
        with write_atomically(path) as written:
            figure.savefig(written, format="png")


def _best(sheet: ContactSheet) -> int:
    """The rendered position that is nearest to the truth."""
    focus = sheet.stack.spec.focus
    return int(np.abs(focus - np.nan_to_num(sheet.true_focus, nan=0.5)).argmin())


def _draw_pictures(axes: dict[str, Axes], sheet: ContactSheet) -> None:
    stack, best = sheet.stack, _best(sheet)
    spec = stack.spec
    image = stack.radiance.sum(axis=0)
    white = white_level(image[best])
    truth = "the target is not in the picture" if np.isnan(sheet.true_focus) else "nearest to the true focus"
    for name, k, what in (
        ("first", 0, "one end of the travel"),
        ("best", best, truth),
        ("last", spec.rendered_count - 1, "the other end"),
    ):
        position = float(spec.focus[k])
        _show(axes[name], image[k], white)
        axes[name].set_title(
            f"{position:.3f} of the travel, in focus {float(spec.drive.focus_depth(position)):.5g} m:\n{what}"
        )
    if sheet.sharp is not None:
        _show(axes["sharp"], sheet.sharp, white)
        axes["sharp"].set_title("everything sharp,\nthrough a pinhole")
    groups = stack.radiance[:, best]
    _show_row(axes["groups"], list(groups), spec.groups, white, (WIDE / 4, HIGH))
    axes["groups"].set_title("light groups alone, at gain 1")
    if sheet.small_pictures:
        words, pictures = zip(*sheet.small_pictures, strict=True)
        _show_row(axes["glimpses"], list(pictures), words, white_level(*pictures), (WIDE, LOW))
        axes["glimpses"].set_title("members of the family, and moments")


def _show(axes: Axes, image: np.ndarray, white: float) -> None:
    axes.imshow(encode_gamma(image, white), cmap="gray", vmin=0, vmax=1)
    axes.set_axis_off()


def _show_row(
    axes: Axes, pictures: list[np.ndarray], words: Sequence[str], white: float, shape: tuple[float, float]
) -> None:
    """Pictures, each with its word in a corner, arranged to fill a place so wide and high."""
    rows, columns = pictures[0].shape

    def scale(across: int) -> float:
        return min(shape[0] / (across * columns), shape[1] / (-(-len(pictures) // across) * rows))

    across = max(range(1, len(pictures) + 1), key=scale)
    sheet = np.full((-(-len(pictures) // across) * rows, across * columns), white)
    for n, picture in enumerate(pictures):
        y, x = n // across * rows, n % across * columns
        sheet[y : y + rows, x : x + columns] = picture
        box = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5}
        axes.text(x + 0.02 * columns, y + 0.03 * rows, words[n], va="top", fontsize=8, bbox=box)
    _show(axes, sheet, white)


def _draw_depth(axes: Axes, stack: FocalStack) -> None:
    finite = stack.depth[np.isfinite(stack.depth)]
    low, high = np.quantile(finite, [0.01, 0.99]) if finite.size else (0.0, 1.0)
    shown = axes.imshow(stack.depth, cmap="viridis", vmin=low, vmax=high + 1e-9)
    if 0 < stack.target.mean() < 1:
        axes.contour(stack.target, levels=[0.5], colors="white", linewidths=1)
    axes.set_axis_off()
    axes.set_title("depth (m), the target outlined")
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, orientation="horizontal", pad=0.02)
