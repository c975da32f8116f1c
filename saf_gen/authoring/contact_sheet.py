"""The contact sheet: images along the lens's travel, depth, light groups, brightness, blur and sharpness.

The images fill a grid without gaps; below them are two plots, each half as wide as the sheet. The sheet is as wide as a
page, and uses one font. A title or caption that is too long for one line gets more lines, and the sheet becomes taller.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.ticker import FuncFormatter

from saf_gen.camera import Sensor, charge_of_images, exposure_scale
from saf_gen.camera.exposure import firing_rate
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.figure_style import BAND, COLOURS, COLUMN_STYLE, INK, SOFT, hide_spines, use_plot_style
from saf_gen.core.files import atomic_file
from saf_gen.core.region import bounding_box
from saf_gen.errors import BadInput, unknown
from saf_gen.stack.focal_stack import WAVES, FocalStack

WIDTH, PIXELS = 7.16, 1600  # width in inches, two columns of a paper, and in pixels of a PNG
# Inches: a title of one line, a caption of two, each further line, the gap between images; a plot's height, the axis
# below it, and the margins on either side of it.
TITLE, CAPTION, LINE, GAP = 0.22, 0.26, 0.13, 0.06
PLOT, AXIS, LEFT, RIGHT = 1.5, 0.36, 0.48, 0.72
FORMS = ("png", "svg")


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
        stack = self.stack
        return stack.spec.in_focus.true_focus(stack.depth, stack.target) if stack.target.any() else float("nan")


@dataclass(frozen=True)
class _Cell:
    """An image of the grid, with grey values or depths from 0 to 1, and its caption."""

    caption: str
    image: np.ndarray
    colours: str = "gray"
    outline: np.ndarray | None = None


def write_preview(stack: FocalStack, sensor: Sensor, *, path: Path) -> None:
    """Write the contact sheet of a dataset's focal stack; ``path`` is as in :func:`draw_sheet`."""
    spec = stack.spec
    how = "by waves" if spec.estimator == WAVES else f"{spec.samples} samples per pixel"
    title = f"{spec.scene}: {spec.positions} positions, {how}"
    draw_sheet(ContactSheet(title, stack, sensor), path)


def draw_sheet(sheet: ContactSheet, path: Path) -> None:
    """Write a contact sheet as PNG (1600 pixels wide) or SVG, by the ending of the file.

    Raises BadInput for another ending.
    """
    form = sheet_form(path)
    with use_plot_style(COLUMN_STYLE):
        figure = _draw_sheet(sheet, _list_cells(sheet))
        with atomic_file(path) as written:
            figure.savefig(written, format=form, metadata={"Date": None} if form == "svg" else None)


def sheet_form(path: Path) -> str:
    """Return the form of a contact sheet by the ending of its file; raise BadInput for another ending."""
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMS:
        raise unknown("kind of file", path.suffix or path.name, allowed=[f".{f}" for f in FORMS], where=str(path))
    return form


