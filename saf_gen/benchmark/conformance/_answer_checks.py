"""Checks of a search's answers."""

from typing import Any

from saf_gen.benchmark.conformance._check_result import CheckFailure
from saf_gen.benchmark.tracks.search_run import answer_fault
from saf_gen.parts import Answer

STATE_HINT = "use no random numbers, and keep no state between calls"
UNIT_HINT = "the unit of the scores must not matter: compare scores with each other, never with a constant"


def check_answer(answer: Any, *, commanding: bool) -> Answer:
    """Return the answer if answer_fault finds no fault; otherwise raise CheckFailure."""
    if fault := answer_fault(answer, commanding=commanding):
        raise CheckFailure(*fault)
    return answer


def check_answer_frame(answer: object, frames: int, *, recording: str) -> Answer:
    """Return an estimating search's answer if its frame is in the recording or is None; else raise CheckFailure."""
    found = check_answer(answer, commanding=False)
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise CheckFailure(
            f"it answers frame {found.frame:g} of {frames:,}, on {recording}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found


def check_same_answers(first: object, again: object, *, cause: str, hint: str = STATE_HINT) -> None:
    """Raise CheckFailure if two answers differ; ``cause`` describes the difference between the two runs."""
    if first != again:
        raise CheckFailure(f"{cause}: {again}, not {first}", hint)
