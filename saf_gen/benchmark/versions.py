"""Version numbers of all parts of the evaluator that, in addition to the method, determine the numbers in a record.

Increase a version whenever the same stream and the same method would give a different record; pinned numbers in
tests/benchmark/test_versions.py show when this is needed. Records of different versions never share a leaderboard.
"""

COUNTS_VERSION = 1
"""Version of what a method sees of a recording: counts of windows and of their halves, and the interval texture."""

CAPTURE_VERSION = 1
"""Version of the running camera of the closed loop: lens, budget, captured frames, and what a policy observes."""

JUDGEMENT_VERSION = 2
"""Version of the judgement of an answer: truth, error, blur, success and time to focus."""


def evaluator_version(track: str) -> str:
    """Return the versions that determine the records of a track (``recorded`` or ``closed_loop``), on one line."""
    capture = f", capture {CAPTURE_VERSION}" if track == "closed_loop" else ""
    return f"counts {COUNTS_VERSION}{capture}, judgement {JUDGEMENT_VERSION}"
