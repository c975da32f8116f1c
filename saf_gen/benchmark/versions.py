"""Version numbers of everything beside the method that decides the numbers of a record.

Raise a version whenever the same stream and the same method would give another record; pinned numbers in
tests/benchmark/test_versions.py show when. Records of different versions do not mix in one leaderboard.
"""

COUNTS_VERSION = 1
"""What a method sees of a recording: counts of windows and of their halves, and interval texture."""

CAPTURE_VERSION = 1
"""The running camera of the closed loop: lens, budget, captured frames, and what a policy observes."""

JUDGEMENT_VERSION = 1
"""How an answer is judged: truth, error, blur, success, time to focus."""


def evaluator_version(track: str) -> str:
    """Return the versions that decide the records of a track (``recorded`` or ``closed_loop``), in one line."""
    capture = f", capture {CAPTURE_VERSION}" if track == "closed_loop" else ""
    return f"counts {COUNTS_VERSION}{capture}, judgement {JUDGEMENT_VERSION}"
