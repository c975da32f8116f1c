"""Runs jobs and those that follow from them: on this machine's cores, or on a Dask cluster; a thin engine.

A job is a picklable value with ``run(report)``; it is idempotent and leaves its result on disk, so a job that
runs twice, or a worker that dies, does no harm. Small values come back.
"""

import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from typing import Any, Protocol

from saf_gen.core.cores import defer_interrupts
from saf_gen.errors import BadInput, SafGenError

__all__ = ["FollowUp", "Job", "JobResult", "ReportProgress", "run_jobs"]

ReportProgress = Callable[[str, float], None]
"""Told the name of a piece of work and the share of it done, 0...1."""


class Job(Protocol):
    """Work that can be sent to another process."""

    @property
    def name(self) -> str: ...

    @property
    def takes_all_cores(self) -> bool:
        """Whether two such jobs on one machine would only be in each other's way."""
        ...

    def run(self, report: ReportProgress) -> Any: ...


JobResult = tuple[Any, Any, SafGenError | None]
"""(job, result, error): the error is None where the job did well; the result is None where it did not."""

FollowUp = Callable[[Any, Any], Iterable[Job]]
"""Given a job that did well and its result: the jobs that may start now."""


def run_jobs(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: FollowUp = lambda job, result: (),
    address: str | None = None,
) -> Iterator[JobResult]:
    """Run jobs and those that follow from them, and give each as it ends.

    On cores, ``workers`` jobs run at a time and beside them one of those that take all cores: what one
    leaves idle (a file being written, a scene being loaded) the others use. A job that fails is named with
    its error, nothing follows from it, and the others go on.
    """
    if not jobs:
        return iter(())
    return (
        _on_dask(jobs, address, report, follow_up) if address else _on_cores(jobs, workers, report, follow_up)
    )


_queue: Any = None


def _start(queue: Any) -> None:
    """Set a worker up: it reports to the queue, and ends when its parent ends."""
    global _queue
    _queue = queue
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel,), daemon=True).start()


def _end_after(sentinel: int) -> None:
    # Without this a killed run leaves workers behind that wait for ever, with their memory.
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _report(name: str, done: float) -> None:
    _queue.put((name, done))


def _run(job: Job) -> Any:
    return job.run(_report)


def _silent(name: str, done: float) -> None:
    """On a cluster only whole jobs report."""


def _run_silent(job: Job) -> Any:
    return job.run(_silent)


def _on_cores(
    jobs: Sequence[Job], workers: int, report: ReportProgress, follow_up: FollowUp
) -> Iterator[JobResult]:
    # Spawned, never forked: Mitsuba's and numba's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    queue = context.SimpleQueue()
    others = set(multiprocessing.active_children())  # of a program that calls us, not ours to end
    with ExitStack() as stack:
        alone, side_by_side = (
            stack.enter_context(
                ProcessPoolExecutor(count, mp_context=context, initializer=_start, initargs=(queue,))
            )
            for count in (1, workers)
        )
        waiting: dict[Future[Any], Job] = {}

        def submit(jobs: Iterable[Job]) -> None:
            with defer_interrupts():  # workers start here; one interrupted while it loads prints a traceback
                for job in jobs:
                    waiting[_submitted(alone if job.takes_all_cores else side_by_side, job)] = job

        submit(jobs)
        try:
            while waiting:
                ended, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
                while not queue.empty():
                    report(*queue.get())
                for future in ended:
                    job = waiting.pop(future)
                    result, error = _outcome(future)
                    if error is None:
                        submit(follow_up(job, result))
                    yield job, result, error
        except (KeyboardInterrupt, GeneratorExit):
            # Jobs are safe to end in the middle; waiting for a render to finish could take minutes.
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            for pool in (alone, side_by_side):
                pool.shutdown(wait=True, cancel_futures=True)
            raise


def _submitted(pool: ProcessPoolExecutor, job: Job) -> Future[Any]:
    try:
        return pool.submit(_run, job)
    except BrokenProcessPool as error:  # a worker died before: what comes after it fails with that cause
        broken: Future[Any] = Future()
        broken.set_exception(error)
        return broken


def _outcome(future: Any) -> tuple[Any, SafGenError | None]:
    """(result, None), or (None, what went wrong): whatever a job raised is told, and the others go on."""
    error = future.exception()
    if error is None:
        return future.result(), None
    if isinstance(error, SafGenError):
        return None, error
    if isinstance(error, BrokenProcessPool):
        told = "its process died (killed, or out of memory?); run the same command again to go on"
    elif isinstance(error, MemoryError):
        told = "out of memory; run with fewer --workers"
    else:
        told = f"{type(error).__name__}: {error}"
    return None, SafGenError(told)


def _on_dask(
    jobs: Sequence[Job], address: str | None, report: ReportProgress, follow_up: FollowUp
) -> Iterator[JobResult]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise BadInput(
            "--cluster needs the package dask.distributed", hint="pip install 'saf-gen[cluster]'"
        ) from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise BadInput(
            f"no Dask scheduler answers at {address!r}: {error}", allowed="an address such as tcp://host:8786"
        ) from error
    with client:
        # Each result is small and released at once; a re-run of a finished job finds its file and keeps it.
        futures: dict[Any, Job] = {}

        def submitted(jobs: Iterable[Job]) -> list[Any]:
            new = {client.submit(_run_silent, job, pure=False): job for job in jobs}
            futures.update(new)
            return list(new)

        ending = as_completed(submitted(jobs))
        for future in ending:
            job = futures.pop(future)
            report(job.name, 1.0)
            result, problem = _outcome(future)
            future.release()
            if problem is None:
                ending.update(submitted(follow_up(job, result)))
            yield job, result, problem
