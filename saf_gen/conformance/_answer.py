"""What an answer must look like."""

from typing import Any

from saf_gen.conformance._finding import Fault
from saf_gen.contest.answer import wrong_with
from saf_gen.parts import Answer

__all__ = ["check_answer", "check_frame"]


def check_answer(answer: Any, *, commanding: bool) -> Answer:
    """The answer, if the contest can judge it (:func:`wrong_with`); else raises Fault."""
    if wrong := wrong_with(answer, commanding=commanding):
        raise Fault(*wrong)
    return answer


def check_frame(answer: object, frames: int, name: str) -> Answer:
    """The answer of a search that estimates, if its frame is one of ``frames``; else raises Fault."""
    found = check_answer(answer, commanding=False)
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise Fault(
            f"it answers frame {found.frame:g} of {frames:,}, on {name}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found
