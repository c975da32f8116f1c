"""Plots of lens, light and scores over the frames of a view, without unknown quantities; and a still picture."""

import textwrap
from collections.abc import Callable, Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.legend import Legend
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator

from saf_gen.core.figure_style import (
    BAND,
    COLUMN,
    COLUMN_STYLE,
    GREY,
    INK,
    MAX_MEASURES,
    SOFT,
    PlotStyle,
    assign_styles,
    hide_spines,
    use_plot_style,
)
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.stream.pictures.timeline import Extremes, Timeline, WindowPictures

TICKS, DOTS_PER_INCH = [1, 2, 5, 10], 100
LINES = 3  # of a legend, for which there is room above a plot
LABEL = 40  # characters in a line of a legend; the names of lights that are alike are one label
LEGEND = 0.8  # largest width of a legend in widths of the figure, which also holds the labels on the left
Panel = Callable[[Axes, Timeline], None]


def list_panels(timeline: Timeline) -> list[Panel]:
    """Return the plots to draw; raise BadInput if there are more measures than colours can distinguish."""
    if len(timeline.scores) > MAX_MEASURES:
        raise BadInput(f"{len(timeline.scores)} measures", allowed=f"at most {MAX_MEASURES} in one picture")
    return [
        *([_draw_lens] if timeline.lens is not None else []),
        _draw_light,
        *([_draw_scores] if timeline.scores else []),
    ]


def stream_legends_height(timeline: Timeline, *, width: float) -> float:
    """Return the height, inches, to add to plots that are ``width`` inches wide, because their legends have many lines.

    It is 0 if no legend has more than LINES lines.
    """
    figure = Figure(figsize=(width, width), dpi=DOTS_PER_INCH)
    FigureCanvasAgg(figure)
    draw_panels(figure, timeline)
    heights = [legend.get_window_extent().height / DOTS_PER_INCH for legend in figure.findobj(Legend)]
    usual = LINES * 1.5 * rcParams["legend.fontsize"] / 72
    return sum(max(height - usual, 0.0) for height in heights)


def draw_panels(figure: FigureBase, timeline: Timeline) -> list[Axes]:
    """Draw a plot of each known quantity over the same frames, and return their axes from the top."""
    panels = list_panels(timeline)
    axes: list[Axes] = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0].tolist()
    for ax, draw in zip(axes, panels, strict=True):
        draw(ax, timeline)
        ax.yaxis.set_label_coords(-0.13, 0.5)  # align the labels, however wide the numbers are
        ax.tick_params(length=2.5, pad=2)
    axes[-1].set_xlim(timeline.first - 0.5, timeline.stop - 0.5)
    axes[-1].set_xlabel("frame", labelpad=2)
    axes[-1].xaxis.set_major_locator(MaxNLocator(5, steps=TICKS, integer=True))
    axes[-1].xaxis.set_major_formatter(FuncFormatter(lambda frame, _: f"{frame:,.0f}"))
    return axes


def _draw_lens(axes: Axes, timeline: Timeline) -> None:
    truth = timeline.truth
    if truth is not None:
        middle = (truth.low + truth.high) / 2
        for (low, high), alpha in {timeline.whole_target: 0.3, timeline.depth_of_focus: 0.6}.items():
            if isfinite(low):  # for a flat target they are the same
                axes.fill_between(truth.frames, middle + low, middle + high, color=BAND, alpha=alpha, lw=0)
        axes.plot(truth.frames, middle, color=INK, lw=0.9, label="true focus, its depth of focus")
    if timeline.lens is not None:
        _draw_extremes(axes, timeline.lens, style=PlotStyle("#0072b2", "-"), label="lens")
    axes.set_ylim(-0.03, 1.03)
    axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
    axes.set_ylabel("position")
    hide_spines(axes, "top", "right")
    _put_legend_above(axes)


def _draw_light(axes: Axes, timeline: Timeline) -> None:
    rate = axes.twinx() if timeline.gains else axes
    width = np.diff(timeline.centres).min() if len(timeline.centres) > 1 else timeline.stop - timeline.first
    centres = np.concatenate(([timeline.centres[0] - width / 2], timeline.centres, [timeline.centres[-1] + width / 2]))
    shown = np.pad(timeline.rate, 1, mode="edge")
    rate.fill_between(
        centres,
        shown,
        color=GREY,
        lw=0,
        step="mid",
        label=f"{timeline.counted} per {'frame' if timeline.counted == 'levels' else 'readout'}",
    )
    rate.set_ylim(0, 1.1 * timeline.rate.max() or 1)
    rate.yaxis.set_major_locator(MaxNLocator(3, steps=TICKS))
    hide_spines(rate, "top", "right" if rate is axes else "left")
    if rate is axes:
        axes.set_ylabel(timeline.counted)
    else:
        rate.tick_params(length=2.5, pad=2, labelcolor=SOFT)
        rate.spines["right"].set_visible(False)
        axes.set_zorder(rate.get_zorder() + 1)
        axes.patch.set_visible(False)
        hide_spines(axes, "top", "right")
        alike = _group_alike(timeline.gains)
        for names, style in zip(alike, _styles(alike, after=1), strict=True):
            _draw_extremes(axes, timeline.gains[names.split(", ")[0]], style=style, label=f"gain of {names}")
        axes.set_ylim(0, 1.1 * max(gain.high.max() for gain in timeline.gains.values()) or 1)
        axes.yaxis.set_major_locator(MaxNLocator(3, steps=TICKS))
        axes.set_ylabel("gain")
    _put_legend_above(axes, rate)


