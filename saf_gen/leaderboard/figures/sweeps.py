"""Figures of one recording: its focus curves with all answers, the steps of searches, and the path of the lens.

The focus curves are like Figures 4 to 7 of Su et al. (CVPR 2024).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from saf_gen.benchmark.judgement import lens_position
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import LensPath, SweepSummary
from saf_gen.core.figure_style import BAND, GREY, INK, MAX_MEASURES, PAPER, SOFT, PlotStyle, hide_spines, use_plot_style
from saf_gen.leaderboard.figures.figure import add_legend, describe_omissions, legend_height, new_figure, shorten
from saf_gen.leaderboard.sweep_lines import (
    PREDICTIONS_LABEL,
    AnswersBySearch,
    choose_answers,
    find_runs,
    frames_in_focus,
    frames_to_axis,
    group_answers,
    group_coincident,
    normalise,
    position_axis,
    split_method,
    truth_crossings,
)

LENS_LINE: dict[str, Any] = {"color": SOFT, "lw": 0.9, "ls": (0, (7, 2))}


def _draw_truth(axes: Axes, sweep: SweepSummary, *, note: bool = True) -> None:
    """Draw the truth as a line in a band that shows its depth of focus; on an axis of frames, at every crossing.

    With ``note``, an axis of frames also gets the position of the lens, and an axis of positions gets a text if the
    truth is outside it.
    """
    over_frames = position_axis(sweep) is None
    if over_frames and sweep.focus_position is not None:
        _draw_truth_over_frames(axes, sweep, lens=sweep.focus_position, draw_lens=note)
        return
    truth = sweep.truth_frame if over_frames else sweep.truth
    if not math.isfinite(truth):
        return
    limits = axes.get_xlim()
    if not over_frames and all(map(math.isfinite, sweep.depth_of_focus)):
        axes.axvspan(*sorted(sweep.depth_of_focus), color=BAND, alpha=0.45, lw=0, zorder=0.5)
    axes.axvline(truth, color=INK, lw=1.1, zorder=0.6)
    axes.set_xlim(limits)
    if note and not min(limits) <= truth <= max(limits):
        is_right = (truth > max(limits)) == (limits[0] < limits[1])
        text = f"focus at {truth:.2f} →" if is_right else f"← focus at {truth:.2f}"
        x, side = (0.99, "right") if is_right else (0.01, "left")
        axes.text(x, 0.9, text, transform=axes.get_yaxis_transform(), ha=side)


def _draw_truth_over_frames(axes: Axes, sweep: SweepSummary, *, lens: np.ndarray, draw_lens: bool) -> None:
    """Draw each crossing of the truth and the frames in which the lens is in focus.

    With ``draw_lens``, also draw the position of the lens and, if the truth moves, the position of the truth.
    """
    all_frames, height = np.arange(len(lens)), axes.get_xaxis_transform()
    frames = np.linspace(0, len(lens) - 1, min(len(lens), 400))
    if draw_lens:
        axes.plot(frames, np.interp(frames, all_frames, lens), **LENS_LINE, zorder=0.7)
        if sweep.track is not None:
            moving = np.interp(frames, all_frames, sweep.track)
            axes.plot(frames, moving, color=INK, lw=0.9, ls=":", zorder=0.7)
    for first, stop in find_runs(frames_in_focus(sweep, lens)):
        axes.axvspan(first, stop, color=BAND, alpha=0.45, lw=0, zorder=0.5)
    axes.vlines(truth_crossings(sweep, lens), 0, 1, color=INK, lw=1.1, zorder=0.6, transform=height)


def _add_frame_axis(axes: Axes, sweep: SweepSummary, *, label: Axes) -> None:
    """Set the limits and label of the horizontal axis; an axis of positions gets frames along the top."""
    lens = position_axis(sweep)
    if lens is None:
        label.set_xlim(0, sweep.frames[-1] + sweep.frames[0])
        label.set_xlabel("frame")
        return
    label.set_xlim(float(lens.min()), float(lens.max()))
    label.set_xlabel("focus position, fraction of travel")
    ticks = [t for t in MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(0, len(lens) - 1) if 0 <= t <= len(lens)]
    upper = axes.secondary_xaxis("top")
    upper.set_xticks([lens_position(t, lens) for t in ticks], [f"{t:,.0f}" for t in ticks])
    upper.tick_params(colors=SOFT, labelcolor=SOFT, labelsize=7.5, pad=1, length=2.5)
    upper.spines["top"].set_color(GREY)
    upper.set_xlabel("frame", fontsize=7.5, color=SOFT, labelpad=4)


MAX_SEARCHES = 6
"""Largest number of rows of answers in a figure."""
MAX_NAMES = 3
"""Largest number of measures named on one line of the legend; the number of others is given."""
MAX_ROW_CHARACTERS = 18
"""Largest length of the label of a row, in characters."""
ROW, PLOT, REST = 0.22, 1.75, 0.95  # inches: a row of answers, the curves, margins


def plot_curves(
    sweep: SweepSummary, records: Sequence[Record], *, styles: Mapping[str, PlotStyle], title: str
) -> Figure:
    """Return the figure of the focus curves of ``sweep`` with, above them, the answers in ``records``.

    There is one row of answers per search. Curves are drawn against the focus position or, if the lens turns back
    or rests, against frames, with the position as a line. Each curve is scaled to its range. The light (mean counts) is
    a grey area behind the curves, and the truth is a line in a band that shows its depth of focus. Measures
    whose curves coincide share a line. For a sweep without curves, the figure shows light, lens, truth and answers.

    At most MAX_MEASURES lines and measures without a curve are drawn, lines first, in the order of ``styles``, and the
    answers of the first MAX_SEARCHES searches.
    """
    answers = group_answers(records, list(styles))
    curved = {curve.measure for curve in sweep.curves}
    answered = {measure for by_measure in answers.values() for measure in by_measure}
    groups = group_coincident(sweep, list(styles))[:MAX_MEASURES]
    uncurved = [m for m in styles if m in answered and m not in curved][: MAX_MEASURES - len(groups)]
    shown = [measure for group in groups for measure in group] + uncurved
    drawn = choose_answers(answers, shown, most=MAX_SEARCHES)
    note = describe_omissions(
        (len(drawn), len(answers), "searches"),
        (len(shown), sum(m in curved or m in answered for m in styles), "measures"),
    )
    handles, names = _list_legend(groups, uncurved=uncurved, styles=styles, sweep=sweep)
    below = legend_height(names, note=note)
    with use_plot_style():
        figure = new_figure(REST + ROW * len(drawn) + PLOT + below, title=title)
        ratios = [max(ROW * len(drawn), 0.01), PLOT]
        strip, axes = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": ratios, "hspace": 0.01})
        to_axis = frames_to_axis(sweep)
        _draw_light(axes, sweep, x=to_axis(sweep.frames))
        by_name = {curve.measure: curve for curve in sweep.curves}
        for group in groups:
            curve, style = by_name[group[0]], styles[group[0]]
            axes.plot(to_axis(curve.frames), normalise(curve.scores), c=style.colour, ls=style.dashes, lw=1.3)
        _set_height(axes, sweep, has_curves=bool(groups))
        _draw_answer_rows(strip, drawn, shown=[*(group[0] for group in groups), *uncurved], styles=styles, sweep=sweep)
        _add_frame_axis(strip, sweep, label=axes)
        _draw_truth(axes, sweep)
        _draw_truth(strip, sweep, note=False)
        add_legend(figure, handles, names=names, note=note)
    return figure


def _draw_answer_rows(
    axes: Axes, answers: AnswersBySearch, *, shown: Sequence[str], styles: Mapping[str, PlotStyle], sweep: SweepSummary
) -> None:
    """Draw one row per search; in each row, the measures of ``shown`` come first, in the order of ``shown``."""
    to_axis = frames_to_axis(sweep)
    for row, by_measure in enumerate(answers.values()):
        axes.axhline(row + 0.5, color=GREY, lw=0.6, zorder=0.1)
        ordered = [m for m in shown if m in by_measure] + [m for m in by_measure if m not in shown]
        for number, measure in enumerate(ordered):
            height = row + ((number + 0.5) / len(ordered) - 0.5) * 0.7
            style = styles[measure]
            x = to_axis(np.array([by_measure[measure]]))
            axes.plot(x, height, style.marker, c=style.colour, ms=4.5, mec=PAPER, mew=0.5, clip_on=False)
    axes.set_yticks(range(len(answers)), [shorten(s or PREDICTIONS_LABEL, MAX_ROW_CHARACTERS) for s in answers])
    axes.set_ylim(max(len(answers), 1) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0, labelsize=7.5)
    axes.tick_params(axis="x", bottom=False, labelbottom=False)
    hide_spines(axes, "left", "right", "top", "bottom")


def _set_height(axes: Axes, sweep: SweepSummary, *, has_curves: bool) -> None:
    """Label the vertical axis as scores or, without curves, as the drawn focus position; otherwise hide it."""
    axes.set_ylim(0, 1.03)
    over_frames = position_axis(sweep) is None and sweep.focus_position is not None
    if has_curves or over_frames:
        axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
        axes.set_ylabel("focus score, normalised" if has_curves else "focus position")
        hide_spines(axes, "top", "right")
    else:
        axes.set_yticks([])
        hide_spines(axes, "top", "right", "left")


def _draw_light(axes: Axes, sweep: SweepSummary, *, x: np.ndarray) -> None:
    """Draw the mean counts as an area behind the curves, scaled so that the largest is as high as a score of 1."""
    light = axes.twinx()
    axes.set_zorder(light.get_zorder() + 1)
    axes.patch.set_visible(False)
    brightest = float(np.nanmax(sweep.rate, initial=0.0)) or 1.0
    light.fill_between(x, sweep.rate, color=GREY, lw=0, step="mid")
    light.set_ylim(0, brightest * 1.03)
    light.set_yticks([t for t in MaxNLocator(3).tick_values(0, brightest) if 0 <= t <= brightest * 1.01])
    light.tick_params(axis="y", labelcolor=SOFT)
    light.set_ylabel("spikes per pixel and readout", color=SOFT)
    hide_spines(light, "top", "right", "left")


def _list_legend(
    groups: Sequence[Sequence[str]], *, uncurved: Sequence[str], styles: Mapping[str, PlotStyle], sweep: SweepSummary
) -> tuple[list[Any], list[str]]:
    """Return the samples and the names of the legend."""
    handles: list[Any] = [styles[group[0]].legend_handle() for group in groups]
    rest = [f" = {len(group) - MAX_NAMES} more" if len(group) > MAX_NAMES else "" for group in groups]
    names = [" = ".join(group[:MAX_NAMES]) + more for group, more in zip(groups, rest, strict=True)]
    handles += [styles[measure].legend_handle(ls="") for measure in uncurved]
    names += uncurved
    handles += [Patch(color=GREY), (Patch(color=BAND, alpha=0.45), Line2D([], [], color=INK, lw=1.1))]
    names += ["light (mean counts)", "true focus, its depth of focus"]
    if position_axis(sweep) is None and sweep.focus_position is not None:
        handles.append(Line2D([], [], **LENS_LINE))
        names.append("focus position, 0 to 1")
    return handles, names


T = TypeVar("T")
MAX_COLUMNS, MAX_PANELS = 3, 9
MAX_PANEL_CHARACTERS = 19
"""Largest length of the title of a panel, in characters."""
MIN_STEPS = 3
"""Smallest number of steps of a trace that is drawn; a shorter trace has narrowed nothing down."""


def plot_steps(
    sweep: SweepSummary, records: Sequence[Record], *, styles: Mapping[str, PlotStyle], title: str
) -> Figure | None:
    """Return the figure of the positions that each search examined on the recording ``sweep``, step by step.

    There is one panel per search and one line per measure; the truth is drawn across each panel. The result is None if
    no search has at least MIN_STEPS steps.
    """
    found, note = _by_search([(r.method, r) for r in records if len(r.trace) >= MIN_STEPS], styles)
    if not found:
        return None
    to_axis = frames_to_axis(sweep)
    over_frames = position_axis(sweep) is None
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


def plot_lens_paths(paths: Sequence[LensPath], *, styles: Mapping[str, PlotStyle], title: str) -> Figure | None:
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

    At most MAX_PANELS searches are kept, in the order given, and MAX_MEASURES measures, in the order of ``styles``.
    """
    present = {split_method(method)[0] for method, _ in items}
    shown = [m for m in styles if m in present][:MAX_MEASURES]
    found: dict[str, dict[str, T]] = {}
    for method, item in items:
        measure, search = split_method(method)
        if measure in shown and (search in found or len(found) < MAX_PANELS):
            found.setdefault(search, {})[measure] = item
    searches = {split_method(method)[1] for method, _ in items}
    drawn = {measure for group in found.values() for measure in group}
    return found, describe_omissions((len(found), len(searches), "searches"), (len(drawn), len(present), "measures"))


