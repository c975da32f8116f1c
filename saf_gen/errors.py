"""What a user sees when something is wrong: one line, and an exit code.

Every error that a user can cause is a :class:`BadInput`; the command line prints its one line and exits
with 2. A traceback in front of a user is therefore always a bug of ours.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches

__all__ = ["BadInput", "SafGenError", "closest", "located", "unknown"]


class SafGenError(Exception):
    """Anything that saf_gen reports by itself; ``exit_code`` is what the process ends with."""

    exit_code = 1


class BadInput(SafGenError):
    """Input that cannot be used, told in one line: the value, what is allowed, the nearest, the next step.

    Parameters
    ----------
    problem : what is wrong, with the value in it.
    where : file, or file and line, or option that holds the value.
    allowed : what would have been right, in words.
    nearest : the likeliest intended value.
    hint : the next step.
    """

    exit_code = 2

    def __init__(
        self, problem: str, *, where: str = "", allowed: str = "", nearest: str = "", hint: str = ""
    ) -> None:
        parts = [f"{where}: {problem}" if where else problem]
        if allowed:
            parts.append(f"allowed: {allowed}")
        if nearest:
            parts.append(f"did you mean {nearest!r}?")
        if hint:
            parts.append(hint)
        super().__init__(" ".join("; ".join(parts).split()))  # one line, whatever was passed in
        self.problem, self.where, self.allowed = problem, where, allowed
        self.nearest, self.hint = nearest, hint

    def __reduce__(self):
        # Exceptions with keyword arguments do not cross process borders by themselves.
        return _rebuild, (self.problem, self.where, self.allowed, self.nearest, self.hint)


def _rebuild(problem: str, where: str, allowed: str, nearest: str, hint: str) -> BadInput:
    return BadInput(problem, where=where, allowed=allowed, nearest=nearest, hint=hint)


def closest(value: object, allowed: Iterable[str]) -> str:
    """The allowed name most like ``value``, or '' when none is near."""
    found = get_close_matches(str(value), list(allowed), n=1, cutoff=0.5)
    return found[0] if found else ""


def unknown(what: str, value: object, allowed: Iterable[str], *, where: str = "", hint: str = "") -> BadInput:
    """The error for a name that is not among those allowed."""
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
    """Put ``where`` (a file, or file:line) and ``prefix`` before a BadInput that the block raises."""
    try:
        yield
    except BadInput as error:
        inner = f"{error.where}: {error.problem}" if error.where else error.problem
        raise BadInput(
            f"{prefix}{inner}", where=where, allowed=error.allowed, nearest=error.nearest, hint=error.hint
        ) from error
