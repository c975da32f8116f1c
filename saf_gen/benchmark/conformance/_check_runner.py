"""Runner for checks of third-party plug-ins: each check gives a result in limited time, whatever the plug-in does."""

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
from saf_gen.core.user_code import PassesUserCode, user_code

Check = Callable[[], str]
"""A function that returns its observation if all is well, and otherwise raises CheckFailure or CheckWarning."""

PACKAGE = Path(__file__).parents[2]
PLUGIN_FOLDERS = (PACKAGE / "plugins/measures", PACKAGE / "plugins/searches")
NUMPY = Path(np.__file__).parent
PYTHON = Path(traceback.__file__).parent


@dataclass(frozen=True)
class CheckLimits:
    """Limits after which a plug-in is stopped.

    The time limit acts on Python code in the main thread, on systems that have interval timers.

    Parameters
    ----------
    scores : int, optional
        Maximum number of scores from one view.
    seconds : float, optional
        Maximum duration of one check, in seconds.
    """

    scores: int = 1_000_000
    seconds: float = 30.0

    def check_scores(self, scores: int) -> None:
        """Raise LimitExceededError if there are more scores than allowed."""
        if scores > self.scores:
            raise LimitExceededError(f"did not end within {self.scores:,} scores")


class LimitExceededError(PassesUserCode):
    """Error for a plug-in that exceeds its limits; a BaseException, so that no ``except Exception`` catches it."""


def run_checks(part: str, checks: Mapping[str, Check], *, limits: CheckLimits) -> Iterator[CheckResult]:
    """Run checks one after the other and yield their results; a check that exceeds the limits ends the run."""
    for name, check in checks.items():
        try:
            yield CheckResult(part, name, "pass", _run_within(check, limits))
        except CheckFailure as fault:
            yield CheckResult(part, name, fault.level, fault.seen, fault.to_do)
        except LimitExceededError as late:
            seen = f"{late}; the remaining checks were skipped"
            yield CheckResult(part, name, "fail", seen, "make every loop end, whatever the scores are")
            return
        except Exception as error:  # noqa: BLE001 a third-party plug-in may raise anything
            seen = describe_crash(error)
            yield CheckResult(part, name, "fail", seen, "handle this case: no input may raise an exception")


def describe_crash(error: BaseException) -> str:
    """Return an exception on one line, with the file and line of the plug-in that raised it."""
    plugin_frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if _is_plugin_code(Path(frame.filename))
    ]
    origin = f" ({Path(plugin_frames[-1].filename).name}, line {plugin_frames[-1].lineno})" if plugin_frames else ""
    return " ".join(f"{type(error).__name__}: {error}{origin}".split())


def _is_plugin_code(file: Path) -> bool:
    in_package = PACKAGE in file.parents and not any(folder in file.parents for folder in PLUGIN_FOLDERS)
    in_library = PYTHON in file.parents and "site-packages" not in file.parts
    in_python = in_library or file.name.startswith("<frozen ")  # such as exit() itself
    return not (in_package or in_python or NUMPY in file.parents)


def _run_within(check: Check, limits: CheckLimits) -> str:
    """Return the check's observation; a Python warning becomes a CheckWarning, instead of filling the screen."""
    with warnings.catch_warnings(record=True) as caught, _time_limit(limits.seconds):
        warnings.simplefilter("always")
        with user_code():
            seen = check()
    if caught:
        raise CheckWarning(f"{caught[0].category.__name__}: {caught[0].message}", "handle the case that causes this")
    return seen


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Raise LimitExceededError inside the ``with`` block after ``seconds``."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> Any:
        raise LimitExceededError(f"did not end within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
