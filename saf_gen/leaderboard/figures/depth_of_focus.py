"""The figure that explains the depth of focus."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.figure_style import BAND, COLOURS, INK, SOFT, hide_spines, use_plot_style
from saf_gen.leaderboard.figures.figure import new_figure

WHITE_QUANTILE = 0.998  # glints, the brightest pixels, are clipped
OFFSETS_DOF = (-4.0, -1.0, 0.0, 1.0, 4.0)
"""Wanted distances of the pictures from the true focus, in depths of focus."""
REACH_DOF = 5.0
"""Half the width of the blur plot, in depths of focus."""
DETAIL_PX = 56
"""Side length of the square detail that the pictures show, in pixels."""
PICTURES, PLOT = 1.05, 1.5  # inches: the row of pictures; the plot with its title and labels


def plot_depth_of_focus(sweeps: Sequence[SweepSummary]) -> Figure:
    """Return the figure that explains the depth of focus.

    The lower part plots the blur of the target against the distance from the focus: within the depth of focus the blur
    is at most 1 pixel wide, and one depth of focus away from the focus it is 2 pixels wide. The upper part shows
    pictures of the target at some distances. They come from a sweep that has pictures and a known focus that does not
    move; among several, from the one under the steadiest light. If no sweep qualifies, the upper part is left out.
    """
    found = _choose_pictures(sweeps)
    with use_plot_style():
        figure = new_figure(PLOT + (PICTURES if found else 0), title="What a depth of focus is")
        if not found:
            _draw_blur(figure.subplots())
            return figure
        above, below = np.asarray(figure.subfigures(2, height_ratios=[PICTURES, PLOT - 0.25]))
        for axes, (offset, grey) in zip(np.atleast_1d(above.subplots(1, len(found))), found, strict=True):
            axes.imshow(grey, cmap="gray", vmin=0, vmax=1, interpolation="none")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.set_xlabel(f"{offset:+.1f}".replace("-", "−"), labelpad=2)
        plot = below.subplots()
        _draw_blur(plot)
        offsets = np.array([offset for offset, _ in found])
        plot.plot(offsets, 2 * np.abs(offsets), "o", c=COLOURS[0], ms=4)
    return figure


def _draw_blur(axes: Axes) -> None:
    reach = np.array([-REACH_DOF, 0.0, REACH_DOF])
    axes.axvspan(-0.5, 0.5, color=BAND, alpha=0.45, lw=0)
    axes.plot(reach, 2 * np.abs(reach), c=COLOURS[0], lw=1.4)
    for side in (-1, 1):
        axes.axvline(side, c=SOFT, lw=0.9, ls=(0, (3, 2)))
    axes.annotate("depth of focus", (0, 9.6), (0.62, 9.8), color=INK, fontsize=7.5, va="top")
    axes.annotate("within 1 DoF", (1, 7.2), (1.12, 7.2), color=INK, fontsize=7.5, va="top")
    axes.set_xlim(-REACH_DOF, REACH_DOF)
    axes.set_ylim(0, 2 * REACH_DOF)
    axes.set_xlabel("distance of the lens from the true focus, in depths of focus (DoF)")
    axes.set_ylabel("blur, pixels")
    hide_spines(axes, "top", "right")


def _choose_pictures(sweeps: Sequence[SweepSummary]) -> list[tuple[float, np.ndarray]]:
    """Return (offset from the focus in DoF, picture of a detail) at some moments of the sweep in steadiest light."""
    known = [sweep for sweep in sweeps if sweep.thumbnails is not None and _offsets_in_dof(sweep) is not None]
    if not known:
        return []
    sweep = min(known, key=_light_variation)
    pictures, offsets = sweep.thumbnails, _offsets_in_dof(sweep)
    if pictures is None or offsets is None:
        return []
    chosen = sorted({int(np.abs(offsets - wanted).argmin()) for wanted in OFFSETS_DOF}, key=lambda k: offsets[k])
    chosen = [number for number in chosen if abs(offsets[number]) <= REACH_DOF]
    focus = pictures.images[int(np.abs(offsets).argmin())]
    detail = _find_detail(focus, box=pictures.box)
    crops = [pictures.images[number][detail] for number in chosen]
    white = white_level(*crops, quantile=WHITE_QUANTILE) if crops else 1.0
    return [(float(offsets[n]), display_gamma(crop, white)) for n, crop in zip(chosen, crops, strict=True)]


def _find_detail(image: np.ndarray, *, box: tuple[float, float, float, float]) -> tuple[slice, slice]:
    """Return the square (row, col) with the largest variance in the box where measures look."""
    rows, columns = image.shape
    top, left = math.floor(box[0] * rows), math.floor(box[1] * columns)
    bottom, right = max(math.ceil(box[2] * rows), top + 1), max(math.ceil(box[3] * columns), left + 1)
    side = min(DETAIL_PX, bottom - top, right - left)
    step = max(side // 4, 1)
    squares = [
        (slice(y, y + side), slice(x, x + side))
        for y in range(top, bottom - side + 1, step)
        for x in range(left, right - side + 1, step)
    ]
    return max(squares, key=lambda square: float(image[square].var()))


def _offsets_in_dof(sweep: SweepSummary) -> np.ndarray | None:
    """Return lens minus true focus at each picture, in depths of focus; None if the focus is unknown or moves."""
    depth = judged_dof(sweep.depth_of_focus)
    pictures, lens = sweep.thumbnails, sweep.focus_position
    if pictures is None or lens is None or sweep.track is not None or not depth or not math.isfinite(sweep.truth):
        return None
    return np.asarray((np.interp(pictures.frames, np.arange(len(lens)), lens) - sweep.truth) / depth)


def _light_variation(sweep: SweepSummary) -> float:
    brightest = float(np.nanmax(sweep.rate, initial=0.0))
    return 0.0 if brightest == 0 else 1 - float(np.nanmin(sweep.rate, initial=brightest)) / brightest
