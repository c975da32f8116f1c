"""Errors for users, each with a message of one line and an exit code.

Every error that a user can cause is a :class:`BadInput`. The command line prints its message and exits with
code 2, so any traceback that a user sees is a bug in saf_gen.
"""

import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from functools import partial
from typing import Any

MAX_NAMES = 8
"""Largest number of allowed names in an error message."""
MAX_PIECE = 1_000
"""Maximum length of each part of an error message, in characters; a name in an untrusted file may have millions."""


def escape_controls(text: str, *, keep: str = "", write: Callable[[str], str] = repr) -> str:
    """Return ``text`` with escapes in place of characters that control a terminal or reorder letters.

    Names and provenance from untrusted files may contain such characters.

    Parameters
    ----------
    text : str
        Text to escape.
    keep : str, optional
        Characters to leave as they are, such as line breaks.
    write : callable, default repr
        Function that returns the escape of one character, in quotes.

    Returns
    -------
    str
        The escaped text.
    """
    if text.isprintable():
        return text
    return "".join(write(c)[1:-1] if unicodedata.category(c) in _STEERING and c not in keep else c for c in text)


_STEERING = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that are escaped: controls, format characters (such as right-to-left marks), surrogates, and
line and paragraph separators."""


class SafGenError(Exception):
    """Base class of the errors that saf_gen reports itself; the process ends with its ``exit_code``."""

    exit_code = 1


class BadInput(SafGenError):
    """Input that cannot be used.

    Its message is one line: the location, the problem, the allowed values, the nearest of them, and the next step.

    Parameters
    ----------
    problem : str
        Problem, including the unusable value.
    where : str, optional
        File, ``file:line`` or option that holds the value.
    allowed : str, optional
        Allowed values, in words.
    nearest : str, optional
        Value that the user most likely intended.
    hint : str, optional
        Next step for the user.

    Attributes
    ----------
    problem, where, allowed, nearest, hint : str
        Values of the parameters; '' if not given.
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
        # By default only the positional arguments of an exception are pickled.
        keywords = {key: getattr(self, key) for key in ("where", "allowed", "nearest", "hint")}
        return partial(type(self), self.problem, **keywords), ()


def closest(value: object, allowed: Iterable[str]) -> str:
    """Return the allowed name that is most similar to ``value``, or '' if none is similar.

    Parameters
    ----------
    value : object
        Value that the user wrote, compared as text regardless of case.
    allowed : iterable of str
        Names to choose from.

    Returns
    -------
    str
        One of ``allowed``, or ''.
    """
    by_letters = {name.casefold(): name for name in allowed}
    found = get_close_matches(str(value).casefold(), by_letters, n=1, cutoff=0.5)
    return by_letters[found[0]] if found else ""


def unknown(what: str, value: object, *, allowed: Iterable[str], where: str = "", hint: str = "") -> BadInput:
    """Return the error for a name that is not allowed.

    Parameters
    ----------
    what : str
        Kind of the name, such as "sensor".
    value : object
        The name as the user wrote it.
    allowed : iterable of str
        The allowed names; the nearest one is suggested.
    where, hint : str, optional
        See :class:`BadInput`.

    Returns
    -------
    BadInput
        The error, to be raised by the caller.
    """
    names = sorted(allowed)
    return BadInput(
        f"unknown {what} {str(value)!r}",
        where=where,
        allowed=some_of(names, value) or "nothing is registered",
        nearest=closest(value, names),
        hint=hint,
    )


def some_of(names: Iterable[str], value: object = "") -> str:
    """Return at most MAX_NAMES of the allowed names as text, those most similar to a value, and how many are left."""
    every = list(names)
    if len(every) <= MAX_NAMES:
        return ", ".join(every)
    near = get_close_matches(str(value), every, n=MAX_NAMES, cutoff=0)
    shown = [name for name in every if name in near]
    return f"{', '.join(shown)} and {len(every) - len(shown)} more"


@contextmanager
def located(where: str, *, prefix: str = "") -> Iterator[None]:
    """Add a location to every BadInput that is raised inside the ``with`` block.

    Parameters
    ----------
    where : str
        File or ``file:line`` to put before the error.
    prefix : str, optional
        Words to put before the problem.

    Raises
    ------
    BadInput
        If the block raises one; ``where`` and ``prefix`` are added to it.
    """
    try:
        yield
    except BadInput as error:
        inner = f"{error.where}: {error.problem}" if error.where else error.problem
        raise BadInput(
            f"{prefix}{inner}", where=where, allowed=error.allowed, nearest=error.nearest, hint=error.hint
        ) from error
