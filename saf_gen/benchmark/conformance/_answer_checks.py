"""Checks of a search's answers."""

from typing import Any

from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.benchmark.tracks.search_run import find_method_answer_fault
from saf_gen.parts import Answer

STATE_HINT = "draw nothing by chance, and keep nothing between calls"
UNIT_HINT = "the unit of the scores must not matter: compare them with each other, never with a number"


def check_method_answer(answer: Any, *, commanding: bool) -> Answer:
    """Return the answer if the benchmark can judge it, see find_method_answer_fault; else raise CheckFailure."""
    if fault := find_method_answer_fault(answer, commanding=commanding):
        raise CheckFailure(*fault)
    return answer


def check_method_answer_frame(answer: object, frames: int, *, recording: str) -> Answer:
    """Return an estimating search's answer if it lies in the recording; else raise CheckFailure."""
    found = check_method_answer(answer, commanding=False)
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise CheckFailure(
            f"it answers frame {found.frame:g} of {frames:,}, on {recording}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found


def check_same_method_answers(first: object, again: object, *, cause: str, hint: str = STATE_HINT) -> None:
    """Raise CheckFailure unless two answers are equal; ``cause`` says what changed between them."""
    if first != again:
        raise CheckFailure(f"{cause}: {again}, not {first}", hint)
