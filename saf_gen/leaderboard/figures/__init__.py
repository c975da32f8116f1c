"""Figures of an evaluation: focus curves, errors, success by condition, paths of searches and lens."""

from matplotlib.figure import Figure

from saf_gen.core.figure_style import MAX_MEASURES, PlotStyle, assign_styles, inline_svg, to_svg
from saf_gen.leaderboard.figures._figure import (
    PDF_CREATOR,
    PREDICTIONS_LABEL,
    add_paper_background,
    split_method_label,
    to_pdf,
)
from saf_gen.leaderboard.figures.condition_figure import CONDITIONS, Condition, plot_condition
from saf_gen.leaderboard.figures.depth_of_focus_figure import plot_depth_of_focus
from saf_gen.leaderboard.figures.error_figure import plot_errors
from saf_gen.leaderboard.figures.focus_curve_figure import (
    Cursor,
    locate_figure_cursor,
    normalise_curve_of_figure,
    plot_focus_curves,
)
from saf_gen.leaderboard.figures.image_strip import ImageStrip, build_image_strip, build_spike_strip
from saf_gen.leaderboard.figures.path_figures import plot_lens_paths, plot_search_steps

__all__ = [
    "CONDITIONS",
    "MAX_MEASURES",
    "PDF_CREATOR",
    "PREDICTIONS_LABEL",
    "Condition",
    "Cursor",
    "Figure",
    "ImageStrip",
    "PlotStyle",
    "add_paper_background",
    "assign_styles",
    "build_image_strip",
    "build_spike_strip",
    "inline_svg",
    "locate_figure_cursor",
    "normalise_curve_of_figure",
    "plot_condition",
    "plot_depth_of_focus",
    "plot_errors",
    "plot_focus_curves",
    "plot_lens_paths",
    "plot_search_steps",
    "split_method_label",
    "to_pdf",
    "to_svg",
]
