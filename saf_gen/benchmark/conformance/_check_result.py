"""The result of a check, and the exceptions by which a check reports a fault."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class CheckResult:
    """What one check saw, and what to do where something is wrong; one line each.

    ``part`` is ``measure``, ``search`` or ``method``. ``level`` is ``pass``; ``warn``, where it can be ranked but
    behaves in a way that users would not expect; or ``fail``, where the benchmark would refuse it or its figures would
    be meaningless.
    """

    part: str
    check: str
    level: Literal["pass", "warn", "fail"]
    seen: str
    to_do: str = ""


class CheckFailure(BaseException):
    """Raised by a check that fails, with what was seen and what to do.

    A BaseException, so that no ``except Exception`` of a plug-in or of the benchmark catches it.
    """

    level: Literal["warn", "fail"] = "fail"

    def __init__(self, seen: str, to_do: str) -> None:
        super().__init__(seen)
        self.seen, self.to_do = seen, to_do


class CheckWarning(CheckFailure):
    """Raised by a check that warns."""

    level = "warn"
