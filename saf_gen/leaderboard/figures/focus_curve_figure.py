"""Focus curves of one recording, as Figures 4 to 7 of the paper have them, with every search's answer."""

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
from saf_gen.leaderboard.figures._answer_rows import AnswersBySearch, draw_answer_rows, group_answers
from saf_gen.leaderboard.figures._legend import add_legend_below, legend_height
from saf_gen.leaderboard.figures._style import (
    BAND,
    GREY,
    INK,
    MAX_MEASURES,
    SOFT,
    PlotStyle,
    create_figure,
    describe_omissions,
    hide_spines,
    use_figure_style,
)
from saf_gen.leaderboard.figures._sweep_axis import (
    LENS_LINE,
    add_frame_axis,
    draw_truth,
    find_position_axis,
    frames_to_axis,
)

__all__ = ["Cursor", "locate_cursor", "normalise_curve", "plot_focus_curves"]

MAX_SEARCHES = 6
"""Rows of answers in a figure."""
TOGETHER = 3
"""Names of measures that share a line; of more, their number."""
ROW, PLOT, REST = 0.22, 1.75, 0.95  # inches: a row of answers, the curves, margins
CURVES = "curves"


@dataclass(frozen=True)
class Cursor:
    """Where frames lie in the picture of a curves figure, as fractions of its width and height."""

    across: tuple[float, ...]
    """One for each frame asked for, from the left."""
    top: float
    """Of the answers, from the top."""
    bottom: float
    """Of the curves, from the top."""


