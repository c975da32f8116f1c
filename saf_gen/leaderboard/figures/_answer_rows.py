"""The rows above focus curves: one per search, with a mark at the answer of each measure."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.figure_style import GREY, PAPER, PlotStyle, hide_spines
from saf_gen.leaderboard.figures._figure import PREDICTIONS_LABEL, shorten_figure_label, split_figure_label
from saf_gen.leaderboard.figures._sweep_axis import frames_to_figure_axis

MAX_ROW_CHARACTERS = 18
"""Largest length of the label of a row, in characters."""
AnswersBySearch = Mapping[str, Mapping[str, float]]
"""Frame of each answer, by search, then by measure."""


def group_figure_answers(records: Sequence[Record], styles: Mapping[str, PlotStyle]) -> dict[str, dict[str, float]]:
    """Return the frame of each answer of the measures in ``styles``, in the order of ``records``."""
    answers: dict[str, dict[str, float]] = {}
    for record in records:
        measure, search = split_figure_label(record.method)
        if measure in styles and record.frame is not None:
            answers.setdefault(search, {})[measure] = record.frame
    return answers


def draw_figure_answer_rows(
    axes: Axes, answers: AnswersBySearch, *, shown: Sequence[str], styles: Mapping[str, PlotStyle], sweep: SweepSummary
) -> None:
    """Draw one row per search; in each row, the measures of ``shown`` come first, in the order of ``shown``."""
    to_axis = frames_to_figure_axis(sweep)
    for row, by_measure in enumerate(answers.values()):
        axes.axhline(row + 0.5, color=GREY, lw=0.6, zorder=0.1)
        ordered = [m for m in shown if m in by_measure] + [m for m in by_measure if m not in shown]
        for number, measure in enumerate(ordered):
            height = row + ((number + 0.5) / len(ordered) - 0.5) * 0.7
            style = styles[measure]
            x = to_axis(np.array([by_measure[measure]]))
            axes.plot(x, height, style.marker, c=style.colour, ms=4.5, mec=PAPER, mew=0.5, clip_on=False)
    axes.set_yticks(
        range(len(answers)), [shorten_figure_label(s or PREDICTIONS_LABEL, MAX_ROW_CHARACTERS) for s in answers]
    )
    axes.set_ylim(max(len(answers), 1) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0, labelsize=7.5)
    axes.tick_params(axis="x", bottom=False, labelbottom=False)
    hide_spines(axes, "left", "right", "top", "bottom")
