"""What a search answers, or why it has no answer: whatever it does, the other methods go on."""

import math
from numbers import Real
from typing import Any

from saf_gen.benchmark.view.metered_scorer import MeteredScorer
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, RestrictedView
from saf_gen.benchmark.view.stopwatch import Stopwatch
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, Search, View, commands

__all__ = ["describe_exception", "find_answer_fault", "run_search"]

MAX_REASON_CHARACTERS = 300
"""Characters of a reason, which stands in a table."""


def run_search(search: Search, view: View, *, scorer: MeteredScorer, data: str = "") -> tuple[Answer, str]:
    """What a search answers, or an empty answer and why, in one line; it is handed the members of View alone.

    ``scorer``: that of the scores that the view gives; the search's own time is added to it, however it ends.
    ``data``: the file that is seen through the view. BadInput that names it is none of the method's faults,
    and passes; so do BudgetSpentError, and what is no Exception.
    """
    whole, within = Stopwatch(), Stopwatch()
    try:
        answer = whole.time(search, RestrictedView(view, within))
        if wrong := find_answer_fault(answer, commanding=commands(search)):
            return Answer(), _line("; ".join(wrong))
        return _plain(answer), ""
    except BudgetSpentError:
        raise
    except Exception as error:  # anybody's search and measure may raise anything
        if data and isinstance(error, BadInput) and error.where == data:
            raise
        return Answer(), describe_exception(error)
    finally:
        scorer.add_seconds(
            max(whole.seconds - within.seconds, 0.0)
        )  # two threads of a search may look at once


def describe_exception(error: Exception) -> str:
    """An exception in one line: its type, and its message."""
    try:
        message = str(error)
    except Exception:  # noqa: BLE001 somebody's exception may not even be told
        message = ""
    return _line(f"{type(error).__name__}: {message}" if message else type(error).__name__)


def find_answer_fault(answer: Any, *, commanding: bool) -> tuple[str, str] | None:
    """What is wrong with an answer, and what to do; None for one that can be judged.

    It is an Answer with a finite trace and a note of one line; a finite place, and no frame, of a search that
    commands the lens, and the other way round of one that estimates; or neither, which abstains.
    """
    if not isinstance(answer, Answer):
        return (
            f"it answers with {type(answer).__name__} {answer!r}",
            "return saf_gen.parts.Answer(frame), or Answer(position=...) if it commands the lens",
        )
    if not (isinstance(answer.trace, tuple) and all(_finite(x) for x in answer.trace)):
        return f"its trace is {answer.trace!r}", "give a tuple of finite numbers"
    if not isinstance(answer.note, str) or len(answer.note.splitlines()) > 1 or not _written(answer.note):
        return f"its note is {answer.note!r}", "give one line of text"
    for name in ("frame", "position"):
        value = getattr(answer, name)
        if not (value is None or _finite(value)):
            return f"it answers {name} {value!r}", "give a finite number, or None to abstain"
    if commanding and answer.frame is not None:
        return "it answers with a frame, and moved the lens meanwhile", "answer with Answer(position=...)"
    if not commanding and answer.position is not None:
        return (
            "it answers with a place, and does not command the lens",
            "answer with a frame, or state commands: ClassVar[bool] = True",
        )
    return None


def _plain(answer: Answer) -> Answer:
    """The same in plain numbers, whatever kinds of numbers the search counts in."""
    frame, position = (None if x is None else float(x) for x in (answer.frame, answer.position))
    return Answer(frame, tuple(float(x) for x in answer.trace), answer.note, position)


def _line(text: str) -> str:
    # Half characters, as in names of files that are no UTF-8, cannot be written; they are spelt out.
    text = " ".join(text.encode("utf-8", "backslashreplace").decode("utf-8").split())
    return text if len(text) <= MAX_REASON_CHARACTERS else f"{text[: MAX_REASON_CHARACTERS - 1]}…"


def _written(text: str) -> bool:
    """Whether all of it can be written as UTF-8."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
