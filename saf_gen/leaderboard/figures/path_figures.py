"""Figures of paths: the steps of searches on a recording, and the path of the lens in the closed loop."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import LensPath, SweepSummary
from saf_gen.core.figure_style import BAND, GREY, INK, MAX_MEASURES, PAPER, PlotStyle, hide_spines, use_plot_style
from saf_gen.leaderboard.figures._figure import (
    PREDICTIONS_LABEL,
    create_leaderboard_figure,
    describe_figure_omissions,
    shorten_figure_label,
    split_figure_label,
)
from saf_gen.leaderboard.figures._legend import add_figure_legend, figure_legend_height
from saf_gen.leaderboard.figures._sweep_axis import (
    find_figure_frames_in_focus,
    find_figure_position_axis,
    find_figure_runs,
    find_figure_truth_crossings,
    frames_to_figure_axis,
)

T = TypeVar("T")
MAX_COLUMNS, MAX_SEARCHES = 3, 9
MAX_PANEL_CHARACTERS = 19
"""Largest length of the title of a panel, in characters."""
MIN_STEPS = 3
"""Smallest number of steps of a trace that is drawn; a shorter trace has narrowed nothing down."""


def plot_search_step_figure(
    sweep: SweepSummary, records: Sequence[Record], *, styles: Mapping[str, PlotStyle], title: str
) -> Figure | None:
    """Return the figure of the positions that each search examined on the recording ``sweep``, step by step.

    There is one panel per search and one line per measure; the truth is drawn across each panel. The result is None if
    no search has at least MIN_STEPS steps.
    """
    found, note = _by_search([(r.method, r) for r in records if len(r.trace) >= MIN_STEPS], styles)
    if not found:
        return None
    to_axis = frames_to_figure_axis(sweep)
    over_frames = find_figure_position_axis(sweep) is None
    measures = list(dict.fromkeys(m for group in found.values() for m in group))
    with use_plot_style():
        figure, panels = _panels(list(found), measures, styles=styles, title=title, note=note)
        for axes, group in zip(panels, found.values(), strict=False):
            _draw_truth_across(axes, sweep)
            for measure, record in group.items():
                style = styles[measure]
                line = to_axis(_zero_based_trace(record))
                steps = np.arange(len(line))
                axes.plot(steps, line, color=style.colour, ls=style.dashes, lw=1.1)
                axes.plot(steps[-1], line[-1], style.marker, c=style.colour, ms=4.5, mec=PAPER, mew=0.5)
        frames = len(sweep.focus_position) if sweep.focus_position is not None else sweep.frames[-1]
        for axes in panels:
            axes.set_ylim(*((0, frames) if over_frames else (0, 1)))
        _label_axes(panels, x="step", y="frame" if over_frames else "focus position")
    return figure


def plot_lens_path_figure(paths: Sequence[LensPath], *, styles: Mapping[str, PlotStyle], title: str) -> Figure | None:
    """Return the figure of the lens paths in one sequence, with one panel per search and one line per measure.

    A line ends where the lens was judged. The result is None if there is no path.
    """
    found, note = _by_search([(p.method, p) for p in paths if len(p.seconds)], styles)
    if not found:
        return None
    measures = list(dict.fromkeys(m for group in found.values() for m in group))
    with use_plot_style():
        figure, panels = _panels(list(found), measures, styles=styles, title=title, note=note)
        for axes, group in zip(panels, found.values(), strict=False):
            longest = max(group.values(), key=lambda p: p.seconds[-1])
            if longest.depth_of_focus is not None:
                half = longest.depth_of_focus / 2
                near, far = longest.truth - half, longest.truth + half
                axes.fill_between(longest.seconds, near, far, color=BAND, alpha=0.45, lw=0)
            axes.plot(longest.seconds, longest.truth, color=INK, lw=1.0)
            for measure, path in group.items():
                style = styles[measure]
                axes.plot(path.seconds, path.position, color=style.colour, ls=style.dashes, lw=1.1)
                mark = "x" if path.problem else style.marker
                edge = style.colour if path.problem else PAPER
                axes.plot(path.seconds[-1], path.position[-1], mark, c=style.colour, ms=4.5, mec=edge, clip_on=False)
            axes.set_ylim(0, 1)
        _label_axes(panels, x="seconds", y="focus position")
    return figure


def _by_search(items: Sequence[tuple[str, T]], styles: Mapping[str, PlotStyle]) -> tuple[dict[str, dict[str, T]], str]:
    """Return the items by search, then by measure, and a note on searches and measures that are left out.

    At most MAX_SEARCHES searches are kept, in the order given, and MAX_MEASURES measures, in the order of ``styles``.
    """
    present = {split_figure_label(method)[0] for method, _ in items}
    shown = [m for m in styles if m in present][:MAX_MEASURES]
    found: dict[str, dict[str, T]] = {}
    for method, item in items:
        measure, search = split_figure_label(method)
        if measure in shown and (search in found or len(found) < MAX_SEARCHES):
            found.setdefault(search, {})[measure] = item
    searches = {split_figure_label(method)[1] for method, _ in items}
    drawn = {measure for group in found.values() for measure in group}
    return found, describe_figure_omissions(
        (len(found), len(searches), "searches"), (len(drawn), len(present), "measures")
    )


def _panels(
    searches: Sequence[str], measures: Sequence[str], *, styles: Mapping[str, PlotStyle], title: str, note: str
) -> tuple[Figure, list[Axes]]:
    """Return a figure with one empty panel per search, and the panels."""
    columns = min(len(searches), MAX_COLUMNS)
    rows = math.ceil(len(searches) / columns)
    names = [*measures, "true focus"]
    figure = create_leaderboard_figure(0.95 + 1.35 * rows + figure_legend_height(names, note=note), title=title)
    panels = list(figure.subplots(rows, columns, squeeze=False, sharex=rows > 1, sharey=True).flat)
    for axes, search in zip(panels, searches, strict=False):
        axes.set_title(shorten_figure_label(search or PREDICTIONS_LABEL, MAX_PANEL_CHARACTERS), fontsize=8, loc="left")
        axes.grid(axis="y", color=GREY, lw=0.6)
        axes.set_axisbelow(True)
        hide_spines(axes, "top", "right")
    for axes in panels[len(searches) :]:
        axes.set_visible(False)
    handles: list[Any] = [styles[m].legend_handle() for m in measures]
    handles.append((Patch(color=BAND, alpha=0.45), Line2D([], [], color=INK, lw=1.1)))
    add_figure_legend(figure, handles, names=names, note=note)
    return figure, panels[: len(searches)]


def _label_axes(panels: Sequence[Axes], *, x: str, y: str) -> None:
    """Label the x axis below the lowest panel of each column, and the y axis at the first panel of each row."""
    for number, axes in enumerate(panels):
        if number + MAX_COLUMNS >= len(panels):
            axes.set_xlabel(x)
            if x == "step":
                axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.tick_params(axis="x", labelbottom=True)
        if number % MAX_COLUMNS == 0:
            axes.set_ylabel(y)


def _zero_based_trace(record: Record) -> np.ndarray:
    """Return the trace in frames counted from 0; traces of searches that follow released code count from 1."""
    trace = np.array(record.trace, dtype=np.float64)
    is_one_based = record.frame is not None and abs(trace[-1] - record.frame - 1) < 1e-6
    return trace - 1 if is_one_based else trace


def _draw_truth_across(axes: Axes, sweep: SweepSummary) -> None:
    """Draw the truth and its depth of focus as horizontal lines and bands; on an axis of frames, every crossing."""
    lens = sweep.focus_position
    if find_figure_position_axis(sweep) is not None:
        if all(map(math.isfinite, sweep.depth_of_focus)):
            axes.axhspan(*sorted(sweep.depth_of_focus), color=BAND, alpha=0.45, lw=0)
        if math.isfinite(sweep.truth):
            axes.axhline(sweep.truth, color=INK, lw=1.0)
    elif lens is None:
        if math.isfinite(sweep.truth_frame):
            axes.axhline(sweep.truth_frame, color=INK, lw=1.0)
    else:
        for first, stop in find_figure_runs(find_figure_frames_in_focus(sweep, lens)):
            axes.axhspan(first, stop, color=BAND, alpha=0.45, lw=0)
        for frame in find_figure_truth_crossings(sweep, lens):
            axes.axhline(frame, color=INK, lw=1.0)
