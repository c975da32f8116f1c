"""The rows over the curves: a search each, with a mark where each measure led it."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from saf_gen.contest.results import Sweep
from saf_gen.figures._lens import places
from saf_gen.figures._style import GREY, PAPER, PREDICTED, Look, bare, shortened, split_method
from saf_gen.records import Record

__all__ = ["Answers", "answers_of", "draw_answers"]

LETTERS = 18
"""Of the name of a row."""
Answers = Mapping[str, Mapping[str, float]]
"""By search, then by measure: the frame that was answered."""


def answers_of(records: Sequence[Record], looks: Mapping[str, Look]) -> dict[str, dict[str, float]]:
    """The answers of the measures that have looks, in the order of ``records``."""
    found: dict[str, dict[str, float]] = {}
    for record in records:
        measure, search = split_method(record.method)
        if measure in looks and record.frame is not None:
            found.setdefault(search, {})[measure] = record.frame
    return found


def draw_answers(
    axes: Axes, answers: Answers, shown: Sequence[str], looks: Mapping[str, Look], sweep: Sweep
) -> None:
    """A row for each search; the measures of ``shown`` first, in their order."""
    place = places(sweep)
    for row, by_measure in enumerate(answers.values()):
        axes.axhline(row + 0.5, color=GREY, lw=0.6, zorder=0.1)
        ordered = [m for m in shown if m in by_measure] + [m for m in by_measure if m not in shown]
        for number, measure in enumerate(ordered):
            height = row + ((number + 0.5) / len(ordered) - 0.5) * 0.7
            look = looks[measure]
            at = place(np.array([by_measure[measure]]))
            axes.plot(at, height, look.marker, c=look.colour, ms=4.5, mec=PAPER, mew=0.5, clip_on=False)
    axes.set_yticks(range(len(answers)), [shortened(s or PREDICTED, LETTERS) for s in answers])
    axes.set_ylim(max(len(answers), 1) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0, labelsize=7.5)
    axes.tick_params(axis="x", bottom=False, labelbottom=False)
    bare(axes, "left", "right", "top", "bottom")
