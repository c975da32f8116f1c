"""Run a search and return its answer, or the reason why it failed; other methods are not affected by a failure."""

import math
from numbers import Real
from typing import Any

from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer, RestrictedView
from saf_gen.core.stopwatch import Stopwatch
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.parts import Answer, Search, View, commands

MAX_REASON_CHARACTERS = 300
"""Maximum length of a reason, which is shown in a table."""
MAX_TRACE, MAX_NOTE_CHARACTERS = 100_000, 1_000
"""Maximum lengths of the trace and of the note of an answer."""


def run_search(search: Search, view: View, *, scorer: MeteredScorer, stream_path: str = "") -> tuple[Answer, str]:
    """Return the answer of a search and '', or an empty answer and one line that says why the search failed.

    An answer that rests on scores which are all equal is a guess that happens to be somewhere: it counts as none.
    The search has access only to the members of :class:`saf_gen.parts.View`. Its computing time outside the view is
    added to ``scorer``, however it ends.

    Raises
    ------
    BudgetSpentError
        If the search asks for more frames than its budget has left.
    BadInput
        If the error concerns the file ``stream_path`` and is therefore not the method's fault.
    """
    total_time, view_time = Stopwatch(), Stopwatch()
    try:
        with user_code():
            answer = total_time.time(search, RestrictedView(view, view_time))
            if fault := answer_fault(answer, commanding=commands(search)):
                return Answer(), to_one_line("; ".join(fault))
            return withhold(to_plain_numbers(answer), scorer.blindness), ""
    except BudgetSpentError:
        raise
    except Exception as error:  # third-party searches and measures may raise anything
        if stream_path and isinstance(error, BadInput) and error.where == stream_path:
            raise
        return Answer(), describe_exception(error)
    finally:  # with threads, the times inside the view may add up to more than the total
        scorer.add_seconds(max(total_time.seconds - view_time.seconds, 0.0))


def withhold(answer: Answer, reason: str) -> Answer:
    """Return the answer, or, if there is a reason not to count it, an abstention with that reason as its note."""
    if not reason or (answer.frame is None and answer.position is None):
        return answer
    return Answer(None, answer.trace, f"no answer: {reason}")


def describe_exception(error: Exception) -> str:
    """Return the type and the message of an exception, on one line."""
    try:
        message = str(error)
    except Exception:  # noqa: BLE001 a third-party exception may fail to give its message
        message = ""
    return to_one_line(f"{type(error).__name__}: {message}" if message else type(error).__name__)


def answer_fault(answer: Any, *, commanding: bool) -> tuple[str, str] | None:
    """Return the fault of an answer and its correction, or None if the answer can be judged.

    A valid answer is an Answer with a finite trace and a note of at most one line. A search that commands the lens
    gives a finite position and no frame; a search that estimates gives a finite frame and no position. An answer with
    neither is an abstention.
    """
    if not isinstance(answer, Answer):
        return (
            f"it answers with {type(answer).__name__} {answer!r}",
            "return saf_gen.parts.Answer(frame), or Answer(position=...) if it commands the lens",
        )
    if isinstance(answer.trace, tuple) and len(answer.trace) > MAX_TRACE:
        return f"its trace has {len(answer.trace):,} entries", f"give at most {MAX_TRACE:,}"
    if not (isinstance(answer.trace, tuple) and all(_is_finite_number(x) for x in answer.trace)):
        return (
            f"its trace is no flat tuple of finite numbers: {repr(answer.trace)[:80]}",
            "give the positions, for example",
        )
    note = answer.note
    if isinstance(note, str) and len(note) > MAX_NOTE_CHARACTERS:
        return f"its note has {len(note):,} characters", f"give one line of at most {MAX_NOTE_CHARACTERS:,}"
    if not isinstance(note, str) or len(note.splitlines()) > 1 or note != note.encode("utf-8", "ignore").decode():
        return f"its note is {note!r}", "give one line of text"
    for name in ("frame", "position"):
        value = getattr(answer, name)
        if not (value is None or _is_finite_number(value)):
            return f"it answers {name} {value!r}", "give a finite number, or None to abstain"
    if commanding and answer.frame is not None:
        return "it answers with a frame, but commands the lens", "answer with Answer(position=...)"
    if not commanding and answer.position is not None:
        return (
            "it answers with a position, but does not command the lens",
            "answer with a frame, or state commands: ClassVar[bool] = True",
        )
    return None


def to_plain_numbers(answer: Answer) -> Answer:
    """Return the answer with all its numbers as floats."""
    frame, position = (None if x is None else float(x) for x in (answer.frame, answer.position))
    return Answer(frame, tuple(float(x) for x in answer.trace), answer.note, position)


def to_one_line(text: str) -> str:
    """Return a reason on one line of at most MAX_REASON_CHARACTERS."""
    # Lone surrogates, as in file names that are not UTF-8, cannot be written, so they are escaped.
    text = " ".join(text.encode("utf-8", "backslashreplace").decode("utf-8").split())
    return text if len(text) <= MAX_REASON_CHARACTERS else f"{text[: MAX_REASON_CHARACTERS - 1]}…"


def _is_finite_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
