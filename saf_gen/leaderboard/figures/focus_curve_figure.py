"""Figure of the focus curves of one recording, with all answers, like Figures 4 to 7 of Su et al. (CVPR 2024)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.figure_style import BAND, GREY, INK, MAX_MEASURES, SOFT, PlotStyle, hide_spines, use_plot_style
from saf_gen.leaderboard.figures._answer_rows import AnswersBySearch, draw_figure_answer_rows, group_figure_answers
from saf_gen.leaderboard.figures._figure import create_leaderboard_figure, describe_figure_omissions
from saf_gen.leaderboard.figures._legend import add_figure_legend, figure_legend_height
from saf_gen.leaderboard.figures._sweep_axis import (
    LENS_LINE,
    add_figure_frame_axis,
    find_figure_position_axis,
    frames_to_figure_axis,
    plot_figure_truth,
)

MAX_SEARCHES = 6
"""Largest number of rows of answers in a figure."""
MAX_NAMES = 3
"""Largest number of measures named on one line of the legend; the number of others is given."""
ROW, PLOT, REST = 0.22, 1.75, 0.95  # inches: a row of answers, the curves, margins
CURVES = "curves"


@dataclass(frozen=True)
class Cursor:
    """Positions of frames in a figure of focus curves, as fractions of its width and height."""

    across: tuple[float, ...]
    """Position of each frame, from the left."""
    top: float
    """Upper edge of the answers, from the top."""
    bottom: float
    """Lower edge of the curves, from the top."""


def normalise_figure_curve(scores: np.ndarray) -> np.ndarray:
    """Return scores (B,) scaled to the range 0 to 1; constant scores become 0, and NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    return np.asarray((values - finite.min()) / (finite.max() - finite.min()))


def plot_focus_curve_figure(
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
    answers = group_figure_answers(records, styles)
    curved = {curve.measure for curve in sweep.curves}
    answered = {measure for by_measure in answers.values() for measure in by_measure}
    groups = _group_coincident(sweep, styles)[:MAX_MEASURES]
    uncurved = [m for m in styles if m in answered and m not in curved][: MAX_MEASURES - len(groups)]
    shown = [measure for group in groups for measure in group] + uncurved
    drawn = _choose_answers(answers, shown)
    note = describe_figure_omissions(
        (len(drawn), len(answers), "searches"),
        (len(shown), sum(m in curved or m in answered for m in styles), "measures"),
    )
    handles, names = _list_legend(groups, uncurved=uncurved, styles=styles, sweep=sweep)
    below = figure_legend_height(names, note=note)
    with use_plot_style():
        figure = create_leaderboard_figure(REST + ROW * len(drawn) + PLOT + below, title=title)
        ratios = [max(ROW * len(drawn), 0.01), PLOT]
        strip, axes = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": ratios, "hspace": 0.01})
        axes.set_label(CURVES)
        to_axis = frames_to_figure_axis(sweep)
        _draw_light(axes, sweep, x=to_axis(sweep.frames))
        by_name = {curve.measure: curve for curve in sweep.curves}
        for group in groups:
            curve, style = by_name[group[0]], styles[group[0]]
            axes.plot(
                to_axis(curve.frames), normalise_figure_curve(curve.scores), c=style.colour, ls=style.dashes, lw=1.3
            )
        _set_height(axes, sweep, has_curves=bool(groups))
        draw_figure_answer_rows(
            strip, drawn, shown=[*(group[0] for group in groups), *uncurved], styles=styles, sweep=sweep
        )
        add_figure_frame_axis(strip, sweep, label=axes)
        plot_figure_truth(axes, sweep)
        plot_figure_truth(strip, sweep, note=False)
        add_figure_legend(figure, handles, names=names, note=note)
    return figure


def locate_figure_cursor(figure: Figure, sweep: SweepSummary, *, frames: np.ndarray) -> Cursor:
    """Return the positions of ``frames`` (n,) in ``figure``, which plot_focus_curve_figure drew for ``sweep``."""
    with use_plot_style():
        figure.draw_without_rendering()
    axes = next(a for a in figure.axes if a.get_label() == CURVES)
    strip = figure.axes[0].get_position()
    x = axes.transData.transform(np.column_stack([frames_to_figure_axis(sweep)(frames), np.zeros(len(frames))]))[:, 0]
    across = np.clip(x / figure.bbox.width, 0, 1)
    return Cursor(tuple(across.tolist()), float(1 - strip.y1), float(1 - axes.get_position().y0))


def _group_coincident(sweep: SweepSummary, styles: Mapping[str, PlotStyle]) -> list[list[str]]:
    """Return groups of measures with the same curve, in the order of ``styles``."""
    drawn = {c.measure: normalise_figure_curve(c.scores) for c in sweep.curves}
    groups: list[list[str]] = []
    for measure in (name for name in styles if name in drawn):
        for group in groups:
            a, b = drawn[measure], drawn[group[0]]
            if a.shape == b.shape and np.allclose(a, b, atol=1e-3, equal_nan=True):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def _choose_answers(answers: AnswersBySearch, shown: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the answers of the measures in ``shown``, of the first MAX_SEARCHES searches that have any."""
    chosen = {s: {m: f for m, f in frames.items() if m in shown} for s, frames in answers.items()}
    return dict([(search, frames) for search, frames in chosen.items() if frames][:MAX_SEARCHES])


def _set_height(axes: Axes, sweep: SweepSummary, *, has_curves: bool) -> None:
    """Label the vertical axis as scores or, without curves, as the drawn focus position; otherwise hide it."""
    axes.set_ylim(0, 1.03)
    over_frames = find_figure_position_axis(sweep) is None and sweep.focus_position is not None
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
    if find_figure_position_axis(sweep) is None and sweep.focus_position is not None:
        handles.append(Line2D([], [], **LENS_LINE))
        names.append("focus position, 0 to 1")
    return handles, names
