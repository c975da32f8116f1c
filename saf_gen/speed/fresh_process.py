"""A fresh process for a measurement, and the memory that it took."""

import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

from saf_gen.generate.executor import ReportProgress, run_jobs

__all__ = ["bytes_read", "peak_memory_gib", "run_in_fresh_process", "time_call"]

T = TypeVar("T")

_STATUS, _IO = Path("/proc/self/status"), Path("/proc/self/io")
_UNIT = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss, in bytes


@dataclass(frozen=True)
class _Call:
    """A function and what it is given, as a job."""

    name: str
    function: Callable[..., Any]
    given: tuple[Any, ...]
    takes_all_cores: bool = True

    def run(self, report: ReportProgress) -> Any:
        return self.function(*self.given, report)


def run_in_fresh_process(
    function: Callable[..., T], *given: Any, report: ReportProgress = lambda stage, done: None
) -> T:
    """What ``function(*given, report)`` gives in a process of its own, spawned.

    Raises SafGenError where it failed, and the function's own where that is one.
    """
    ((_, result, error),) = run_jobs([_Call(function.__name__, function, given)], workers=1, report=report)
    if error is not None:
        raise error
    return result


def peak_memory_gib() -> float:
    """Most memory (GiB, resident) that this process held so far, or one of those that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _UNIT
    return max(_own_peak(), children) / 2**30


def _own_peak() -> int:
    # Linux hands ru_maxrss on to whatever a process starts: a small child of a large parent would look large.
    # VmHWM begins anew.
    line = _field(_STATUS, "VmHWM")
    if line is not None:
        return 1024 * line
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT


def bytes_read() -> int | None:
    """Bytes that this process has read from files so far, from disk or cache; None where nobody counts."""
    return _field(_IO, "rchar")


def _field(path: Path, name: str) -> int | None:
    """The first number of a line ``name: number ...``; None without the file or the line."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) if found else None


def time_call(work: Callable[..., T], *given: Any, **named: Any) -> tuple[T, float]:
    """What ``work`` gives, and the time that it takes (s)."""
    begin = perf_counter()
    result = work(*given, **named)
    return result, perf_counter() - begin
