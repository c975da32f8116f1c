"""Errors that a user sees: one line and an exit code.

Every error that a user can cause is a :class:`BadInput`. The command line prints its line and exits with 2,
so a traceback in front of a user is a bug of saf_gen.
"""

import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
from typing import Any

MAX_PIECE = 1_000
"""Characters of a part of an error's line: a name in a stranger's file may have millions."""


def escape_controls(text: str, *, keep: str = "", write: Callable[[str], str] = repr) -> str:
    """Return a text with every character that steers a terminal, or the order of its letters, written as an escape.

    Names and provenance of strangers may hold them. Those in ``keep`` stay, such as line breaks; ``write`` gives the
    escape of a character in quotes.
    """
    if text.isprintable():
        return text
    return "".join(write(c)[1:-1] if unicodedata.category(c) in _STEERING and c not in keep else c for c in text)


_STEERING = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode's categories of controls, formats (such as right-to-left), halves of letters, and breaks of lines."""


class SafGenError(Exception):
    """Base class of the errors that saf_gen reports itself; the process ends with its ``exit_code``."""

    exit_code = 1


class BadInput(SafGenError):
    """Input that cannot be used.

    Its text is one line: where, problem, what is allowed, the nearest value, and the next step.

    Parameters
    ----------
    problem : str
        What is wrong, with the value in it.
    where : str
        The file, ``file:line``, or option that holds the value.
    allowed : str
        What would have been right, in words.
    nearest : str
        The likeliest intended value.
    hint : str
        The next step.

    Attributes
    ----------
    problem, where, allowed, nearest, hint : str
        The parameters; '' where not given.
    """

    exit_code = 2

    def __init__(self, problem: str, *, where: str = "", allowed: str = "", nearest: str = "", hint: str = "") -> None:
        pieces = [f"{where}: {problem}" if where else problem]
        if allowed:
            pieces.append(f"allowed: {allowed}")
        if nearest:
            pieces.append(f"did you mean {nearest!r}?")
        if hint:
            pieces.append(hint)
        line = "; ".join(piece if len(piece) <= MAX_PIECE else f"{piece[:MAX_PIECE]}…" for piece in pieces)
        super().__init__(escape_controls(" ".join(line.split())))  # one line, whatever the arguments hold
        self.problem, self.where, self.allowed = problem, where, allowed
        self.nearest, self.hint = nearest, hint

    def __reduce__(self) -> tuple[Any, ...]:
        # By default an exception is pickled by its positional arguments alone.
        keywords = {key: getattr(self, key) for key in ("where", "allowed", "nearest", "hint")}
        return partial(type(self), self.problem, **keywords), ()


def closest(value: object, allowed: Iterable[str]) -> str:
    """Return the allowed name most like ``value``, or '' where none is near.

    Parameters
    ----------
    value : object
        What was written; compared by its text, whatever the case of its letters.
    allowed : iterable of str
        The names to choose among.
    """
    by_letters = {name.casefold(): name for name in allowed}
    found = get_close_matches(str(value).casefold(), by_letters, n=1, cutoff=0.5)
    return by_letters[found[0]] if found else ""


def unknown(what: str, value: object, *, allowed: Iterable[str], where: str = "", hint: str = "") -> BadInput:
    """Return the error for a name that is not among those allowed.

    Parameters
    ----------
    what : str
        What the name stands for, such as "sensor".
    value : object
        The name as written.
    allowed : iterable of str
        The known names; the nearest one is suggested.
    where, hint : str
        As in :class:`BadInput`.
    """
    names = sorted(allowed)
    return BadInput(
        f"unknown {what} {str(value)!r}",
        where=where,
        allowed=", ".join(names) or "none is registered",
        nearest=closest(value, names),
        hint=hint,
    )


@contextmanager
def located(where: str, *, prefix: str = "") -> Iterator[None]:
    """Return a context that adds a location to every BadInput raised in it.

    Parameters
    ----------
    where : str
        The file or ``file:line`` to put before the error.
    prefix : str
        Words to put before its problem.

    Raises
    ------
    BadInput : the same error, with ``where`` and ``prefix`` added.
    """
    try:
        yield
    except BadInput as error:
        inner = f"{error.where}: {error.problem}" if error.where else error.problem
        raise BadInput(
            f"{prefix}{inner}", where=where, allowed=error.allowed, nearest=error.nearest, hint=error.hint
        ) from error
