"""Ranking of methods from their records, tables by condition, and the files that hold them.

Methods are ranked by answers within one depth of focus, over the sequences that have an
answer. Success and cost are averaged over the light schedules of each
scene, then over scenes, so that a scene with many sequences weighs no more than another; errors are medians over all
sequences. Methods with equal success share a rank. Confidence intervals show which methods can be told apart on the
given scenes.
"""

from saf_gen.leaderboard.board import Leaderboard, evaluate, read_leaderboard
from saf_gen.leaderboard.ranking import LeaderboardRow, rank_methods

__all__ = ["Leaderboard", "LeaderboardRow", "evaluate", "rank_methods", "read_leaderboard"]