def _draw_scores(axes: Axes, timeline: Timeline) -> None:
    """Draw the scores of each measure scaled to their range; scores that are not finite leave gaps."""
    for (name, scores), style in zip(timeline.scores.items(), _styles(timeline.scores), strict=True):
        known = scores[np.isfinite(scores)]
        low, span = (known.min(), np.ptp(known)) if known.size else (0.0, 0.0)
        shown = np.where(np.isfinite(scores), (scores - low) / (span or 1), np.nan)
        axes.plot(timeline.centres, shown, color=style.colour, ls=style.dashes, lw=1.1, label=name)
    axes.set_ylim(-0.03, 1.03)
    axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
    axes.set_ylabel("score")
    hide_spines(axes, "top", "right")
    _put_legend_above(axes)


def _draw_extremes(axes: Axes, values: Extremes, *, style: PlotStyle, label: str) -> None:
    """Draw a quantity as a line, with a band if it changes faster than the line can show."""
    axes.fill_between(values.frames, values.low, values.high, color=style.colour, alpha=0.3, lw=0)
    axes.plot(values.frames, (values.low + values.high) / 2, color=style.colour, ls=style.dashes, lw=1.1, label=label)


def _group_alike(gains: Mapping[str, Extremes]) -> list[str]:
    """Return the names of light groups; names of groups with equal gains are joined by commas."""
    alike: dict[bytes, list[str]] = {}
    for name, gain in gains.items():
        alike.setdefault(gain.low.tobytes() + gain.high.tobytes(), []).append(name)
    return [", ".join(names) for names in alike.values()]


def _styles(names: Iterable[str], *, after: int = 0) -> list[PlotStyle]:
    all_names = [*map(str, range(after)), *names]
    styles = assign_styles(all_names)
    return [styles[name] for name in all_names[after:]]


def _put_legend_above(*axes: Axes) -> None:
    handles, labels = [], []
    for one in axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.append(handle)
            labels.append(textwrap.fill(label, LABEL, break_on_hyphens=False))
    for columns in (3, 2, 1):
        legend = axes[0].legend(
            handles, labels, loc="lower left", bbox_to_anchor=(0, 0.97), ncols=columns, borderpad=0, borderaxespad=0.1,
            handlelength=1.6, columnspacing=1.2, handletextpad=0.5,
        )  # fmt: skip
        if legend.get_window_extent().width <= LEGEND * axes[0].figure.bbox.width:
            break
    legend.set_in_layout(True)


# Heights in inches of a plot, its axis, a caption, and the tallest picture.
PANEL, AXIS, CAPTION, TALLEST = 0.72, 0.3, 0.15, 2.5
PRINT_DOTS_PER_INCH = 300
BOX = "#ffd84a"


def draw_still(pictures: WindowPictures, timeline: Timeline, *, region: Region | None, path: Path, form: str) -> None:
    """Write pictures and plots to ``path`` as png or svg (``form``), 3.5 inches wide.

    The same input gives the same bytes.
    """
    count = len(pictures.starts)
    across = min(count, 3 if count <= 9 else 4 if count <= 16 else 6)
    down = -(-count // across)
    _, height, width = pictures.stream.shape
    each = min(COLUMN / across * height / width, TALLEST) + CAPTION
    above, below = down * each, PANEL * len(list_panels(timeline)) + AXIS
    with use_plot_style(COLUMN_STYLE):
        below += stream_legends_height(timeline, width=COLUMN)
        figure = Figure(figsize=(COLUMN, above + below), dpi=PRINT_DOTS_PER_INCH, layout="constrained")
        FigureCanvasAgg(figure)
        layout: Any = figure.get_layout_engine()
        layout.set(w_pad=0.02, h_pad=0.02, wspace=0.02, hspace=0.02)
        halves: Any = figure.subfigures(2, 1, height_ratios=[above, below])
        cells = halves[0].subplots(down, across, squeeze=False).ravel()
        for cell in cells:
            cell.set_axis_off()
        for cell, picture, centre in zip(cells, pictures, pictures.centres, strict=False):
            cell.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            cell.set_title(_caption(pictures, centre), pad=2)
            if region is not None:
                cell.add_patch(_outline(region))
        axes = draw_panels(halves[1], timeline)
        for ax in axes:
            for centre in pictures.centres:
                ax.axvline(centre, color=SOFT, lw=0.5, ls=":")
        figure.savefig(path, format=form, metadata={"Date": None} if form == "svg" else None)


def _caption(pictures: WindowPictures, centre: float) -> str:
    lens = pictures.stream.metadata.lens_position
    return f"frame {centre:,.0f}" + ("" if lens is None else f", lens {lens[round(centre)]:.2f}")


def _outline(region: Region) -> Rectangle:
    rows, columns = region
    corner = (columns.start - 0.5, rows.start - 0.5)
    return Rectangle(
        corner, columns.stop - columns.start, rows.stop - rows.start, fill=False, edgecolor=BOX, linewidth=0.7
    )