def normalise_curve(scores: np.ndarray) -> np.ndarray:
    """Scores (B,) moved and scaled to 0…1, as in the paper's Fig. 4; a flat curve is 0, NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    scaled: np.ndarray = (values - finite.min()) / (finite.max() - finite.min())
    return scaled


def plot_focus_curves(
    sweep: SweepSummary, records: Sequence[Record], styles: Mapping[str, PlotStyle], *, title: str
) -> Figure:
    """The curves of ``sweep``, and above them a row for each search with the answers in ``records``.

    Curves run over the focus position, or over frames with the position as a line where the lens comes back
    or rests. Each is normalised by its own range, with the light (mean counts) as a grey area under them, and
    the truth as a line in a band, its depth of focus. Measures whose curves coincide share a line. Drawn are
    those of ``styles``, in its order: MAX_MEASURES at most, those with curves before those with an answer
    alone; and the first MAX_SEARCHES searches. A sweep without curves has light, lens, truth and answers.
    """
    answers = group_answers(records, styles)
    curved = {curve.measure for curve in sweep.curves}
    answered = {measure for by_measure in answers.values() for measure in by_measure}
    groups = _coincident(sweep, styles)[:MAX_MEASURES]
    alone = [m for m in styles if m in answered and m not in curved][: MAX_MEASURES - len(groups)]
    shown = [measure for group in groups for measure in group] + alone
    drawn = _drawn(answers, shown)
    note = describe_omissions(
        (len(drawn), len(answers), "searches"),
        (len(shown), sum(m in curved or m in answered for m in styles), "measures"),
    )
    handles, names = _legend(groups, alone, styles, sweep)
    below = legend_height(names, note=note)
    with use_figure_style():
        figure = create_figure(REST + ROW * len(drawn) + PLOT + below, title=title)
        ratios = [max(ROW * len(drawn), 0.01), PLOT]
        strip, axes = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": ratios, "hspace": 0.01})
        axes.set_label(CURVES)
        place = frames_to_axis(sweep)
        _light(axes, sweep, place(sweep.frames))
        by_name = {curve.measure: curve for curve in sweep.curves}
        for group in groups:
            curve, style = by_name[group[0]], styles[group[0]]
            axes.plot(
                place(curve.frames), normalise_curve(curve.scores), c=style.colour, ls=style.dashes, lw=1.3
            )
        _height(axes, sweep, curves=bool(groups))
        draw_answer_rows(strip, drawn, [*(group[0] for group in groups), *alone], styles, sweep)
        add_frame_axis(strip, sweep, label=axes)
        draw_truth(axes, sweep)
        draw_truth(strip, sweep, note=False)
        add_legend_below(figure, handles, names, note=note)
    return figure


def locate_cursor(figure: Figure, sweep: SweepSummary, frames: np.ndarray) -> Cursor:
    """Where ``frames`` (n,) lie in the picture of a curves figure of ``sweep``."""
    with use_figure_style():
        figure.draw_without_rendering()
    axes = next(a for a in figure.axes if a.get_label() == CURVES)
    strip = figure.axes[0].get_position()
    x = axes.transData.transform(np.column_stack([frames_to_axis(sweep)(frames), np.zeros(len(frames))]))[
        :, 0
    ]
    across = np.clip(x / figure.bbox.width, 0, 1)
    return Cursor(tuple(across.tolist()), float(1 - strip.y1), float(1 - axes.get_position().y0))


def _coincident(sweep: SweepSummary, styles: Mapping[str, PlotStyle]) -> list[list[str]]:
    """Measures in the order of their styles, those whose curves cannot be told apart together."""
    drawn = {c.measure: normalise_curve(c.scores) for c in sweep.curves}
    groups: list[list[str]] = []
    for measure in (name for name in styles if name in drawn):
        for group in groups:
            if _same(drawn[measure], drawn[group[0]]):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and bool(np.allclose(a, b, atol=1e-3, equal_nan=True))


def _drawn(answers: AnswersBySearch, shown: Sequence[str]) -> dict[str, dict[str, float]]:
    """The answers of the measures that are shown, of the first MAX_SEARCHES searches that have any."""
    kept = {s: {m: f for m, f in held.items() if m in shown} for s, held in answers.items()}
    return dict([(search, held) for search, held in kept.items() if held][:MAX_SEARCHES])


def _height(axes: Axes, sweep: SweepSummary, *, curves: bool) -> None:
    """What the height over the light is: scores, else the lens where it is a line, else nothing."""
    axes.set_ylim(0, 1.03)
    over_frames = find_position_axis(sweep) is None and sweep.focus_position is not None
    if curves or over_frames:
        axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
        axes.set_ylabel("focus score, normalised" if curves else "focus position")
        hide_spines(axes, "top", "right")
    else:
        axes.set_yticks([])
        hide_spines(axes, "top", "right", "left")


def _light(axes: Axes, sweep: SweepSummary, x: np.ndarray) -> None:
    light = axes.twinx()
    axes.set_zorder(light.get_zorder() + 1)
    axes.patch.set_visible(False)
    brightest = float(np.nanmax(sweep.rate, initial=0.0)) or 1.0
    light.fill_between(x, sweep.rate, color=GREY, lw=0, step="mid")
    light.set_ylim(0, brightest * 1.03)  # the brightest light reaches a score of 1
    light.set_yticks([t for t in MaxNLocator(3).tick_values(0, brightest) if 0 <= t <= brightest * 1.01])
    light.tick_params(axis="y", labelcolor=SOFT)
    light.set_ylabel("spikes a pixel, readout", color=SOFT)
    hide_spines(light, "top", "right", "left")


def _legend(
    groups: Sequence[Sequence[str]],
    alone: Sequence[str],
    styles: Mapping[str, PlotStyle],
    sweep: SweepSummary,
) -> tuple[list[Any], list[str]]:
    handles: list[Any] = [styles[group[0]].legend_handle() for group in groups]
    names = [" = ".join(group[:TOGETHER]) + _more(len(group) - TOGETHER) for group in groups]
    handles += [styles[measure].legend_handle(ls="") for measure in alone]
    names += alone
    handles += [Patch(color=GREY), (Patch(color=BAND, alpha=0.45), Line2D([], [], color=INK, lw=1.1))]
    names += ["light (mean counts)", "true focus, its depth of focus"]
    if find_position_axis(sweep) is None and sweep.focus_position is not None:
        handles.append(Line2D([], [], **LENS_LINE))
        names.append("focus position, 0 to 1")
    return handles, names


def _more(count: int) -> str:
    return f" = {count} more" if count > 0 else ""