def _draw_sheet(sheet: ContactSheet, cells: Sequence[_Cell]) -> Figure:
    across = choose_columns(len(cells))
    width = (WIDTH - GAP * (across + 1)) / across
    height = width * sheet.stack.depth.shape[0] / sheet.stack.depth.shape[1]
    title = _wrap(sheet.title, WIDTH - 2 * GAP, size=rcParams["font.size"], weight="bold")
    captions = [_wrap(cell.caption, width, size=rcParams["axes.titlesize"]) for cell in cells]
    more = [max(0, *(text.count("\n") - 1 for text in captions[k : k + across])) for k in range(0, len(cells), across)]
    first = TITLE + LINE * title.count("\n")
    rows = list(accumulate((CAPTION + LINE * lines + height + GAP for lines in more), initial=first))
    below = CAPTION + PLOT + AXIS
    tall = rows[-1] + below
    figure = Figure(figsize=(WIDTH, tall), dpi=PIXELS / WIDTH)
    FigureCanvasAgg(figure)

    def place(left: float, top: float, size: tuple[float, float]) -> Axes:
        return figure.add_axes((left / WIDTH, 1 - (top + size[1]) / tall, size[0] / WIDTH, size[1] / tall))

    figure.text(GAP / WIDTH, 1 - 0.05 / tall, title, va="top", fontweight="bold", linespacing=1.1)
    for number, (cell, caption) in enumerate(zip(cells, captions, strict=True)):
        left = GAP + number % across * (width + GAP)
        top = rows[number // across + 1] - GAP - height
        _draw_cell(place(left, top, (width, height)), cell, caption=caption)
    half, top = WIDTH / 2, tall - below + CAPTION
    plots = [place(left, top, (half - LEFT - RIGHT, PLOT)) for left in (LEFT, half + LEFT)]
    draw_histogram(plots[0], sheet.stack, sensor=sheet.sensor, best=_best_index(sheet))
    draw_curves(plots[1], sheet.stack, sensor=sheet.sensor, truth=sheet.true_focus)
    return figure


def _wrap(text: str, width: float, **font: Any) -> str:
    """Return the text as it is if its lines fit in ``width`` inches, or else in few lines of similar length."""
    points, properties = 72 * width, FontProperties(**font)

    def fits(lines: Sequence[str]) -> bool:
        sizes = (text_to_path.get_text_width_height_descent(line, properties, ismath=False) for line in lines)
        return all(size[0] <= points for size in sizes)

    if fits(text.split("\n")):
        return text
    counts = range(min(len(text), int(points / 2)), 0, -1)  # of characters per line; few are narrower than two points
    fitting = filter(fits, (textwrap.wrap(text, count, break_on_hyphens=False) for count in counts))
    widest = next(fitting)
    alike = takewhile(lambda lines: len(lines) == len(widest) and " ".join(lines) == " ".join(widest), fitting)
    return "\n".join([widest, *alike][-1])


def choose_columns(count: int) -> int:
    """Return how many images to place in a row, 3 to 5, so that the last row lacks as few as possible, at most two.

    Four is preferred. In rows of more than five, the captions of neighbours would not fit.
    """
    return min((4, 5, 3), key=lambda across: -count % across)


def _best_index(sheet: ContactSheet) -> int:
    """Return the index of the rendered position nearest to the true focus."""
    return int(np.abs(sheet.stack.spec.focus - np.nan_to_num(sheet.true_focus, nan=0.5)).argmin())


def _list_cells(sheet: ContactSheet) -> list[_Cell]:
    """Return the images of the grid; if they would not fill their rows, images of the target alone are added."""
    stack, best = sheet.stack, _best_index(sheet)
    spec, image = stack.spec, stack.radiance.sum(axis=0)
    white = white_level(image[best])
    cells = []
    if sheet.sharp is not None:
        cells.append(_Cell("everything sharp,\nthrough a pinhole", display_gamma(sheet.sharp, white)))
    truth = "the target is not in the image" if np.isnan(sheet.true_focus) else "nearest to the true focus"
    for k, words in ((0, "one end of the travel"), (best, truth), (spec.rendered_count - 1, "the other end")):
        position = float(spec.focus[k])
        depth = float(spec.drive.focus_depth(position))
        cells.append(_Cell(f"{words}:\n{position:.3f}, in focus {depth:.5g} m", display_gamma(image[k], white)))
    finite = stack.depth[np.isfinite(stack.depth)]
    low, high = np.quantile(finite, [0.01, 0.99]) if finite.size else (0.0, 1.0)
    shown = np.clip((stack.depth - low) / (high - low + 1e-9), 0, 1)
    outline = stack.target if 0 < stack.target.mean() < 1 else None
    cells.append(_Cell(f"depth {low:.4g} (dark) to {high:.4g} m,\nthe target outlined", shown, "viridis", outline))
    for name, group in zip(spec.groups, stack.radiance[:, best], strict=True):
        cells.append(_Cell(f"light of {name} alone,\nat gain 1", display_gamma(group, white)))
    if sheet.small_images:
        white_of_small = white_level(*(small for _, small in sheet.small_images))
        cells += [_Cell(words, display_gamma(small, white_of_small)) for words, small in sheet.small_images]
    missing = -len(cells) % choose_columns(len(cells))
    for k, words in ((best, "nearest to the true focus"), (0, "at one end of the travel"))[:missing]:
        cells.append(_Cell(f"the target alone,\n{words}", display_gamma(image[k] * stack.target, white)))
    return cells


def _draw_cell(axes: Axes, cell: _Cell, *, caption: str) -> None:
    axes.imshow(cell.image, cmap=cell.colours, vmin=0, vmax=1, interpolation="nearest", aspect="auto")
    if cell.outline is not None:
        axes.contour(cell.outline, levels=[0.5], colors="white", linewidths=0.6)
    axes.set_axis_off()
    axes.set_title(caption, y=1.0, pad=2, linespacing=1.1)  # without y, it would measure every tick


BLUE, ORANGE = COLOURS[:2]
USUAL_RATE = 0.2  # spikes per readout, the usual mean_rate of recipes


def _charge(stack: FocalStack, sensor: Sensor) -> np.ndarray:
    """Return the photo-electrons per readout with all lights at gain 1, float32 (focus, row, col)."""
    spec = stack.spec
    return charge_of_images(stack.radiance, sensor, lens=spec.drive, position=spec.focus).sum(axis=0)


def draw_curves(axes: Axes, stack: FocalStack, *, sensor: Sensor, truth: float) -> None:
    """Draw the target's blur by geometric optics, and the noise-free sharpness of the stack in the target's box."""
    drive, depths = stack.spec.drive, stack.depth[stack.target]
    axes.set(xlabel="focus position, fraction of travel", xlim=(0, 1))
    axes.set_title("blur (rms) and sharpness of the target,\ntrue focus and depth of focus")
    hide_spines(axes, "top", "right")
    if not depths.size:
        return
    focus = np.linspace(0, 1, 129)
    blur = [np.sqrt(np.mean(drive.blur_diameter(p, depths) ** 2)) / stack.spec.pitch_m for p in focus]
    axes.plot(focus, blur, color=BLUE)
    axes.set_ylabel("blur, pixels", color=BLUE)
    axes.set_ylim(bottom=0)
    ends = stack.spec.in_focus.depth_of_focus(stack.depth, stack.target)
    axes.axvspan(*ends, color=BAND, alpha=0.6, linewidth=0)
    axes.axvline(truth, color=INK, linewidth=1)
    axes.set_xlim(0, 1)
    rows, columns = bounding_box(stack.target)
    seen = _charge(stack, sensor)[:, rows, columns].astype(np.float64)
    mean = seen.mean(axis=(1, 2))
    if not (mean > 0).all():
        return  # the sharpness of a black image is undefined
    right = axes.twinx()
    right.plot(stack.spec.focus, seen.var(axis=(1, 2)) / mean**2, ".-", color=ORANGE)
    right.set_ylabel("sharpness, variance / mean²", color=ORANGE)
    right.set_ylim(bottom=0)
    hide_spines(right, "top", "left")


def draw_histogram(axes: Axes, stack: FocalStack, *, sensor: Sensor, best: int) -> None:
    """Draw histograms of the firing rates of target and frame at best focus, for a mean of 0.2 on the target.

    If the target is out of sight, or part of it is dark, this mean cannot be reached, and the exposure is absolute.
    """
    charge = _charge(stack, sensor)[best]
    try:
        scale = exposure_scale(charge, stack.target, sensor=sensor, mean_rate=USUAL_RATE)
        title = f"brightness of the pixels at mean_rate {USUAL_RATE:g}"
    except BadInput:  # part of the target is dark, or it is out of sight
        scale, title = 1.0, "brightness of the pixels, absolute exposure"
    dark = sensor.mean_dark_e
    bins = np.geomspace(1e-3, 1, 61)
    for pixels, color, label in ((charge, SOFT, "frame"), (charge[stack.target], BLUE, "target")):
        if pixels.size:
            rate = np.clip(firing_rate(pixels * scale + dark, sensor), bins[0], bins[-1])
            counts, _ = np.histogram(rate, bins=bins)
            axes.stairs(100 * counts / rate.size, bins, color=color, label=label)
    absolute = firing_rate(charge[stack.target] + dark, sensor)
    if absolute.size:
        title += f"\n(target with absolute exposure: {absolute.mean():.2g})"
    axes.set(xscale="log", xlim=(bins[0], bins[-1]), xlabel="spikes per readout", ylabel="pixels, %")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{rate:g}"))
    axes.set_title(title)
    hide_spines(axes, "top", "right")
    axes.legend(loc="upper left", frameon=False)
