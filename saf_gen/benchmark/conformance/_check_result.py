"""What a check of a part has found, and how a check says so."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["CheckFailure", "CheckResult", "CheckWarning"]


@dataclass(frozen=True)
class CheckResult:
    """One line of one check: what was seen, and what to do where something is wrong.

    ``part`` is what was looked at: ``measure``, ``search`` or ``method``. ``level``: ``pass``; ``warn``, it
    can be ranked, but is not as one would expect; ``fail``, the contest would refuse it, or its figures be
    worth nothing.
    """

    part: str
    check: str
    level: Literal["pass", "warn", "fail"]
    seen: str
    to_do: str = ""


class CheckFailure(BaseException):
    """Raised by a check that fails: what was seen, and what to do.

    No Exception, so that no ``except Exception`` of a part or of the contest between them keeps it.
    """

    level: Literal["warn", "fail"] = "fail"

    def __init__(self, seen: str, to_do: str) -> None:
        super().__init__(seen)
        self.seen, self.to_do = seen, to_do


class CheckWarning(CheckFailure):
    """Raised by a check that warns."""

    level = "warn"
