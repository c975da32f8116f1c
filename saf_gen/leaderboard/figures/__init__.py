"""Figures of an evaluation: focus curves, errors, success by condition, and paths of searches and of the lens."""

from matplotlib.figure import Figure

from saf_gen.core.figure_style import MAX_MEASURES, PlotStyle, assign_styles, inline_svg, plot_to_svg
from saf_gen.leaderboard.figures._figure import (
    PDF_CREATOR,
    PREDICTIONS_LABEL,
    add_paper_to_figure,
    figure_to_pdf,
    split_figure_label,
)
from saf_gen.leaderboard.figures.comparison_figures import plot_neighbour_figure, plot_profile_figure
from saf_gen.leaderboard.figures.condition_figure import CONDITIONS, Condition, plot_condition_figure
from saf_gen.leaderboard.figures.depth_of_focus_figure import plot_depth_of_focus_figure
from saf_gen.leaderboard.figures.error_figure import plot_error_figure
from saf_gen.leaderboard.figures.focus_curve_figure import (
    Cursor,
    locate_figure_cursor,
    normalise_figure_curve,
    plot_focus_curve_figure,
)
from saf_gen.leaderboard.figures.path_figures import plot_lens_path_figure, plot_search_step_figure
from saf_gen.leaderboard.figures.sweep_strip import ImageStrip, build_figure_image_strip, build_figure_spike_strip

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
    "add_paper_to_figure",
    "assign_styles",
    "build_figure_image_strip",
    "build_figure_spike_strip",
    "figure_to_pdf",
    "inline_svg",
    "locate_figure_cursor",
    "normalise_figure_curve",
    "plot_condition_figure",
    "plot_depth_of_focus_figure",
    "plot_error_figure",
    "plot_focus_curve_figure",
    "plot_lens_path_figure",
    "plot_neighbour_figure",
    "plot_profile_figure",
    "plot_search_step_figure",
    "plot_to_svg",
    "split_figure_label",
]
