"""Runs jobs, and the jobs that follow from them, on the cores of this machine or on a Dask cluster."""

from collections.abc import Callable, Generator, Iterable, Sequence

from saf_gen.core.child import wait_for_any
from saf_gen.core.cores import check_threads, usable_cores
from saf_gen.core.execution.dask_cluster import Cluster, run_on_dask
from saf_gen.core.execution.job import FollowUp, Job, JobResult, ReportProgress
from saf_gen.core.execution.worker_pool import WorkerPool


def run_jobs(
    jobs: Sequence[Job],
    *,
    workers: int,
    report: ReportProgress,
    follow_up: FollowUp = lambda job, result: (),
    cluster: Cluster | None = None,
    notify: Callable[[str], None] = lambda line: None,
) -> Generator[JobResult]:
    """Run jobs, and the jobs that follow from them, and yield each when it ends.

    On this machine ``workers`` jobs run at a time, together with one of the jobs that take all cores, so that cores do
    not idle while a file is written or a scene loaded. If a job fails, its error is yielded, nothing follows from it,
    and the other jobs continue. A job whose process dies is run once more, alone; if its process dies again, the job
    has failed. If the system cannot start the processes with their threads, nothing runs, and BadInput is raised.

    Parameters
    ----------
    jobs : sequence of Job
        Jobs that can start at once.
    workers : int
        Number of jobs at a time on this machine.
    report : callable
        Called with the name of a piece of work and the fraction of it that is done, 0 to 1.
    follow_up : callable, optional
        Called with a job that succeeded and its result; returns the jobs that may start then.
    cluster : Cluster, optional
        Dask cluster that runs the jobs instead, see :func:`saf_gen.core.execution.dask_cluster.run_on_dask`.
    notify : callable, optional
        Called with a line of text for each job that is run again, with the reason, and for what has been silent for
        long.

    Yields
    ------
    JobResult
        Job, result and error of each job.
    """
    if not jobs:
        nothing: tuple[JobResult, ...] = ()
        return (ended for ended in nothing)
    if cluster is not None:
        return run_on_dask(jobs, cluster, report=report, follow_up=follow_up, notify=notify)
    return _run_on_cores(jobs, workers, report=report, follow_up=follow_up, notify=notify)


def threads_needed(workers: int) -> int:
    """Return how many threads and processes a run with so many workers starts on the cores of this machine."""
    cores = usable_cores()
    algebra = 2 * (min(cores, 64) - 1)  # of numpy and of scipy, in each process
    render = 1 + 2 * cores + algebra
    recordings = workers * (2 + algebra) + 2 * max(cores, workers)
    return 1 + render + recordings  # each process has a supervisor


def _run_on_cores(
    jobs: Sequence[Job], workers: int, *, report: ReportProgress, follow_up: FollowUp, notify: Callable[[str], None]
) -> Generator[JobResult]:
    check_threads(threads_needed(workers))
    pools = exclusive_pool, shared_pool = tuple(WorkerPool(count, notify=notify) for count in (1, workers))

    def add(jobs: Iterable[Job]) -> None:
        for job in jobs:
            (exclusive_pool if job.takes_all_cores else shared_pool).add([job])

    try:
        add(jobs)
        while running := [child for pool in pools for child in pool.running]:
            wait_for_any(running, 0.2)
            for pool in pools:
                for job, result, error in pool.collect(report):
                    if error is None:
                        add(follow_up(job, result))
                    yield job, result, error
    except BaseException:
        # Jobs may be terminated at any point, and waiting for a render to finish could take minutes.
        for pool in pools:
            pool.close(cancel=True)
        raise
    for pool in pools:
        pool.close()
