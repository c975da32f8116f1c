"""The result of a check, and the exceptions by which a check reports a fault."""

from dataclasses import dataclass
from typing import Literal

from saf_gen.core.user_code import PassesUserCode


@dataclass(frozen=True)
class CheckResult:
    """The result of one check.

    Attributes
    ----------
    part : str
        ``measure``, ``search`` or ``method``.
    check : str
        Name of the check.
    level : str
        ``pass``; ``warn`` if the part can be ranked but behaves unexpectedly; or ``fail`` if the benchmark would refuse
        it or its results would be meaningless.
    seen : str
        The observation of the check, on one line.
    to_do : str
        How to correct the fault, on one line; '' if there is no fault.
    """

    part: str
    check: str
    level: Literal["pass", "warn", "fail"]
    seen: str
    to_do: str = ""


class CheckFailure(PassesUserCode):
    """Error that a failing check raises, with its observation and the correction of the fault.

    It is a BaseException, so that no ``except Exception`` in a plug-in or in the benchmark catches it.
    """

    level: Literal["warn", "fail"] = "fail"

    def __init__(self, seen: str, to_do: str) -> None:
        super().__init__(seen)
        self.seen, self.to_do = seen, to_do


class CheckWarning(CheckFailure):
    """Error that a check raises if a warning is enough."""

    level = "warn"
