"""What an answer must look like."""

import math
from numbers import Real

from saf_gen.conformance._finding import Fault
from saf_gen.parts import Answer

__all__ = ["check_answer", "check_frame"]


def check_answer(answer: object) -> Answer:
    """The answer, if it is an Answer with a finite trace and a note of one line; else raises Fault."""
    if not isinstance(answer, Answer):
        raise Fault(
            f"it answers with {type(answer).__name__} {answer!r}",
            "return saf_gen.parts.Answer(frame), or Answer(position=...) if it commands the lens",
        )
    if not (isinstance(answer.trace, tuple) and all(_finite(x) for x in answer.trace)):
        raise Fault(f"its trace is {answer.trace!r}", "give a tuple of finite numbers")
    if not isinstance(answer.note, str) or len(answer.note.splitlines()) > 1:
        raise Fault(f"its note is {answer.note!r}", "give one line of text")
    for name in ("frame", "position"):
        value = getattr(answer, name)
        if not (value is None or _finite(value)):
            raise Fault(f"it answers {name} {value!r}", "give a finite number, or None to abstain")
    return answer


def check_frame(answer: object, frames: int, name: str) -> Answer:
    """The answer of a search that estimates, if its frame is one of ``frames``; else raises Fault."""
    found = check_answer(answer)
    if found.position is not None:
        raise Fault(
            "it answers with a place, and does not command the lens",
            "answer with a frame, or state commands: ClassVar[bool] = True",
        )
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise Fault(
            f"it answers frame {found.frame:g} of {frames:,}, on {name}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found


def _finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
