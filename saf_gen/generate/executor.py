"""Runs jobs, and the jobs that follow from them, on the cores of this machine or on a Dask cluster.

A job is a picklable value with ``run(report)``. It is idempotent and leaves its result on disk, so a job that
runs twice, or a worker that dies, does no harm. What it returns is small.
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

ReportProgress = Callable[[str, float], None]
"""Called with the name of a piece of work and the fraction of it that is done, 0...1."""


class Job(Protocol):
    """Work that can be sent to another process."""

    @property
    def name(self) -> str: ...

    @property
    def takes_all_cores(self) -> bool:
        """Whether the job uses every core, so that two of them on one machine only slow each other down."""
        ...

    def run(self, report: ReportProgress) -> Any: ...


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
) -> Iterator[JobResult]:
    """Run jobs and those that follow from them, and yield each as it ends.

    On this machine ``workers`` jobs run at a time, and beside them one of those that take all cores, so that
    cores that are idle (a file is being written, a scene loaded) are used. Where a job fails, its error is
    yielded, nothing follows from it, and the others go on. With ``address`` a Dask cluster runs the jobs.
    """
    if not jobs:
        return iter(())
    if address:
        return _run_on_dask(jobs, address, report=report, follow_up=follow_up)
    return _run_on_cores(jobs, workers, report=report, follow_up=follow_up)


_queue: Any = None


def _start_worker(queue: Any) -> None:
    """Set up a worker: it reports to the queue, and ends when its parent ends."""
    global _queue
    _queue = queue
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent.sentinel,), daemon=True).start()


def _exit_after(sentinel: int) -> None:
    # Without this a killed run leaves workers behind, which wait for ever and keep their memory.
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def _run(job: Job) -> Any:
    return job.run(lambda name, done: _queue.put((name, done)))


def _run_silent(job: Job) -> Any:
    return job.run(lambda name, done: None)  # on a cluster only whole jobs report


def _run_on_cores(
    jobs: Sequence[Job], workers: int, *, report: ReportProgress, follow_up: FollowUp
) -> Iterator[JobResult]:
    # Spawned, never forked: Mitsuba's and numba's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    queue = context.SimpleQueue()
    others = set(multiprocessing.active_children())  # these belong to the program that calls this function
    with ExitStack() as stack:
        alone, side_by_side = (
            stack.enter_context(
                ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=(queue,))
            )
            for count in (1, workers)
        )
        waiting: dict[Future[Any], Job] = {}

        def submit(jobs: Iterable[Job]) -> None:
            with defer_interrupts():  # a worker that is interrupted while it starts prints a traceback
                for job in jobs:
                    waiting[_submit(alone if job.takes_all_cores else side_by_side, job)] = job

        submit(jobs)
        try:
            while waiting:
                done, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
                while not queue.empty():
                    report(*queue.get())
                for future in done:
                    job = waiting.pop(future)
                    result, error = _outcome(future)
                    if error is None:
                        submit(follow_up(job, result))
                    yield job, result, error
        except (KeyboardInterrupt, GeneratorExit):
            # A job may be ended in the middle, and waiting for a render to finish could take minutes.
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            for pool in (alone, side_by_side):
                pool.shutdown(wait=True, cancel_futures=True)
            raise


def _submit(pool: ProcessPoolExecutor, job: Job) -> Future[Any]:
    try:
        return pool.submit(_run, job)
    except BrokenProcessPool as error:  # a worker has died: the jobs after it fail with that cause
        broken: Future[Any] = Future()
        broken.set_exception(error)
        return broken


def _outcome(future: Any) -> tuple[Any, SafGenError | None]:
    """Return (result, None), or (None, error) for whatever exception the job raised."""
    error = future.exception()
    if error is None:
        return future.result(), None
    if isinstance(error, SafGenError):
        return None, error
    if isinstance(error, BrokenProcessPool):
        message = "its process died (killed, or out of memory?); run the same command again to go on"
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
