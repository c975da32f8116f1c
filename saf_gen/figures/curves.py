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

from saf_gen.contest.results import Sweep
from saf_gen.figures._answers import Answers, answers_of, draw_answers
from saf_gen.figures._legend import legend_below, legend_inches
from saf_gen.figures._lens import LENS_LINE, draw_truth, frames_on_top, lens_axis, places
from saf_gen.figures._style import (
    BAND,
    GREY,
    INK,
    MOST,
    SOFT,
    Look,
    bare,
    drawing,
    first_of,
    new_figure,
)
from saf_gen.records import Record

__all__ = ["Cursor", "cursor", "curves_figure", "normalised"]

SEARCHES = 6
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


def normalised(scores: np.ndarray) -> np.ndarray:
    """Scores (B,) moved and scaled to 0…1, as in the paper's Fig. 4; a flat curve is 0, NaN stays NaN."""
    values = np.asarray(scores, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() == finite.min():
        return np.where(np.isfinite(values), 0.0, np.nan)
    scaled: np.ndarray = (values - finite.min()) / (finite.max() - finite.min())
    return scaled


def curves_figure(
    sweep: Sweep, records: Sequence[Record], looks: Mapping[str, Look], *, title: str
) -> Figure:
    """The curves of ``sweep``, and above them a row for each search with the answers in ``records``.

    Curves run over the focus position, or over frames with the position as a line where the lens comes back
    or rests. Each is normalised by its own range, with the light (mean counts) as a grey area under them, and
    the truth as a line in a band, its depth of focus. Measures whose curves coincide share a line. Drawn are
    those of ``looks``, in its order: MOST at most, those with curves before those with an answer alone; and
    the first SEARCHES searches. A sweep without curves has light, lens, truth and answers.
    """
    answers = answers_of(records, looks)
    curved = {curve.measure for curve in sweep.curves}
    answered = {measure for by_measure in answers.values() for measure in by_measure}
    groups = _coincident(sweep, looks)[:MOST]
    alone = [m for m in looks if m in answered and m not in curved][: MOST - len(groups)]
    shown = [measure for group in groups for measure in group] + alone
    drawn = _drawn(answers, shown)
    note = first_of(
        (len(drawn), len(answers), "searches"),
        (len(shown), sum(m in curved or m in answered for m in looks), "measures"),
    )
    handles, names = _legend(groups, alone, looks, sweep)
    below = legend_inches(names, note=note)
    with drawing():
        figure = new_figure(REST + ROW * len(drawn) + PLOT + below, title=title)
        ratios = [max(ROW * len(drawn), 0.01), PLOT]
        strip, axes = figure.subplots(2, sharex=True, gridspec_kw={"height_ratios": ratios, "hspace": 0.01})
        axes.set_label(CURVES)
        place = places(sweep)
        _light(axes, sweep, place(sweep.frames))
        by_name = {curve.measure: curve for curve in sweep.curves}
        for group in groups:
            curve, look = by_name[group[0]], looks[group[0]]
            axes.plot(place(curve.frames), normalised(curve.scores), c=look.colour, ls=look.dashes, lw=1.3)
        _height(axes, sweep, curves=bool(groups))
        draw_answers(strip, drawn, [*(group[0] for group in groups), *alone], looks, sweep)
        frames_on_top(strip, sweep, label=axes)
        draw_truth(axes, sweep)
        draw_truth(strip, sweep, note=False)
        legend_below(figure, handles, names, note=note)
    return figure


def cursor(figure: Figure, sweep: Sweep, frames: np.ndarray) -> Cursor:
    """Where ``frames`` (n,) lie in the picture of a curves figure of ``sweep``."""
    with drawing():
        figure.draw_without_rendering()
    axes = next(a for a in figure.axes if a.get_label() == CURVES)
    strip = figure.axes[0].get_position()
    x = axes.transData.transform(np.column_stack([places(sweep)(frames), np.zeros(len(frames))]))[:, 0]
    across = np.clip(x / figure.bbox.width, 0, 1)
    return Cursor(tuple(across.tolist()), float(1 - strip.y1), float(1 - axes.get_position().y0))


def _coincident(sweep: Sweep, looks: Mapping[str, Look]) -> list[list[str]]:
    """Measures in the order of their looks, those whose curves cannot be told apart together."""
    drawn = {c.measure: normalised(c.scores) for c in sweep.curves}
    groups: list[list[str]] = []
    for measure in (name for name in looks if name in drawn):
        for group in groups:
            if _same(drawn[measure], drawn[group[0]]):
                group.append(measure)
                break
        else:
            groups.append([measure])
    return groups


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and bool(np.allclose(a, b, atol=1e-3, equal_nan=True))


def _drawn(answers: Answers, shown: Sequence[str]) -> dict[str, dict[str, float]]:
    """The answers of the measures that are shown, of the first SEARCHES searches that have any."""
    kept = {s: {m: f for m, f in held.items() if m in shown} for s, held in answers.items()}
    return dict([(search, held) for search, held in kept.items() if held][:SEARCHES])


def _height(axes: Axes, sweep: Sweep, *, curves: bool) -> None:
    """What the height over the light is: scores, else the lens where it is a line, else nothing."""
    axes.set_ylim(0, 1.03)
    over_frames = lens_axis(sweep) is None and sweep.focus_position is not None
    if curves or over_frames:
        axes.set_yticks([0, 0.5, 1], ["0", "0.5", "1"])
        axes.set_ylabel("focus score, normalised" if curves else "focus position")
        bare(axes, "top", "right")
    else:
        axes.set_yticks([])
        bare(axes, "top", "right", "left")


def _light(axes: Axes, sweep: Sweep, x: np.ndarray) -> None:
    light = axes.twinx()
    axes.set_zorder(light.get_zorder() + 1)
    axes.patch.set_visible(False)
    brightest = float(np.nanmax(sweep.rate, initial=0.0)) or 1.0
    light.fill_between(x, sweep.rate, color=GREY, lw=0, step="mid")
    light.set_ylim(0, brightest * 1.03)  # the brightest light reaches a score of 1
    light.set_yticks([t for t in MaxNLocator(3).tick_values(0, brightest) if 0 <= t <= brightest * 1.01])
    light.tick_params(axis="y", labelcolor=SOFT)
    light.set_ylabel("spikes a pixel, readout", color=SOFT)
    bare(light, "top", "right", "left")


def _legend(
    groups: Sequence[Sequence[str]], alone: Sequence[str], looks: Mapping[str, Look], sweep: Sweep
) -> tuple[list[Any], list[str]]:
    handles: list[Any] = [looks[group[0]].line() for group in groups]
    names = [" = ".join(group[:TOGETHER]) + _more(len(group) - TOGETHER) for group in groups]
    handles += [looks[measure].line(ls="") for measure in alone]
    names += alone
    handles += [Patch(color=GREY), (Patch(color=BAND, alpha=0.45), Line2D([], [], color=INK, lw=1.1))]
    names += ["light (mean counts)", "true focus, its depth of focus"]
    if lens_axis(sweep) is None and sweep.focus_position is not None:
        handles.append(Line2D([], [], **LENS_LINE))
        names.append("focus position, 0 to 1")
    return handles, names


def _more(count: int) -> str:
    return f" = {count} more" if count > 0 else ""
