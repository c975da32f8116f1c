"""Function calls in a fresh process, and measurements of time, peak memory and bytes read."""

import resource
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

from saf_gen.core.execution.executor import run_jobs
from saf_gen.core.execution.job import ReportProgress

T = TypeVar("T")

_STATUS, _IO = Path("/proc/self/status"), Path("/proc/self/io")
_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes per unit of ru_maxrss


@dataclass(frozen=True)
class _Call:
    """A function and its arguments, as a job."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    options: dict[str, Any]
    takes_all_cores: bool = True
    wants_gpu: bool = False

    def run(self, report: ReportProgress) -> Any:
        return self.function(*self.arguments, **self.options, report=report)


def run_bench_in_fresh_process(
    function: Callable[..., T], *arguments: Any, report: ReportProgress = lambda stage, done: None, **options: Any
) -> T:
    """Return ``function(*arguments, **options, report=report)``, called in a spawned process.

    Raises SafGenError if the call fails; a SafGenError raised by the function is raised here as well.
    """
    call = _Call(function.__name__, function, arguments, options)
    ((_, result, error),) = run_jobs([call], workers=1, report=report)
    if error is not None:
        raise error
    return result


def peak_memory_of_bench_gib() -> float:
    """Return the peak resident memory (GiB) of this process, or of a child that it waited for if that is larger."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _UNIT
    line = _field(_STATUS, "VmHWM")  # on Linux a child inherits ru_maxrss from its parent, but not VmHWM
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT if line is None else 1024 * line
    return max(own, children) / 2**30


def bytes_read_by_bench() -> int | None:
    """Return the number of bytes that this process has read, from disk or cache; None if the system does not count."""
    return _field(_IO, "rchar")


def _field(path: Path, name: str) -> int | None:
    """Return the number in the line ``name: number ...`` of a file; None if the file or the line is missing."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) if found else None


def time_benched_call(work: Callable[..., T], *arguments: Any, **options: Any) -> tuple[T, float]:
    """Return ``work(*arguments, **options)`` and the seconds that it took."""
    begin = perf_counter()
    return work(*arguments, **options), perf_counter() - begin
