"""Runner for checks of third-party plug-ins, each of which ends in limited time, and checks that all of them share."""

import inspect
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import numpy as np

from saf_gen.benchmark.search_run import answer_fault
from saf_gen.core.finding import Finding
from saf_gen.core.user_code import PassesUserCode, user_code
from saf_gen.parts import Answer, cite_source

Check = Callable[[], str]
"""A function that returns its observation if all is well, and otherwise raises CheckFailure or CheckWarning."""

PACKAGE = Path(__file__).parents[2]
PLUGIN_FOLDERS = (PACKAGE / "plugins/measures", PACKAGE / "plugins/searches")
NUMPY = Path(np.__file__).parent
PYTHON = Path(traceback.__file__).parent
STATE_HINT = "use no random numbers, and keep no state between calls"
UNIT_HINT = "the unit of the scores must not matter: compare scores with each other, never with a constant"


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


class CheckFailure(PassesUserCode):
    """Error that a failing check raises, with its observation and the correction of the fault.

    It is a BaseException, so that no ``except Exception`` in a plug-in or in the benchmark catches it.
    """

    level: Literal["warning", "error"] = "error"

    def __init__(self, seen: str, to_do: str) -> None:
        super().__init__(seen)
        self.seen, self.to_do = seen, to_do


class CheckWarning(CheckFailure):
    """Error that a check raises if a warning is enough."""

    level = "warning"


class LimitExceededError(PassesUserCode):
    """Error for a plug-in that exceeds its limits; a BaseException, so that no ``except Exception`` catches it."""


def run_checks(part: str, checks: Mapping[str, Check], *, limits: CheckLimits) -> Iterator[Finding]:
    """Run checks one after the other and yield their results; a check that exceeds the limits ends the run."""
    for name, check in checks.items():
        try:
            yield Finding(name, "ok", _run_within(check, limits), part=part)
        except CheckFailure as fault:
            yield Finding(name, fault.level, fault.seen, fault.to_do, part)
        except LimitExceededError as late:
            seen = f"{late}; the remaining checks were skipped"
            yield Finding(name, "error", seen, "make every loop end, whatever the scores are", part)
            return
        except Exception as error:  # noqa: BLE001 a third-party plug-in may raise anything
            seen = describe_crash(error)
            yield Finding(name, "error", seen, "handle this case: no input may raise an exception", part)


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


def check_answer(answer: Any, *, commanding: bool) -> Answer:
    """Return the answer if answer_fault finds no fault; otherwise raise CheckFailure."""
    if fault := answer_fault(answer, commanding=commanding):
        raise CheckFailure(*fault)
    return answer


def check_answer_frame(answer: object, frames: int, *, recording: str) -> Answer:
    """Return an estimating search's answer if its frame is in the recording or is None; else raise CheckFailure."""
    found = check_answer(answer, commanding=False)
    if found.frame is not None and not 0 <= found.frame <= frames - 1:
        raise CheckFailure(
            f"it answers frame {found.frame:g} of {frames:,}, on {recording}",
            f"frames are counted from 0: 0 to {frames - 1:,}",
        )
    return found


def check_same_answers(first: object, again: object, *, cause: str, hint: str = STATE_HINT) -> None:
    """Raise CheckFailure if two answers differ; ``cause`` describes the difference between the two runs."""
    if first != again:
        raise CheckFailure(f"{cause}: {again}, not {first}", hint)


def check_class(plug_in: object) -> None:
    """Raise CheckFailure unless the plug-in is a frozen dataclass with a docstring.

    A plug-in made from a function, or from a class that is not a dataclass, need not be frozen. If it has no docstring,
    CheckWarning is raised instead.
    """
    cls = type(plug_in)
    if not is_dataclass(cls):
        raise CheckFailure("it is not a dataclass", "put @dataclass(frozen=True) above its class")
    if not _is_plain(plug_in) and not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise CheckFailure("its dataclass is not frozen", "write @dataclass(frozen=True)")
    docstring = inspect.getdoc(cls) or ""
    if not docstring or docstring.startswith(f"{cls.__name__}("):  # generated by dataclass
        raise _missing(plug_in)("it has no docstring", "write what the plug-in does, its options and its range")


def _is_plain(plug_in: object) -> bool:
    """Return whether a plug-in was made from a function or from a class that is not a dataclass."""
    return hasattr(type(plug_in), "plain")


def _missing(plug_in: object) -> type[CheckFailure]:
    """Return the type of error for a missing text: CheckWarning for plain code, which may be short-lived."""
    return CheckWarning if _is_plain(plug_in) else CheckFailure


def check_docs(plug_in: object) -> str:
    """Check that the plug-in is plain code, or a frozen dataclass, with a docstring and a source."""
    check_class(plug_in)
    source = cite_source(plug_in)
    if not source:
        raise _missing(plug_in)(
            "it cites no source",
            'add source: ClassVar[str] = "the paper, with its DOI", or a section References to its docstring',
        )
    kind = "plain code" if _is_plain(plug_in) else "a frozen dataclass"
    return f"{kind} with a docstring; source: {source}"
