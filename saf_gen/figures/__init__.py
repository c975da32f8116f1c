"""Figures of an evaluation, each one drawing of one thing: curves, errors, conditions, ways of searches."""

from matplotlib.figure import Figure

from saf_gen.figures._style import MOST, PREDICTED, Look, inlined, looks, on_paper, split_method, to_svg
from saf_gen.figures.against import CONDITIONS, Condition, against_figure
from saf_gen.figures.curves import Cursor, cursor, curves_figure, normalised
from saf_gen.figures.errors import errors_figure
from saf_gen.figures.film import Film, film
from saf_gen.figures.traces import paths_figure, traces_figure

__all__ = [
    "CONDITIONS",
    "MOST",
    "PREDICTED",
    "Condition",
    "Cursor",
    "Figure",
    "Film",
    "Look",
    "against_figure",
    "cursor",
    "curves_figure",
    "errors_figure",
    "film",
    "inlined",
    "looks",
    "normalised",
    "on_paper",
    "paths_figure",
    "split_method",
    "to_svg",
    "traces_figure",
]
