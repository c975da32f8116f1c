"""Jobs and their results.

A job is a picklable value with a method ``run(report)``. It is idempotent and leaves its result on disk, so a job that
runs twice, or a worker that dies, does no harm. Its return value is small.
"""

import errno
import os
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from saf_gen.errors import SafGenError

ReportProgress = Callable[[str, float], None]
"""Called with the name of a piece of work and the fraction of it that is done, 0 to 1."""


class Job(Protocol):
    """Work that can be sent to another process, or to another machine."""

    @property
    def name(self) -> str: ...

    @property
    def takes_all_cores(self) -> bool:
        """Return True if the job uses every core, so that two of them on one machine only slow each other down."""
        ...

    @property
    def wants_gpu(self) -> bool:
        """Return True if the job should go to a worker of a cluster that offers a GPU, if there is one."""
        ...

    def run(self, report: ReportProgress) -> Any: ...


JobResult = tuple[Any, Any, SafGenError | None]
"""(job, result, error): the error is None if the job succeeded, and the result is None if it failed."""

FollowUp = Callable[[Any, Any], Iterable[Job]]
"""Called with a job that succeeded and its result; returns the jobs that may start then."""


def cannot_start(error: BaseException) -> bool:
    """Return whether an exception means that the system refuses another thread or process."""
    # OpenBLAS interrupts its process; a worker's user interrupts the run, which then ends the worker.
    return (
        isinstance(error, KeyboardInterrupt)
        or (isinstance(error, RuntimeError) and "can't start new thread" in str(error))
        or (isinstance(error, OSError) and error.strerror == os.strerror(errno.EAGAIN))
    )


def describe_job_error(error: BaseException) -> SafGenError:
    """Return the error of a job as users see it, whatever exception the job raised."""
    if isinstance(error, SafGenError):
        return error
    if isinstance(error, MemoryError):
        message = "out of memory; run with fewer --workers"
    elif isinstance(error, KeyboardInterrupt):  # linear algebra interrupts its own process where it has no threads
        message = "KeyboardInterrupt, as where the system cannot start more threads; run with fewer --workers"
    elif cannot_start(error):
        message = "the system cannot start more threads and processes; run with fewer --workers"
    else:
        message = f"{type(error).__name__}: {error}"
    return SafGenError(message)
