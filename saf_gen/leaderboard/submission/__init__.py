"""A submission: a folder with a method or its answers, what was found with it, and what its author states."""

from saf_gen.leaderboard.submission.card import SubmissionCard, create_submission
from saf_gen.leaderboard.submission.checks import SubmissionFinding, check_submission
from saf_gen.leaderboard.submission.listing import ListedSubmission, SubmissionList, SubmissionTable, list_submissions

__all__ = [
    "ListedSubmission",
    "SubmissionCard",
    "SubmissionFinding",
    "SubmissionList",
    "SubmissionTable",
    "check_submission",
    "create_submission",
    "list_submissions",
]
