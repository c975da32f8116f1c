"""The report of an evaluation: an HTML page, and the folder that holds all files."""

from saf_gen.leaderboard.report.evaluation_folder import WrittenEvaluation, check_replaceable, write_evaluation

__all__ = ["WrittenEvaluation", "check_replaceable", "write_evaluation"]
