"""Ranking of methods from their records, tables by condition, and the files that hold them.

Methods are ranked by success within one depth of focus. Success and cost are averaged over the light schedules of each
scene, then over scenes, so that a scene with many sequences weighs no more than another; errors are medians over all
sequences. Methods with equal success share a rank. Confidence intervals show which methods can be told apart on the
given scenes.
"""

from saf_gen.leaderboard.axes import (
    AXES,
    Axis,
    AxisTable,
    group_by_leaderboard_bin,
    keep_leaderboard_bins,
    list_leaderboard_bins,
    tabulate_leaderboard_by_axis,
)
from saf_gen.leaderboard.columns import Column, list_leaderboard_columns, list_shown_leaderboard_columns
from saf_gen.leaderboard.curve_tables import rank_measures_by_curves, write_leaderboard_curves
from saf_gen.leaderboard.leaderboard_files import write_leaderboard
from saf_gen.leaderboard.merging import merge_leaderboard_records
from saf_gen.leaderboard.method_comparison import MethodComparison, NeighbourComparison, Profile, compare_ranked_methods
from saf_gen.leaderboard.rank_agreement import AGREEMENT_MEANINGS, RankAgreement, compare_rankings
from saf_gen.leaderboard.reading import Leaderboard, read_leaderboard
from saf_gen.leaderboard.rows import LeaderboardRow, rank_methods
from saf_gen.leaderboard.table_formats import (
    compose_leaderboard_notes,
    format_leaderboard_latex,
    format_leaderboard_markdown,
)

__all__ = [
    "AGREEMENT_MEANINGS",
    "AXES",
    "Axis",
    "AxisTable",
    "Column",
    "Leaderboard",
    "LeaderboardRow",
    "MethodComparison",
    "NeighbourComparison",
    "Profile",
    "RankAgreement",
    "compare_ranked_methods",
    "compare_rankings",
    "compose_leaderboard_notes",
    "format_leaderboard_latex",
    "format_leaderboard_markdown",
    "group_by_leaderboard_bin",
    "keep_leaderboard_bins",
    "list_leaderboard_bins",
    "list_leaderboard_columns",
    "list_shown_leaderboard_columns",
    "merge_leaderboard_records",
    "rank_measures_by_curves",
    "rank_methods",
    "read_leaderboard",
    "tabulate_leaderboard_by_axis",
    "write_leaderboard",
    "write_leaderboard_curves",
]
