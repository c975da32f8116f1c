"""The tables that the files and the page of a leaderboard have in common, computed once for both."""

from collections.abc import Sequence
from dataclasses import dataclass

from saf_gen.benchmark.records import Record
from saf_gen.leaderboard.axes import AxisTable, tabulate_leaderboard_by_axis
from saf_gen.leaderboard.method_comparison import MethodComparison, compare_ranked_methods
from saf_gen.leaderboard.rank_agreement import RankAgreement, compare_rankings
from saf_gen.leaderboard.rows import LeaderboardRow


@dataclass(frozen=True)
class LeaderboardTables:
    """Tables of a leaderboard in addition to its rows.

    Attributes
    ----------
    axes : tuple of AxisTable
        Results by condition.
    agreement : tuple of RankAgreement
        Agreement of the rankings under the bins of each condition.
    comparison : MethodComparison
        Profiles of the methods, and comparisons of neighbours in rank.
    """

    axes: tuple[AxisTable, ...]
    agreement: tuple[RankAgreement, ...]
    comparison: MethodComparison


def compute_leaderboard_tables(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> LeaderboardTables:
    """Return the tables of a leaderboard whose ``rows`` were computed from ``records``."""
    methods = [row.method for row in rows]
    return LeaderboardTables(
        tabulate_leaderboard_by_axis(records, methods),
        tuple(compare_rankings(records)),
        compare_ranked_methods(records, methods),
    )
