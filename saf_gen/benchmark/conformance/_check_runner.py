"""Runs checks of anybody's part: each ends in a finding, whatever the part does, and in time."""

import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckResult, CheckWarning

__all__ = ["Check", "CheckLimits", "LimitExceededError", "describe_crash", "run_checks"]

Check = Callable[[], str]
"""Gives what was seen where all is well, and raises CheckFailure or CheckWarning where it is not."""

PACKAGE = Path(__file__).parents[2]
PLUGIN_FOLDERS = (PACKAGE / "measures", PACKAGE / "searches")
NUMPY = Path(np.__file__).parent
PYTHON = Path(traceback.__file__).parent


@dataclass(frozen=True)
class CheckLimits:
    """Where a part that does not end is stopped: scores asked of one view, seconds of one check.

    The clock stops Python code of the main thread, where the system has interval timers.
    """

    scores: int = 1_000_000
    seconds: float = 30.0


class LimitExceededError(BaseException):
    """A part went over its limits. No Exception, so that no ``except Exception`` of the part keeps it."""


def run_checks(part: str, checks: Mapping[str, Check], limits: CheckLimits) -> Iterator[CheckResult]:
    """The findings of these checks, one after the other; none after a part that had to be stopped."""
    for name, check in checks.items():
        stopped = False
        try:
            finding = CheckResult(part, name, "pass", _within(check, limits))
        except CheckFailure as fault:
            finding = CheckResult(part, name, fault.level, fault.seen, fault.to_do)
        except LimitExceededError as late:
            stopped, seen = True, f"{late}; the rest of the checks was left out"
            finding = CheckResult(part, name, "fail", seen, "let its loops end whatever the scores are")
        except (Exception, SystemExit) as error:  # noqa: BLE001 anybody's part may raise anything: it is told
            finding = CheckResult(
                part, name, "fail", describe_crash(error), "no input of a contest may raise this: catch it"
            )
        yield finding
        if stopped:
            return


def describe_crash(error: BaseException) -> str:
    """An exception in one line, with the place in the part's own file."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _of_a_part(Path(frame.filename))]
    place = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    return " ".join(f"{type(error).__name__}: {error}{place}".split())


def _of_a_part(file: Path) -> bool:
    ours = PACKAGE in file.parents and not any(room in file.parents for room in PLUGIN_FOLDERS)
    python = PYTHON in file.parents and "site-packages" not in file.parts
    return not (ours or python or NUMPY in file.parents)


def _within(check: Check, limits: CheckLimits) -> str:
    """What the check has seen. Python's warnings in it are a doubt: they would fill a contest's screen."""
    with warnings.catch_warnings(record=True) as told, _clock(limits.seconds):
        warnings.simplefilter("always")
        seen = check()
    if told:
        words = f"{told[0].category.__name__}: {told[0].message}"
        raise CheckWarning(words, "treat the case that it warns of by itself")
    return seen


@contextmanager
def _clock(seconds: float) -> Iterator[None]:
    """Raises LimitExceededError in what runs here after so many seconds."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: FrameType | None) -> Any:
        raise LimitExceededError(f"did not end within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
