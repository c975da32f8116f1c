"""Submissions: folders with a method or its answers, an evaluation of it, and the statements of its authors."""

from saf_gen.leaderboard.submission.card import SubmissionCard, create_submission
from saf_gen.leaderboard.submission.checks import SubmissionFinding, check_submission

__all__ = ["SubmissionCard", "SubmissionFinding", "check_submission", "create_submission"]
