"""Runs jobs, and the jobs that follow from them, on the cores of this machine or on a Dask cluster.

A job is a picklable value with ``run(report)``. It is idempotent and leaves its result on disk, so a job that
runs twice, or a worker that dies, does no harm. What it returns is small.
"""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from saf_gen.errors import BadInput, SafGenError
from saf_gen.generate.worker_pool import Job, ReportProgress, WorkerPool

__all__ = ["Job", "JobResult", "ReportProgress", "run_generation_jobs"]

JobResult = tuple[Any, Any, SafGenError | None]
"""(job, result, error): the error is None where the job succeeded, the result is None where it failed."""

FollowUp = Callable[[Any, Any], Iterable[Job]]
"""Called with a job that succeeded and its result; returns the jobs that may start then."""


def run_generation_jobs(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: FollowUp = lambda job, result: (),
    address: str | None = None,
    tell_retry: Callable[[Job], None] = lambda job: None,
) -> Iterator[JobResult]:
    """Run jobs and those that follow from them, and yield each as it ends.

    On this machine ``workers`` jobs run at a time, and beside them one of those that take all cores, so that
    cores that are idle (a file is being written, a scene loaded) are used. Where a job fails, its error is
    yielded, nothing follows from it, and the others go on. A job whose process dies is run once more, alone, and
    ``tell_retry`` is called with it; one that dies twice is set aside. With ``address`` a Dask cluster runs the jobs.
    """
    if not jobs:
        return iter(())
    if address:
        return _run_on_dask(jobs, address, report=report, follow_up=follow_up)
    return _run_on_cores(jobs, workers, report=report, follow_up=follow_up, tell_retry=tell_retry)


def _run_silent(job: Job) -> Any:
    return job.run(lambda name, done: None)  # on a cluster only whole jobs report


def _run_on_cores(
    jobs: Sequence[Job], workers: int, *, report: ReportProgress, follow_up: FollowUp, tell_retry: Callable[[Job], None]
) -> Iterator[JobResult]:
    others = set(multiprocessing.active_children())  # these belong to the program that calls this function
    pools = alone, side_by_side = tuple(WorkerPool(count, tell_retry=tell_retry) for count in (1, workers))

    def add(jobs: Iterable[Job]) -> None:
        for job in jobs:
            (alone if job.takes_all_cores else side_by_side).add([job])

    try:
        add(jobs)
        while futures := [future for pool in pools for future in pool.futures]:
            wait(futures, timeout=0.2, return_when=FIRST_COMPLETED)
            for pool in pools:
                for job, future in pool.collect(report):
                    result, error = _outcome(future)
                    if error is None:
                        add(follow_up(job, result))
                    yield job, result, error
    except BaseException:
        # A job may be ended in the middle, and waiting for a render to finish could take minutes.
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        for pool in pools:
            pool.close(cancel=True)
        raise
    for pool in pools:
        pool.close()


def _outcome(future: Any) -> tuple[Any, SafGenError | None]:
    """Return (result, None), or (None, error) for whatever exception the job raised."""
    error = future.exception()
    if error is None:
        return future.result(), None
    if isinstance(error, SafGenError):
        return None, error
    if isinstance(error, BrokenProcessPool):
        message = "its process died twice (killed, or out of memory?); run the same command again to go on"
    elif isinstance(error, MemoryError):
        message = "out of memory; run with fewer --workers"
    else:
        message = f"{type(error).__name__}: {error}"
    return None, SafGenError(message)


def _run_on_dask(
    jobs: Sequence[Job], address: str, *, report: ReportProgress, follow_up: FollowUp
) -> Iterator[JobResult]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise BadInput("--cluster needs the package dask.distributed", hint="pip install 'saf-gen[cluster]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise BadInput(
            f"no Dask scheduler answers at {address!r}: {error}", allowed="an address such as tcp://host:8786"
        ) from error
    with client:
        # Results are released at once; where Dask runs a finished job again, the job finds its file.
        futures: dict[Any, Job] = {}

        def submit(jobs: Iterable[Job]) -> list[Any]:
            new = {client.submit(_run_silent, job, pure=False): job for job in jobs}
            futures.update(new)
            return list(new)

        ending = as_completed(submit(jobs))
        for future in ending:
            job = futures.pop(future)
            report(job.name, 1.0)
            result, problem = _outcome(future)
            future.release()
            if problem is None:
                ending.update(submit(follow_up(job, result)))
            yield job, result, problem