def _panels(
    searches: Sequence[str], measures: Sequence[str], *, styles: Mapping[str, PlotStyle], title: str, note: str
) -> tuple[Figure, list[Axes]]:
    """Return a figure with one empty panel per search, and the panels."""
    columns = min(len(searches), MAX_COLUMNS)
    rows = math.ceil(len(searches) / columns)
    names = [*measures, "true focus"]
    figure = new_figure(0.95 + 1.35 * rows + legend_height(names, note=note), title=title)
    panels = list(figure.subplots(rows, columns, squeeze=False, sharex=rows > 1, sharey=True).flat)
    for axes, search in zip(panels, searches, strict=False):
        axes.set_title(shorten(search or PREDICTIONS_LABEL, MAX_PANEL_CHARACTERS), fontsize=8, loc="left")
        axes.grid(axis="y", color=GREY, lw=0.6)
        axes.set_axisbelow(True)
        hide_spines(axes, "top", "right")
    for axes in panels[len(searches) :]:
        axes.set_visible(False)
    handles: list[Any] = [styles[m].legend_handle() for m in measures]
    handles.append((Patch(color=BAND, alpha=0.45), Line2D([], [], color=INK, lw=1.1)))
    add_legend(figure, handles, names=names, note=note)
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
    if position_axis(sweep) is not None:
        if all(map(math.isfinite, sweep.depth_of_focus)):
            axes.axhspan(*sorted(sweep.depth_of_focus), color=BAND, alpha=0.45, lw=0)
        if math.isfinite(sweep.truth):
            axes.axhline(sweep.truth, color=INK, lw=1.0)
    elif lens is None:
        if math.isfinite(sweep.truth_frame):
            axes.axhline(sweep.truth_frame, color=INK, lw=1.0)
    else:
        for first, stop in find_runs(frames_in_focus(sweep, lens)):
            axes.axhspan(first, stop, color=BAND, alpha=0.45, lw=0)
        for frame in truth_crossings(sweep, lens):
            axes.axhline(frame, color=INK, lw=1.0)
