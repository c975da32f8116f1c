"""What an answer must look like."""

from typing import Any

from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.benchmark.tracks.search_run import find_answer_fault
from saf_gen.parts import Answer

__all__ = ["check_answer", "check_frame"]


def check_answer(answer: Any, *, commanding: bool) -> Answer:
    """The answer, if the contest can judge it (:func:`find_answer_fault`); else raises CheckFailure."""
    if wrong := find_answer_fault(answer, commanding=commanding):
        raise CheckFailure(*wrong)
    return answer


def check_frame(answer: object, frames: int, name: str) -> Answer:
    """The answer of a search that estimates, if its frame is one of ``frames``; else raises CheckFailure."""
    found = check_answer(answer, commanding=False)
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise CheckFailure(
            f"it answers frame {found.frame:g} of {frames:,}, on {name}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found
